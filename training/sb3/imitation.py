"""Imitation of a classical policy: in the states that it reaches (cloning), or that the student reaches (DAgger).

S. Ross, G. J. Gordon, J. A. Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning" (AISTATS 2011). With DAgger the teacher drives all worlds at first, fewer and fewer of them over the first
half, then none; in every state that is met, its action is asked for.

Differs from the paper: states are not aggregated over rounds. A round of the batch holds so many that each learns from
fresh ones alone, and nothing but the worlds has to be kept to go on.
"""

import time
from typing import TYPE_CHECKING

import numpy as np
import torch

import baselines
from training.sb3 import ppo

if TYPE_CHECKING:
    from training.sb3.learning import Sb3Trainer


def imitate(trainer: "Sb3Trainer", teacher: baselines.Policy) -> None:
    """Let the model of a trainer learn the teacher's action, by least squares, as long as the settings say."""
    settings, env, model, course = trainer.settings, trainer.env, trainer.model, trainer.course
    if model._last_obs is None:
        model._last_obs = np.asarray(env.reset())
        model._last_episode_starts = np.ones(env.num_envs, dtype=bool)
    while course.steps < (until := settings.imitated_until):
        if trainer.due():
            trainer.evaluate_and_save()
        trainer.stop_if_asked()
        began = time.monotonic()
        model._update_current_progress_remaining(course.steps, until)
        model._update_learning_rate(model.policy.optimizer)
        taught_share = max(0.0, 1.0 - 2.0 * course.steps / until) if settings.student_drives else 1.0
        try:
            rows, wanted = _collect(trainer, teacher, taught_share)
            loss = _fit(trainer, rows, wanted)
        except ValueError as error:
            ppo.require_finite(model, settings, course.steps, error)
            raise
        ppo.require_finite(model, settings, course.steps)
        course.steps += settings.rollout * env.num_envs
        course.updates += settings.epochs
        course.seconds += time.monotonic() - began
        model.num_timesteps, model._n_updates = course.steps, course.updates
        trainer.observe_rollout({"imitation/error": loss})
        model.logger.dump(course.steps)


def _collect(
    trainer: "Sb3Trainer", teacher: baselines.Policy, taught_share: float
) -> tuple[torch.Tensor, torch.Tensor]:
    """Play a rollout; return the rows that were met (K, inputs) and the teacher's action in each (K, action_size)."""
    env, model = trainer.env, trainer.model
    worlds, n, _ = env.simulation.action_shape
    taught = np.repeat(np.arange(worlds) < taught_share * worlds, n)[:, None]
    rows, wanted = [], []
    for _ in range(trainer.settings.rollout):
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


def _fit(trainer: "Sb3Trainer", rows: torch.Tensor, wanted: torch.Tensor) -> float:
    """Pass over the rows in minibatches; returns the mean squared error of the last pass."""
    settings, policy = trainer.settings, trainer.model.policy
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
