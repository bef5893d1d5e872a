"""Policy network with a central critic: the critic reads the whole world, the actor its robot's observation only.

C. Yu et al., "The Surprising Effectiveness of PPO in Cooperative Multi-Agent Games" (NeurIPS 2022): MAPPO. The reward
is shared by the team and depends on targets that no robot may have detected; a critic that observes them has less
variance.
"""

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import create_mlp
from torch import nn


class CentralCriticPolicy(ActorCriticPolicy):
    """Actor-critic policy whose actor reads the first `actor_inputs` entries of a row, and whose critic reads all."""

    def __init__(self, *args, actor_inputs: int, **more):
        self.actor_inputs = actor_inputs
        super().__init__(*args, **more)

    def _build_mlp_extractor(self) -> None:
        layers = [int(size) for size in self.net_arch]
        views = _TwoViews(self.actor_inputs, self.features_dim, layers, self.activation_fn)
        self.mlp_extractor = views.to(self.device)


class _TwoViews(nn.Module):
    """Hidden layers of the actor, over the first entries of a row, and of the critic, over all of them."""

    def __init__(self, actor_inputs: int, inputs: int, layers: list[int], activation: type[nn.Module]):
        super().__init__()
        self.actor_inputs = actor_inputs
        self.policy_net = nn.Sequential(*create_mlp(actor_inputs, -1, layers, activation))
        self.value_net = nn.Sequential(*create_mlp(inputs, -1, layers, activation))
        self.latent_dim_pi, self.latent_dim_vf = ([first, *layers][-1] for first in (actor_inputs, inputs))

    def forward(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the last hidden layers of actor and critic."""
        return self.forward_actor(rows), self.forward_critic(rows)

    def forward_actor(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the last hidden layer of the actor."""
        return self.policy_net(rows[:, : self.actor_inputs])

    def forward_critic(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the last hidden layer of the critic."""
        return self.value_net(rows)
