"""A critic that sees the whole world while the policy that it teaches sees a robot's observation alone.

C. Yu et al., "The Surprising Effectiveness of PPO in Cooperative Multi-Agent Games" (NeurIPS 2022): MAPPO. The reward
is the team's, and what it will be hangs on targets that nobody sees; a critic that sees them leaves less to chance.
"""

import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import create_mlp
from torch import nn

from lissajous_env import Simulation
from lissajous_env.envs.true_state import OF_ROBOT, true_state

_ZONES = (12, 6)
"""Columns and rows in which undetected targets are counted."""
_SEEN = [OF_ROBOT.index(name) for name in ("x", "y", "cos_heading", "sin_heading", "speed", "works")]
"""Columns of a robot that are shown."""
_MANY = 8.0
"""Targets that count as one."""


class WorldView:
    """Rows of what a central critic sees besides a robot's own inputs.

    Of each robot in the order of the ring, itself first: x, y, cos and sin heading, speed, whether it works; then the
    share of the episode that is over, the undetected targets, and those in each zone of the rectangle.
    """

    def __init__(self, simulation: Simulation):
        self.simulation = simulation
        ring = np.array(simulation.scenario.ring)
        order = np.array([np.roll(ring, -int(np.flatnonzero(ring == i)[0])) for i in range(len(ring))])
        self._order = order[:, :, None]
        self._zones = _ZONES if simulation.scenario.target_capacity else (0, 0)
        self.size = len(_SEEN) * len(ring) + 2 + self._zones[0] * self._zones[1]

    def rows(self) -> np.ndarray:
        """(W N, size) what the critic sees of the worlds as they are."""
        state = true_state(self.simulation)
        worlds, n, _ = state.robots.shape
        team = state.robots[:, self._order, _SEEN].reshape(worlds, n, -1)
        waiting = self._waiting(state.targets) if self._zones[0] else np.zeros((worlds, 1), dtype=np.float32)
        world = np.concatenate([state.elapsed, waiting], axis=1, dtype=np.float32)
        shared = np.broadcast_to(world[:, None], (worlds, n, world.shape[1]))
        return np.concatenate([team, shared], axis=2).reshape(worlds * n, self.size)

    def _waiting(self, targets: np.ndarray) -> np.ndarray:
        """(W, 1 + zones) undetected targets, of all and in each zone."""
        columns, rows = self._zones
        w, t = np.nonzero(targets[:, :, 0])
        place = 0.5 * (targets[w, t, 1:] + 1.0) * (columns, rows)
        zone = np.clip(place.astype(np.int64), 0, (columns - 1, rows - 1))
        index = (w * columns + zone[:, 0]) * rows + zone[:, 1]
        counts = np.bincount(index, minlength=len(targets) * columns * rows).reshape(len(targets), columns * rows)
        return np.concatenate([counts.sum(axis=1, keepdims=True), counts], axis=1) / _MANY


class CentralCriticPolicy(ActorCriticPolicy):
    """Stable-Baselines3's policy, whose actor reads the first `actor_inputs` entries of a row and its critic all."""

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
        self.latent_dim_pi = self.latent_dim_vf = layers[-1]

    def forward(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Last hidden layers of actor and critic."""
        return self.forward_actor(rows), self.forward_critic(rows)

    def forward_actor(self, rows: torch.Tensor) -> torch.Tensor:
        """Last hidden layer of the actor."""
        return self.policy_net(rows[:, : self.actor_inputs])

    def forward_critic(self, rows: torch.Tensor) -> torch.Tensor:
        """Last hidden layer of the critic."""
        return self.value_net(rows)
