"""Imitation of a classical policy in the states that the student reaches (DAgger).

S. Ross, G. J. Gordon, J. A. Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning" (AISTATS 2011). The teacher drives all worlds at first, linearly fewer over the first half, then none; the
student learns the teacher's action in every visited state.

Differs from the paper: states are not aggregated over rounds. A round of the batch has enough states to learn from, and
a resumed training needs to restore nothing but the worlds.
"""

import numpy as np
import torch

import baselines
from training.sb3.ppo import RobotPPO
from training.sb3.vec_env import RobotVecEnv

BATCH, PASSES = 1024, 4
"""Rows per minibatch, and passes over each rollout."""


def imitate(model: RobotPPO, env: RobotVecEnv, teacher: baselines.Policy, done: float) -> float:
    """Fit the policy to the teacher's actions in one rollout, by least squares.

    Args:
        model: Student.
        env: Environments of the student.
        teacher: Policy for as many worlds.
        done: Fraction of the imitation that is done.

    Returns:
        Mean squared error of the last pass.
    """
    rows, wanted = _collect(model, env, teacher, max(0.0, 1.0 - 2.0 * done))
    model.set_learning_rate(1.0 - done)
    model.policy.set_training_mode(True)
    errors = []
    for _ in range(PASSES):
        errors = []
        for chosen in torch.randperm(len(rows)).to(rows.device).split(BATCH):
            mean = model.policy.get_distribution(rows[chosen]).mode()
            error = (mean - wanted[chosen]).square().mean()
            model.minimize(error)
            errors.append(error.item())
    return float(np.mean(errors))


def _collect(
    model: RobotPPO, env: RobotVecEnv, teacher: baselines.Policy, share: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the rows (K, inputs) that a rollout visits, and the teacher's action in each (K, action_size).

    The teacher drives a share of the worlds, the first ones, and the student the others.
    """
    worlds, n, _ = env.simulation.action_shape
    taught = np.repeat(np.arange(worlds) < share * worlds, n)[:, None]
    rows, wanted = [], []
    for _ in range(model.n_steps):
        shown = teacher.act(env.simulation.observation.numpy()).reshape(env.num_envs, -1)
        rows.append(torch.from_numpy(model.rows))
        wanted.append(torch.from_numpy(shown))
        own, _ = model.policy.predict(model.rows, deterministic=True)  # type: ignore[arg-type]
        rows_after, _, dones, _ = env.step(np.where(taught, shown, own))
        assert isinstance(rows_after, np.ndarray)
        model.rows = rows_after
        if dones.any():
            teacher.reset(dones.reshape(worlds, n).all(axis=1))
    return torch.cat(rows).to(model.device), torch.cat(wanted).to(model.device)
