"""Imitation of a classical policy in the states that it reaches (cloning), or that the student reaches (DAgger).

S. Ross, G. J. Gordon, J. A. Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning" (AISTATS 2011). With DAgger the teacher drives all worlds at first, linearly fewer over the first half, then
none; the student learns the teacher's action in every visited state.

Differs from the paper: states are not aggregated over rounds. A round of the batch has enough states to learn from, and
a resumed training needs to restore nothing but the worlds.
"""

import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy

import baselines
from training.sb3.ppo import RobotPPO
from training.sb3.vec_env import RobotVecEnv
from training.settings import TrainingSettings


def taught_share(settings: TrainingSettings, steps: int) -> float:
    """Return the fraction of the worlds that the teacher drives after some robot steps."""
    return max(0.0, 1.0 - 2.0 * steps / settings.imitated_until) if settings.student_drives else 1.0


def collect(
    env: RobotVecEnv, model: RobotPPO, teacher: baselines.Policy, share: float, steps: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Step the environments from the model's latest rows.

    Args:
        env: Environments.
        model: Student, which drives where the teacher does not.
        teacher: Policy for as many worlds.
        share: Fraction of the worlds, the first ones, that the teacher drives.
        steps: Number of steps.

    Returns:
        Visited rows (K, inputs), and the teacher's action in each (K, action_size).
    """
    worlds, n, _ = env.simulation.action_shape
    taught = np.repeat(np.arange(worlds) < share * worlds, n)[:, None]
    rows, wanted = [], []
    for _ in range(steps):
        shown = teacher.act(env.simulation.observation.numpy()).reshape(env.num_envs, -1)
        rows.append(torch.from_numpy(model.observation))
        wanted.append(torch.from_numpy(shown))
        own, _ = model.policy.predict(model.observation, deterministic=True)
        after = env.step_rows(np.where(taught, shown, own))
        model.observation = after.rows
        if after.dones.any():
            teacher.reset(after.dones.reshape(worlds, n).all(axis=1))
    return torch.cat(rows), torch.cat(wanted)


def fit(model: RobotPPO, rows: torch.Tensor, wanted: torch.Tensor) -> float:
    """Fit the policy to the wanted actions in minibatches; return the mean squared error of the last pass."""
    settings, policy = model.settings, model.policy
    policy.set_training_mode(True)
    data = [rows.to(policy.device), wanted.to(policy.device)]
    losses = []
    for _ in range(settings.imitation_epochs):
        losses = [model.minimize(_squared_error, batch) for batch in model.minibatches(data, settings.imitation_batch)]
    return torch.stack(losses).mean().item()


def _squared_error(
    policy: ActorCriticPolicy, rows: torch.Tensor, wanted: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the sum over rows of the squared error, mean over the components of an action, twice."""
    total = (policy.get_distribution(rows).mode() - wanted).square().mean(1).sum()
    return total, total
