"""Proximal policy optimization: collect a rollout, compute returns and advantages, update.

J. Schulman et al., "Proximal Policy Optimization Algorithms" (arXiv:1707.06347). Networks, distributions and noise
are those of Stable-Baselines3. Its loop is not used, because it creates a dictionary per row and step, and evaluates
the critic for one row at a time after a time limit.
"""

import copy
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor, nn

from lissajous_env.device.devices import cores
from training.learned.card import Card
from training.learned.named_arrays import prefixed, within
from training.learned.network import Network
from training.sb3.batch_env import RowsEnv
from training.sb3.critic import CentralCriticPolicy
from training.settings import TrainingSettings

BLOCK = 4096
"""Rows that a CPU thread differentiates at a time. Gradients of blocks are summed in order, so that the result does not
depend on the number of threads. Torch's own threads wait for one another after each operation, which makes training
several times slower as soon as another process uses a core."""
_FIRST_SEED = 1_000_000
_LAST_LEARNING_RATE = 0.02

Loss = Callable[..., tuple[Tensor, Tensor]]
"""Function of a policy and of some rows of tensors: sums over these rows of the loss and of quantities to log."""


class RobotPPO:
    """Policy, critic and optimizer, which learn from the rows of a `RobotVecEnv` or a `RogueVecEnv`.

    Args:
        settings: Settings of the training.
        env: Environments to learn in.
        card: Inputs of the policy.
    """

    def __init__(self, settings: TrainingSettings, env: RowsEnv, card: Card):
        self.settings, self.env = settings, env
        torch.manual_seed(settings.seed)
        env.seed(_FIRST_SEED * (1 + settings.seed))  # far from the seeds of evaluations
        self.policy = CentralCriticPolicy(
            env.observation_space,
            env.action_space,
            lambda _: settings.learning_rate,
            actor_inputs=card.network_inputs,
            net_arch=list(settings.layers),
            activation_fn={"relu": partial(nn.ReLU, inplace=True), "tanh": nn.Tanh}[settings.activation],
            use_sde=settings.chosen_noise_steps > 1,
            log_std_init=settings.log_std,
            optimizer_kwargs={"eps": 1e-5, "fused": True},
        ).to(settings.device)
        if settings.initial_output:
            with torch.no_grad():
                self._layers()[-1].bias.copy_(torch.tensor(settings.initial_output))
        self.observation = np.zeros((env.num_envs, self.policy.features_dim), np.float32)
        """(R, inputs) rows to act on next; zeros before the first `reset`."""

        def tensor(*size: int) -> Tensor:
            return torch.zeros((settings.rollout, env.num_envs, *size), device=settings.device)

        self._observations, self._actions = tensor(self.policy.features_dim), tensor(card.action_size)
        self._log_probs, self._rewards, self._dones, self._advantages, self._returns = (tensor() for _ in range(5))
        self.rows_learned = 0
        """Rows of the latest rollout in which a robot or rogue acted."""
        self._live = torch.ones((settings.rollout, env.num_envs), dtype=torch.bool, device=settings.device)
        self._on_cpu = self.policy.device.type == "cpu"
        self._pool = ThreadPoolExecutor((settings.threads or cores()) if self._on_cpu else 1)

    def reset(self) -> None:
        """Begin an episode in every environment."""
        self.observation = self.env.reset()

    def learn(self, remaining: float, critic_only: bool = False) -> dict[str, float]:
        """Collect a rollout and update the policy with it.

        Args:
            remaining: Remaining fraction of the training, which determines the learning rate.
            critic_only: True if only the critic is updated.

        Returns:
            Means of the loss, its terms and diagnostics over the minibatches.
        """
        values = self._collect()
        self.set_learning_rate(remaining)
        self.policy.set_training_mode(True)
        for name, parameter in self.policy.named_parameters():
            parameter.requires_grad_(not critic_only or "value_net" in name)
        stored = (self._observations, self._actions, self._log_probs, self._advantages, self._returns)
        rows = [tensor.flatten(0, 1) for tensor in stored]
        if self.env.live is not None:
            rows = [tensor[self._live.flatten()] for tensor in rows]
        self.rows_learned = len(rows[0])
        logged = []
        for _ in range(self.settings.epochs):
            for batch in self.minibatches(rows, self.settings.batch_size):
                advantages = batch[3]
                if len(advantages) > 1:
                    batch[3] = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
                logged.append(self.minimize(self._loss, batch))
        names = ("loss", "policy_loss", "value_loss", "entropy", "clip_fraction", "approx_kl")
        means: dict[str, float] = dict(zip(names, torch.stack(logged).mean(0).tolist(), strict=True))
        returns = self._returns[self._live]
        means["explained_variance"] = (1 - (returns - values[self._live]).var() / returns.var()).item()
        means["std"] = self.policy.log_std.exp().mean().item()
        return means

    def _collect(self) -> Tensor:
        """Step all environments with the current policy, and compute returns and advantages.

        Generalized advantage estimation (Schulman et al., arXiv:1506.02438); a time limit is not a terminal state, so
        the critic's value of the last observation is added to the last reward.

        Returns:
            Values of the observations before the update, (T, R).
        """
        env, policy, gamma = self.env, self.policy, self.settings.gamma
        policy.set_training_mode(False)
        for t in range(self.settings.rollout):
            if policy.use_sde and t % self.settings.chosen_noise_steps == 0:
                policy.reset_noise(env.num_envs)
            self._observations[t] = self._tensor(self.observation)
            live: Any = slice(None)
            if env.live is not None:
                live = self._live[t] = self._tensor(env.live)
            with torch.no_grad():
                distribution = policy.get_distribution(self._observations[t, live])
                actions = distribution.get_actions()
                self._actions[t, live], self._log_probs[t, live] = actions, distribution.log_prob(actions)
            step = env.step_rows(self._actions[t].cpu().numpy())
            self._rewards[t], self._dones[t] = self._tensor(step.rewards), self._tensor(step.dones)
            if step.truncated.any():
                truncated = self._tensor(step.truncated)
                self._rewards[t, truncated] += gamma * self._values(self._tensor(step.last[step.truncated[step.dones]]))
            self.observation = step.rows
        return self._compute_returns_and_advantage()

    def _compute_returns_and_advantage(self) -> Tensor:
        gamma, values = self.settings.gamma, self._values(self._observations.flatten(0, 1)).view_as(self._rewards)
        next_value, advantage = self._values(self._tensor(self.observation)), torch.zeros_like(self._rewards[0])
        for t in reversed(range(len(values))):
            continues = 1 - self._dones[t]
            error = self._rewards[t] + gamma * continues * next_value - values[t]
            advantage = error + gamma * self.settings.gae_lambda * continues * advantage
            self._advantages[t] = advantage
            next_value = values[t]
        torch.add(self._advantages, values, out=self._returns)
        return values

    def _loss(
        self, policy: ActorCriticPolicy, seen: Tensor, actions: Tensor, old: Tensor, advantages: Tensor, returns: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the sum over rows of the clipped policy loss, value loss and entropy bonus, and what is logged."""
        settings, clip = self.settings, self.settings.clip_range
        values, log_prob, entropy = policy.evaluate_actions(seen, actions)
        change = log_prob - old
        ratio = change.exp()
        policy_loss = -torch.minimum(advantages * ratio, advantages * ratio.clamp(1 - clip, 1 + clip)).sum()
        value_loss = (returns - values.flatten()).square().sum()
        # The entropy of gSDE has no closed form; -log_prob is its estimate.
        bonus = (-log_prob if entropy is None else entropy).sum()
        total = policy_loss - settings.entropy * bonus + settings.value_weight * value_loss
        clipped, divergence = ((ratio - 1).abs() > clip).sum(), (ratio - 1 - change).sum()
        return total, torch.stack([total, policy_loss, value_loss, bonus, clipped, divergence])

    def minibatches(self, rows: Sequence[Tensor], size: int) -> Any:
        """Yield shuffled minibatches of rows, each row once."""
        for chosen in torch.randperm(len(rows[0])).to(self.policy.device).split(size):
            yield [tensor[chosen] for tensor in rows]

    def minimize(self, loss: Loss, batch: Sequence[Tensor]) -> Tensor:
        """Take a step of the optimizer on the mean loss of a minibatch; return the means of what the loss logs."""
        count, parameters = len(batch[0]), list(self.policy.parameters())
        learned = [parameter for parameter in parameters if parameter.requires_grad]

        def differentiate(block: slice) -> tuple[Tensor, tuple[Tensor, ...]]:
            total, logged = loss(self._copy_of_policy(), *(tensor[block] for tensor in batch))
            return logged.detach(), torch.autograd.grad(total / count, learned, allow_unused=True)

        logged, gradients = zip(*self._map(differentiate, count), strict=True)
        for parameter, *parts in zip(learned, *gradients, strict=True):
            parameter.grad = None if parts[0] is None else torch.stack(parts).sum(0)
        nn.utils.clip_grad_norm_(parameters, self.settings.gradient_max)
        self.policy.optimizer.step()
        return torch.stack(logged).sum(0) / count

    def _values(self, rows: Tensor) -> Tensor:
        """Return the critic's values of rows."""

        def value(block: slice) -> Tensor:
            with torch.no_grad():
                return self.policy.predict_values(rows[block]).flatten()

        return torch.cat(self._map(value, len(rows)))

    def _map(self, work: Callable[[slice], Any], rows: int) -> list[Any]:
        """Return the results of `work` for blocks of rows, in order; the pool computes all blocks but the first."""
        size = BLOCK if self._on_cpu else rows
        first, *others = [slice(begin, begin + size) for begin in range(0, rows, size)]
        futures = [self._pool.submit(work, block) for block in others]
        return [work(first), *(future.result() for future in futures)]

    def _copy_of_policy(self) -> ActorCriticPolicy:
        """Return the policy with the same weights and a distribution of its own, which stores the latest means."""
        own = copy.copy(self.policy)
        own.action_dist = copy.copy(self.policy.action_dist)
        return own

    def set_learning_rate(self, remaining: float) -> None:
        """Set the learning rate for the remaining fraction of the training."""
        fraction = _LAST_LEARNING_RATE + (1 - _LAST_LEARNING_RATE) * remaining
        for group in self.policy.optimizer.param_groups:
            group["lr"] = self.settings.learning_rate * fraction

    def set_noise(self, done: float) -> None:
        """Set the noise for the fraction of the training that is done, unless the settings let it be learned."""
        start, end = self.settings.log_std, self.settings.log_std_end
        if end is not None:
            with torch.no_grad():
                self.policy.log_std.fill_(start - max(start - end, 0.0) * min(done, 1.0))

    def _tensor(self, array: Any) -> Tensor:
        return torch.from_numpy(array).to(self.policy.device)

    def _layers(self) -> list[nn.Linear]:
        """Return the linear layers from the observation to the mean of the action."""
        modules = [*self.policy.mlp_extractor.policy_net, self.policy.action_net]
        return [layer for layer in modules if isinstance(layer, nn.Linear)]

    def network(self) -> Network:
        """Copy the policy, the mean of its action, as plain arrays."""
        return Network(
            tuple(layer.weight.detach().cpu().numpy().copy() for layer in self._layers()),
            tuple(layer.bias.detach().cpu().numpy().copy() for layer in self._layers()),
            self.settings.activation,
        )

    def start_from(self, network: Network) -> None:
        """Copy the weights of a network with the same layers into the policy."""
        with torch.no_grad():
            for layer, weight, bias in zip(self._layers(), network.weights, network.biases, strict=True):
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
                features = self.policy.mlp_extractor.forward_actor(self._tensor(self.observation))
                finite = bool(torch.isfinite(self.policy.action_net(features)).all())
        if not finite:
            raise ValueError(
                f"learning_rate must be low enough that weights and actions stay finite, got "
                f"{self.settings.learning_rate:g}: after {steps:,} steps they are not; the last checkpoint is intact"
            ) from cause

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy all that a resumed training needs: weights, optimizer, random generator, rows to act on next."""
        weights = {name: tensor.detach().cpu().numpy() for name, tensor in self.policy.state_dict().items()}
        arrays = prefixed("model", weights)
        for k, moments in self.policy.optimizer.state_dict()["state"].items():
            arrays |= prefixed(f"optimizer.{k}", {name: tensor.cpu().numpy() for name, tensor in moments.items()})
        arrays |= {"random": torch.get_rng_state().numpy(), "rows": np.asarray(self.observation)}
        return {name: np.array(array) for name, array in arrays.items()}

    def load_state(self, arrays: dict[str, np.ndarray]) -> None:
        """Resume from what `save_state` returned for the same settings."""
        weights = {name: torch.from_numpy(array) for name, array in within("model", arrays).items()}
        self.policy.load_state_dict(weights)
        optimizer = self.policy.optimizer.state_dict()
        for name, array in within("optimizer", arrays).items():
            k, moment = name.split(".")
            optimizer["state"].setdefault(int(k), {})[moment] = torch.from_numpy(array)
        self.policy.optimizer.load_state_dict(optimizer)
        torch.set_rng_state(torch.from_numpy(arrays["random"]))
        self.observation = arrays["rows"]
