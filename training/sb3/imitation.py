"""Imitation of a classical policy: in the states that it reaches (cloning), or that the student reaches (DAgger).

S. Ross, G. J. Gordon, J. A. Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning" (AISTATS 2011). With DAgger the teacher drives all worlds at first, fewer and fewer of them over the first
half, then none; in every state that is met, its action is asked for.

Differs from the paper: states are not aggregated over rounds. A round of the batch holds so many that each learns from
fresh ones alone, and nothing but the worlds has to be kept to go on.
"""

from collections.abc import Sequence

import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy

import baselines
from training.sb3.blocks import Loss
from training.sb3.rollouts import RobotPPO
from training.sb3.vec_env import RobotVecEnv
from training.settings import TrainingSettings


def taught_share(settings: TrainingSettings, steps: int) -> float:
    """Share of the worlds that the teacher drives after some steps of a robot."""
    return max(0.0, 1.0 - 2.0 * steps / settings.imitated_until) if settings.student_drives else 1.0


def collect(
    env: RobotVecEnv, model: RobotPPO, teacher: baselines.Policy, share: float, steps: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Play on from the model's latest rows.

    Args:
        env: Worlds.
        model: Student, which drives where the teacher does not.
        teacher: Policy for as many worlds.
        share: Share of the worlds, the first ones, that the teacher drives.
        steps: How long.

    Returns:
        Rows that were met (K, inputs), and the teacher's action in each (K, action_size).
    """
    worlds, n, _ = env.simulation.action_shape
    taught = np.repeat(np.arange(worlds) < share * worlds, n)[:, None]
    rows, wanted = [], []
    for _ in range(steps):
        shown = teacher.act(env.simulation.observation.numpy()).reshape(env.num_envs, -1)
        met = np.asarray(model._last_obs)
        rows.append(torch.from_numpy(met))
        wanted.append(torch.from_numpy(shown))
        own, _ = model.predict(met, deterministic=True)
        after = env.step_rows(np.where(taught, shown, own))
        model._last_obs, model._last_episode_starts = after.rows, after.dones
        if after.dones.any():
            teacher.reset(after.dones.reshape(worlds, n).all(axis=1))
    return torch.cat(rows), torch.cat(wanted)


def fit(model: RobotPPO, settings: TrainingSettings, rows: torch.Tensor, wanted: torch.Tensor) -> float:
    """Pass over the rows in minibatches; returns the mean squared error of the last pass."""
    policy = model.policy
    policy.set_training_mode(True)
    rows, wanted = rows.to(policy.device), wanted.to(policy.device)
    losses = []
    for _ in range(settings.imitation_epochs):
        losses = []
        drawn = torch.from_numpy(np.random.permutation(len(rows))).to(policy.device)
        for chosen in drawn.split(settings.imitation_batch):
            losses.append(model.blocks.differentiate(_squared_error(len(chosen)), (rows, wanted), chosen))
            torch.nn.utils.clip_grad_norm_(model.blocks.parameters, settings.gradient_max)
            policy.optimizer.step()
    return torch.stack(losses).mean().item()


def _squared_error(count: int) -> Loss:
    """Mean squared error over a number of rows, by block."""

    def loss(policy: ActorCriticPolicy, rows: Sequence[torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
        met, wanted = rows
        total = (policy.get_distribution(met).mode() - wanted).square().mean(1).sum() / count
        return total, total

    return loss
