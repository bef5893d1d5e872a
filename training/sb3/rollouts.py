"""Stable-Baselines3's PPO with the worlds' rollouts in tensors: its policy, loss and updates are the library's.

The library's own loop hands each step over as a list of a dictionary for each row, asks the critic for one row at a
time where an episode runs out of time, and picks minibatches by NumPy. With thousands of rows that takes as long as to
learn from them. What is learned is the same to rounding, for the same random numbers are drawn in the same order.
"""

from collections.abc import Generator, Sequence
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.type_aliases import RolloutBufferSamples
from stable_baselines3.common.utils import explained_variance
from stable_baselines3.common.vec_env import VecEnv

from training.sb3.blocks import Blocks, Loss
from training.sb3.vec_env import RobotVecEnv


class Rollouts(RolloutBuffer):
    """`RolloutBuffer` whose arrays are tensors (T, rows, ...) on the model's device, made once."""

    def __init__(self, *args: Any, **more: Any):
        super().__init__(*args, **more)

        def tensor(*size: int) -> torch.Tensor:
            return torch.zeros((self.buffer_size, self.n_envs, *size), device=self.device)

        self._seen, self._taken = tensor(*cast(tuple, self.obs_shape)), tensor(self.action_dim)
        self._rewards, self._starts, self._values, self._log_probs = tensor(), tensor(), tensor(), tensor()
        self._advantages, self._returns = tensor(), tensor()

    def reset(self) -> None:
        """Begin again; what is stored is overwritten."""
        self.pos, self.full = 0, False

    def add(self, obs: Any, action: Any, reward: Any, episode_start: Any, value: Any, log_prob: Any) -> None:
        """Store a step, arrays or tensors; `episode_start` says which rows are the first of an episode."""
        step = (obs, action, reward, episode_start, value, log_prob)
        stored = (self._seen, self._taken, self._rewards, self._starts, self._values, self._log_probs)
        for given, tensor in zip(step, stored, strict=True):
            tensor[self.pos].copy_(torch.as_tensor(given).view_as(tensor[self.pos]))
        self.pos += 1
        self.full = self.pos == self.buffer_size

    def compute_returns_and_advantage(self, last_values: torch.Tensor, dones: np.ndarray) -> None:
        """Generalized advantage estimate and lambda-returns (Schulman et al., arXiv:1506.02438).

        Args:
            last_values: Value of each row after the last step.
            dones: Whether an episode of a row ended with the last step.
        """
        goes_on = 1.0 - torch.as_tensor(dones, device=self.device, dtype=torch.float32)
        after, advantage = last_values.flatten(), torch.zeros(self.n_envs, device=self.device)
        for t in reversed(range(self.buffer_size)):
            surprise = self._rewards[t] + self.gamma * goes_on * after - self._values[t]
            advantage = surprise + self.gamma * self.gae_lambda * goes_on * advantage
            self._advantages[t] = advantage
            goes_on, after = 1.0 - self._starts[t], self._values[t]
        torch.add(self._advantages, self._values, out=self._returns)
        # The library says by NumPy how much of the returns the critic explains.
        self.values, self.returns = self._values.cpu().numpy(), self._returns.cpu().numpy()

    def get(self, batch_size: int | None = None) -> Generator[RolloutBufferSamples, None, None]:
        """Pass over all rows in minibatches, in the order in which the library's own buffer draws them."""
        rows = self.buffer_size * self.n_envs
        drawn = torch.from_numpy(np.random.permutation(rows))
        # The library lists the steps of a row one after the other, here the rows of a step are.
        drawn = (drawn % self.buffer_size * self.n_envs + drawn // self.buffer_size).to(self.device)
        stored = (self._seen, self._taken, self._values, self._log_probs, self._advantages, self._returns)
        flat = [tensor.flatten(0, 1) for tensor in stored]
        for chosen in drawn.split(batch_size or rows):
            yield RolloutBufferSamples(*(tensor.index_select(0, chosen) for tensor in flat))


class RobotPPO(PPO):
    """PPO over the rows of a `RobotVecEnv`."""

    def __init__(self, policy: str | type[ActorCriticPolicy], env: RobotVecEnv, threads: int = 1, **more: Any):
        super().__init__(policy, env, rollout_buffer_class=Rollouts, **more)
        self.blocks = Blocks(self.policy, threads)

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Fill the buffer with steps of the present policy; whether the callback lets learning go on.

        A row that ran out of time earns, besides its reward, what the critic expects after its last observation.
        """
        assert isinstance(env, RobotVecEnv)
        policy = self.policy
        policy.set_training_mode(False)
        rollout_buffer.reset()
        if self.use_sde:
            policy.reset_noise(env.num_envs)
        callback.on_rollout_start()
        rows, dones = np.asarray(self._last_obs), np.asarray(self._last_episode_starts)
        for step in range(n_rollout_steps):
            if self.use_sde and self.sde_sample_freq > 0 and step % self.sde_sample_freq == 0:
                policy.reset_noise(env.num_envs)
            with torch.no_grad():
                actions, values, log_probs = policy(self._as_tensor(rows))
            after = env.step_rows(actions.cpu().numpy())
            self.num_timesteps += env.num_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            rewards = after.rewards
            if after.truncated.any():
                with torch.no_grad():
                    expected = policy.predict_values(self._as_tensor(after.last[after.truncated]))
                rewards[after.truncated] += self.gamma * expected.flatten().cpu().numpy()
            rollout_buffer.add(rows, actions, rewards, dones, values, log_probs)
            rows, dones = after.rows, after.dones
            self._last_obs, self._last_episode_starts = rows, dones
        with torch.no_grad():
            values = policy.predict_values(self._as_tensor(rows))
        rollout_buffer.compute_returns_and_advantage(values, dones)
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    def train(self) -> None:
        """Update the policy by the library's loss over the buffer, block by block."""
        policy = self.policy
        policy.set_training_mode(True)
        self._update_learning_rate(policy.optimizer)
        told = []
        for _ in range(self.n_epochs):
            for batch in self.rollout_buffer.get(self.batch_size):
                told.append(self.blocks.differentiate(self._loss_of(batch), batch[:6]))
                torch.nn.utils.clip_grad_norm_(policy.parameters(), self.max_grad_norm)
                policy.optimizer.step()
            self._n_updates += 1
        self._record(torch.stack(told).cpu())

    def _loss_of(self, batch: RolloutBufferSamples) -> Loss:
        """Loss of a minibatch, as `PPO.train` has it: of the policy, clipped, of the critic, and of the entropy."""
        clip = self.clip_range(self._current_progress_remaining)  # type: ignore[operator]
        count = len(batch.advantages)
        middle, spread = (batch.advantages.mean(), batch.advantages.std() + 1e-8) if count > 1 else (0.0, 1.0)

        def loss(policy: ActorCriticPolicy, rows: Sequence[torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
            observations, actions, _, old_log_prob, advantages, returns = rows
            values, log_prob, entropy = policy.evaluate_actions(observations, actions)
            gain, change = (advantages - middle) / spread, log_prob - old_log_prob
            ratio = change.exp()
            of_policy = -torch.minimum(gain * ratio, gain * ratio.clamp(1 - clip, 1 + clip)).sum()
            of_values = (returns - values.flatten()).square().sum()
            of_entropy = log_prob.sum() if entropy is None else -entropy.sum()
            total = of_policy + self.ent_coef * of_entropy + self.vf_coef * of_values
            with torch.no_grad():
                clipped, divergence = ((ratio - 1).abs() > clip).sum(), (ratio - 1 - change).sum()
                numbers = torch.stack([total, of_policy, of_values, of_entropy, clipped, divergence]) / count
            return total / count, numbers

        return loss

    def _record(self, told: torch.Tensor) -> None:
        """Log the means over the updates, under the library's names."""
        names = ("loss", "policy_gradient_loss", "value_loss", "entropy_loss", "clip_fraction", "approx_kl")
        for name, value in zip(names, told.mean(0).tolist(), strict=True):
            self.logger.record(f"train/{name}", value)
        buffer, policy = self.rollout_buffer, self.policy
        explained = explained_variance(buffer.values.flatten(), buffer.returns.flatten())
        self.logger.record("train/explained_variance", explained)
        self.logger.record("train/std", policy.log_std.exp().mean().item())

    def _as_tensor(self, rows: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(rows).to(self.device)
