"""Stable-Baselines3's PPO with a central critic: the critic reads the whole world, the actor its robot's row only.

J. Schulman et al., "Proximal Policy Optimization Algorithms" (arXiv:1707.06347). C. Yu et al., "The Surprising
Effectiveness of PPO in Cooperative Multi-Agent Games" (NeurIPS 2022): MAPPO. The reward is shared by the team and
depends on targets that no robot may have detected; a critic that observes them has less variance. A time limit is not a
terminal state: the library adds the critic's value of the last observation to the last reward.
"""

import warnings
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import create_mlp
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from training.learned.card import Card
from training.learned.network import Network
from training.sb3.torch_state import linear, load_state, network_of, save_state
from training.settings import TrainingSettings

_FIRST_SEED = 1_000_000
_LAST_LEARNING_RATE = 0.02
"""Learning rate at the end, relative to that at the start."""


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


class RobotPPO(PPO):
    """PPO in the rows of robots, whose learning rate and noise decrease, and whose critic may learn alone.

    Args:
        settings: Settings of the training.
        env: Environments to learn in.
        card: Inputs of the policy.
    """

    def __init__(self, settings: TrainingSettings, env: VecEnv, card: Card):
        self.settings = settings
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "You have specified a mini-batch size")  # the last one may be smaller
            super().__init__(
                CentralCriticPolicy,
                env,
                learning_rate=self._rate_of,
                n_steps=settings.rollout,
                batch_size=settings.batch_size,
                n_epochs=settings.epochs,
                gamma=settings.gamma,
                gae_lambda=settings.gae_lambda,
                use_sde=settings.chosen_noise_steps > 1,
                sde_sample_freq=settings.chosen_noise_steps,
                seed=settings.seed,
                device=settings.device,
                policy_kwargs={
                    "actor_inputs": card.network_inputs,
                    "net_arch": list(settings.layers),
                    "activation_fn": nn.ReLU,
                    "log_std_init": settings.log_std,
                    "optimizer_kwargs": {"eps": 1e-5, "fused": True},
                },
            )
        if settings.initial_output:
            with torch.no_grad():
                output: Any = self.policy.action_net
                output.bias.copy_(torch.tensor(settings.initial_output))
        env.seed(_FIRST_SEED * (1 + settings.seed))  # far from the seeds of evaluations
        _, self._no_callback = self._setup_learn(settings.steps)  # begins an episode in every environment

    @property
    def rows(self) -> np.ndarray:
        """Rows (R, inputs) to act on next."""
        assert isinstance(self._last_obs, np.ndarray)
        return self._last_obs

    @rows.setter
    def rows(self, rows: np.ndarray) -> None:
        self._last_obs = rows

    def learn_once(self, done: float, critic_only: bool = False) -> None:
        """Collect a rollout and update the policy with it; the library records diagnostics in the logger.

        Args:
            done: Fraction of the training that is done, which determines the learning rate.
            critic_only: True if only the critic is updated.
        """
        assert self.env is not None
        self.collect_rollouts(self.env, self._no_callback, self.rollout_buffer, self.n_steps)
        self._current_progress_remaining = 1.0 - done
        for name, parameter in self.policy.named_parameters():
            parameter.requires_grad_(not critic_only or "value_net" in name)
        self.train()

    def minimize(self, loss: torch.Tensor) -> None:
        """Take a step of the optimizer."""
        self.policy.optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
        self.policy.optimizer.step()

    def _rate_of(self, remaining: float) -> float:
        """Return the learning rate for the remaining fraction of the training."""
        return self.settings.learning_rate * (_LAST_LEARNING_RATE + (1 - _LAST_LEARNING_RATE) * remaining)

    def set_learning_rate(self, remaining: float) -> None:
        """Set the learning rate for the remaining fraction of a phase."""
        for group in self.policy.optimizer.param_groups:
            group["lr"] = self._rate_of(remaining)

    def set_noise(self, done: float) -> None:
        """Set the noise for the fraction of the training that is done, unless the settings let it be learned."""
        start, end = self.settings.log_std, self.settings.log_std_end
        if end is not None:
            with torch.no_grad():
                self.policy.log_std.fill_(start - max(start - end, 0.0) * min(done, 1.0))

    def network(self) -> Network:
        """Copy the policy, the mean of its action, as plain arrays."""
        return network_of(self.policy.mlp_extractor.policy_net, self.policy.action_net)

    def start_from(self, network: Network) -> None:
        """Copy the weights of a network with the same layers into the policy."""
        layers = linear(self.policy.mlp_extractor.policy_net, self.policy.action_net)
        with torch.no_grad():
            for layer, weight, bias in zip(layers, network.weights, network.biases, strict=True):
                layer.weight.copy_(torch.tensor(weight))
                layer.bias.copy_(torch.tensor(bias))

    def require_finite(self, steps: int, cause: Exception | None = None) -> None:
        """Raise a ValueError with a remedy if weights, noise or the next actions are not finite.

        Args:
            steps: Robot steps so far.
            cause: Exception raised by a step.
        """
        finite = all(bool(torch.isfinite(parameter).all()) for parameter in self.policy.parameters())
        spread = self.policy.log_std.detach().exp()
        finite = finite and bool((torch.isfinite(spread) & (spread > 0)).all())
        if finite:
            with torch.no_grad():
                rows = torch.from_numpy(self.rows).to(self.device)
                features = self.policy.mlp_extractor.forward_actor(rows)
                finite = bool(torch.isfinite(self.policy.action_net(features)).all())
        if not finite:
            raise ValueError(
                f"learning_rate must be low enough that weights and actions stay finite, got "
                f"{self.settings.learning_rate:g}: after {steps:,} steps they are not; the last checkpoint is intact"
            ) from cause

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy all that a resumed training needs: weights, optimizer, random generators, rows to act on next."""
        state = {"rows": self.rows.copy(), "starts": np.array(self._last_episode_starts)}
        state["updates"] = np.array([self._n_updates])
        return save_state(self.policy, self.policy.optimizer) | state

    def load_state(self, arrays: dict[str, np.ndarray]) -> None:
        """Resume from what `save_state` returned for the same settings."""
        load_state(self.policy, self.policy.optimizer, arrays)
        self._last_obs, self._last_episode_starts = arrays["rows"], arrays["starts"]
        self._n_updates = int(arrays["updates"][0])
