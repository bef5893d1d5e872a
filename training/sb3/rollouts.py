"""Stable-Baselines3's PPO with the worlds' rollouts in tensors: its policy, loss and updates are the library's.

The library's own loop hands each step over as a list of a dictionary for each row, asks the critic for one row at a
time where an episode runs out of time, and picks minibatches by NumPy. With thousands of rows that takes as long as to
learn from them. What is learned is the same to rounding, for the same random numbers are drawn in the same order.
"""

from collections import deque
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.utils import explained_variance
from stable_baselines3.common.vec_env import VecEnv

from training.sb3.blocks import Blocks, Loss
from training.sb3.vec_env import RobotVecEnv

RanOut = tuple[int, torch.Tensor, torch.Tensor]
"""Step in which the time of some rows ran out, which they were, and what they saw last."""


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

    def store(self, rows: torch.Tensor, actions: torch.Tensor, log_probs: torch.Tensor, starts: np.ndarray) -> None:
        """Store what was seen and done in a step; `starts` says which rows are the first of an episode."""
        self._seen[self.pos].copy_(rows)
        self._taken[self.pos].copy_(actions)
        self._log_probs[self.pos].copy_(log_probs)
        self._starts[self.pos].copy_(torch.from_numpy(starts))

    def reward(self, rewards: np.ndarray) -> None:
        """Store what the step earned, which ends it."""
        self._rewards[self.pos].copy_(torch.from_numpy(rewards))
        self.pos += 1
        self.full = self.pos == self.buffer_size

    def judge(self, blocks: Blocks, last: torch.Tensor, dones: np.ndarray, ran_out: Sequence[RanOut]) -> None:
        """Let the critic say what it expected, and compute advantages and returns.

        Generalized advantage estimate and lambda-returns (Schulman et al., arXiv:1506.02438).

        Args:
            blocks: The policy, whose critic it is.
            last: Rows after the last step.
            dones: Whether an episode of a row ended with the last step.
            ran_out: Rows whose time ran out: they earn, besides their reward, what is expected after the last of them.
        """
        self._values.copy_(blocks.values(self._seen.flatten(0, 1)).view_as(self._values))
        if ran_out:
            expected = blocks.values(torch.cat([rows for _, _, rows in ran_out]))
            counts = [len(rows) for _, _, rows in ran_out]
            for (t, mask, _), values in zip(ran_out, expected.split(counts), strict=True):
                self._rewards[t, mask] += self.gamma * values
        goes_on = 1.0 - torch.as_tensor(dones, device=self.device, dtype=torch.float32)
        after, advantage = blocks.values(last), torch.zeros(self.n_envs, device=self.device)
        for t in reversed(range(self.buffer_size)):
            surprise = self._rewards[t] + self.gamma * goes_on * after - self._values[t]
            advantage = surprise + self.gamma * self.gae_lambda * goes_on * advantage
            self._advantages[t] = advantage
            goes_on, after = 1.0 - self._starts[t], self._values[t]
        torch.add(self._advantages, self._values, out=self._returns)

    @property
    def tensors(self) -> list[torch.Tensor]:
        """(T rows, ...) seen, done, logarithms of its probability, advantages, returns."""
        stored = (self._seen, self._taken, self._log_probs, self._advantages, self._returns)
        return [tensor.flatten(0, 1) for tensor in stored]

    def draw(self, batch_size: int) -> Sequence[torch.Tensor]:
        """Minibatches of a pass over all rows, as indices, in the order in which the library's buffer draws them."""
        drawn = torch.from_numpy(np.random.permutation(self.buffer_size * self.n_envs))
        # The library lists the steps of a row one after the other, here the rows of a step are.
        return (drawn % self.buffer_size * self.n_envs + drawn // self.buffer_size).to(self.device).split(batch_size)

    @property
    def explained(self) -> float:
        """Share of the variance of the returns that the critic explains."""
        return explained_variance(self._values.flatten().cpu().numpy(), self._returns.flatten().cpu().numpy())


class RobotPPO(PPO):
    """PPO over the rows of a `RobotVecEnv`."""

    def __init__(self, policy: str | type[ActorCriticPolicy], env: RobotVecEnv, threads: int = 1, **more: Any):
        super().__init__(policy, env, rollout_buffer_class=Rollouts, **more)
        self.blocks = Blocks(self.policy, threads)
        self.told: dict[str, float] = {}
        """Means of the latest update, under the library's names."""

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Fill the buffer with steps of the present policy; whether the callback lets learning go on."""
        assert isinstance(env, RobotVecEnv)
        assert isinstance(rollout_buffer, Rollouts)
        policy = self.policy
        policy.set_training_mode(False)
        rollout_buffer.reset()
        if self.use_sde:
            policy.reset_noise(env.num_envs)
        callback.on_rollout_start()
        rows, dones = np.asarray(self._last_obs), np.asarray(self._last_episode_starts)
        ran_out: list[RanOut] = []
        for step in range(n_rollout_steps):
            if self.use_sde and self.sde_sample_freq > 0 and step % self.sde_sample_freq == 0:
                policy.reset_noise(env.num_envs)
            seen = self._as_tensor(rows)
            with torch.no_grad():
                distribution = policy.get_distribution(seen)
                actions = distribution.get_actions()
                rollout_buffer.store(seen, actions, distribution.log_prob(actions), dones)
            after = env.step_rows(actions.cpu().numpy())
            rollout_buffer.reward(after.rewards)
            cast(deque, self.ep_info_buffer).extend(after.episodes.values())
            self.num_timesteps += env.num_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            if after.truncated.any():
                mask = torch.from_numpy(after.truncated).to(self.device)
                ran_out.append((step, mask, self._as_tensor(after.last[after.truncated[after.dones]])))
            rows, dones = after.rows, after.dones
            self._last_obs, self._last_episode_starts = rows, dones
        rollout_buffer.judge(self.blocks, self._as_tensor(rows), dones, ran_out)
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    def train(self) -> None:
        """Update the policy by the library's loss over the buffer, block by block."""
        policy, buffer = self.policy, cast(Rollouts, self.rollout_buffer)
        policy.set_training_mode(True)
        self._update_learning_rate(policy.optimizer)
        told, tensors = [], buffer.tensors
        for _ in range(self.n_epochs):
            for chosen in buffer.draw(self.batch_size):
                told.append(self.blocks.differentiate(self._loss(tensors[3][chosen]), tensors, chosen))
                torch.nn.utils.clip_grad_norm_(self.blocks.parameters, self.max_grad_norm)
                policy.optimizer.step()
            self._n_updates += 1
        self._record(torch.stack(told).cpu())

    def _loss(self, advantages: torch.Tensor) -> Loss:
        """Loss of the rows of these advantages, as `PPO.train` has it: of the clipped policy, the critic, entropy."""
        clip = self.clip_range(self._current_progress_remaining)  # type: ignore[operator]
        count = len(advantages)
        middle, spread = (advantages.mean(), advantages.std() + 1e-8) if count > 1 else (0.0, 1.0)

        def loss(policy: ActorCriticPolicy, rows: Sequence[torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
            seen, taken, log_prob_then, advantage, returns = rows
            values, log_prob, entropy = policy.evaluate_actions(seen, taken)
            gain, change = (advantage - middle) / spread, log_prob - log_prob_then
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
        self.told = dict(zip(names, told.mean(0).tolist(), strict=True))
        self.told["explained_variance"] = cast(Rollouts, self.rollout_buffer).explained
        self.told["std"] = self.policy.log_std.exp().mean().item()
        for name, value in self.told.items():
            self.logger.record(f"train/{name}", value)

    def _as_tensor(self, rows: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(rows).to(self.device)
