"""The network of a team in PyTorch, as trainings fit it."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from training.learned.perception import OWN
from training.learned.team_network import TeamNetwork
from training.settings import TrainingSettings


class Team(nn.Module):
    """`TeamNetwork` in PyTorch: the mean of a robot's action, or a critic's value.

    Args:
        settings: Sizes of the layers.
        token: Numbers of a token.
        outputs: Numbers of the output.
        heads: Heads of attention; 0 for the mean of the tokens' features.
        memory: Numbers that a robot remembers.
        corrects: Add the wish of the base to the outputs, which are zeros at first.
    """

    def __init__(self, settings: TrainingSettings, token: int, outputs: int, heads=0, memory=0, corrects=False):
        super().__init__()
        self.corrects = corrects
        features, hidden = settings.features, settings.hidden
        self.own, self.token = nn.Linear(len(OWN), 64), nn.Linear(token, features)
        self.query = nn.Linear(64, heads * features) if heads else None
        self.trunk = nn.Linear(64 + max(heads, 1) * features, hidden)
        self.memory = nn.GRUCell(hidden, memory) if memory else None
        self.last, self.action = nn.Linear(hidden + memory, hidden), nn.Linear(hidden, outputs)
        nn.init.orthogonal_(self.action.weight, 0.0 if corrects else 0.01)
        nn.init.zeros_(self.action.bias)

    @torch.autocast("cpu", torch.bfloat16)
    def forward(self, rows: Sequence[Tensor], memory: Tensor, begins: Tensor) -> tuple[Tensor, Tensor]:
        """Return outputs (T, B, outputs) of T steps of B robots, and their memory (B, memory) after these.

        Args:
            rows: Own numbers (T, B, A), tokens (T, B, K, F), and 1 where there is a token (T, B, K).
            memory: (B, memory) before the first step.
            begins: (T, B) 1 in the first step of an episode.
        """
        own, tokens, present = (rows_of.flatten(0, 1) for rows_of in rows)
        own, features = torch.relu(self.own(own)), torch.relu(self.token(tokens))
        if self.query is None:
            pooled = (features * present[..., None]).mean(1)
        else:
            query = self.query(own).view(len(own), -1, features.shape[-1])
            score = query @ features.transpose(1, 2) + (present[:, None] - 1) * 1e4
            weight = (torch.softmax(score, -1) * present[:, None]).to(features.dtype)
            pooled = (weight @ features).flatten(1)
        hidden = torch.relu(self.trunk(torch.cat([own, pooled], -1))).view(*begins.shape, -1)
        if self.memory is not None:
            states = []
            for step, begin in zip(hidden, begins, strict=True):
                memory = self.memory(step, memory * (1 - begin)[:, None])
                states.append(memory)
            hidden = torch.cat([hidden, torch.stack(states)], -1)
        outputs = self.action(torch.relu(self.last(hidden))).float()
        if self.corrects:
            outputs = outputs + nn.functional.pad(rows[0][..., -2:], (0, outputs.shape[-1] - 2))
        return outputs, memory.float()

    def arrays(self) -> TeamNetwork:
        """Copy the weights into a network that is played without PyTorch."""
        named = {name: tensor.detach().numpy().copy() for name, tensor in self.state_dict().items()}
        names = {"memory.weight_ih": "memory.input.weight", "memory.weight_hh": "memory.hidden.weight"}
        names |= {"memory.bias_ih": "memory.input.bias", "memory.bias_hh": "memory.hidden.bias"}
        return TeamNetwork.from_arrays({f"team.{names.get(name, name)}": array for name, array in named.items()})
