"""Imitation of a classical policy: in the states that it reaches (cloning), or that the student reaches (DAgger).

S. Ross, G. J. Gordon, J. A. Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning" (AISTATS 2011). With DAgger the teacher drives all worlds at first, fewer and fewer of them over the first
half, then none; in every state that is met, its action is asked for.

Differs from the paper: states are not aggregated over rounds. A round of the batch holds so many that each learns from
fresh ones alone, and nothing but the worlds has to be kept to go on.
"""

from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO

import baselines
from training.sb3.vec_env import RobotVecEnv
from training.settings import TrainingSettings


def taught_share(settings: TrainingSettings, steps: int) -> float:
    """Share of the worlds that the teacher drives after some steps of a robot."""
    return max(0.0, 1.0 - 2.0 * steps / settings.imitated_until) if settings.student_drives else 1.0


def collect(
    env: RobotVecEnv, model: PPO, teacher: baselines.Policy, share: float, steps: int
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
        after, _, dones, _ = env.step(np.where(taught, shown, own))
        model._last_obs, model._last_episode_starts = np.asarray(after), dones
        if dones.any():
            teacher.reset(dones.reshape(worlds, n).all(axis=1))
    return torch.cat(rows), torch.cat(wanted)


def fit(policy: Any, settings: TrainingSettings, rows: torch.Tensor, wanted: torch.Tensor) -> float:
    """Pass over the rows in minibatches; returns the mean squared error of the last pass."""
    policy.set_training_mode(True)
    rows, wanted = rows.to(policy.device), wanted.to(policy.device)
    losses = []
    for _ in range(settings.epochs):
        losses = []
        for chosen in torch.from_numpy(np.random.permutation(len(rows))).split(settings.batch_size):
            error = policy.get_distribution(rows[chosen]).mode() - wanted[chosen]
            loss = error.square().mean()
            policy.optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(policy.parameters(), settings.gradient_max)
            policy.optimizer.step()
            losses.append(loss.item())
    return float(np.mean(losses))
