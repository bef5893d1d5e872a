"""`lissajous train`: trains a policy, shows how it does, and can be stopped at any moment and called again."""

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import numpy as np
import torch
from rich.console import Console
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from stable_baselines3.common.policies import ActorCriticPolicy
from torch.utils.tensorboard.writer import SummaryWriter

import baselines
from lissajous_env.files import locked, remove_leftovers
from training import checkpoint, imitation, sb3
from training.network import Network
from training.settings import Train
from training.trainer import Course, Trainer, summarize_scores


def train(settings: Train, console: Console | None = None) -> Course:
    """Train to the end, from the last checkpoint where `settings.out` has one.

    Raises:
        ValueError: a folder that holds the results of other settings, or is in use by another process.
        KeyboardInterrupt: Ctrl-C; everything up to then is in the checkpoint.
    """
    settings.out.mkdir(parents=True, exist_ok=True)
    with locked(settings.out):
        remove_leftovers(settings.out)
        return Sb3Trainer(settings, console or Console()).run()


class Sb3Trainer(Trainer):
    """A training by Stable-Baselines3: model and worlds, made anew or as the last checkpoint has them."""

    def __init__(self, settings: Train, console: Console):
        super().__init__(settings, console)
        threads = settings.threads or torch.get_num_threads()
        torch.set_num_threads(threads)
        penalty = settings.residual_penalty if settings.base else 0.0
        self.env = sb3.RobotVecEnv(
            self.scenario,
            settings.worlds,
            self.card,
            penalty,
            settings.device,
            threads=threads,
            central=settings.critic == "world",
            short=settings.short,
            short_time=settings.short_time,
        )
        self.model = sb3.make_ppo(settings, self.env, self.card)
        self.average: dict[str, np.ndarray] | None = None
        self.teacher = None
        if settings.imitated is not None:
            self.teacher = baselines.make(settings.imitated, self.scenario, settings.worlds, settings.device)
        if (settings.out / checkpoint.FILE).exists():
            self._go_on()
        elif (network := self._network_to_start_from()) is not None:
            sb3.from_network(self.model, network)

    def network(self) -> Network:
        """Copy the policy that has been learned so far."""
        learned = sb3.to_network(self.model, self.settings.activation)
        return learned if self.average is None else Network.from_arrays(self.average, learned.activation)

    def average_in(self) -> None:
        """Add the weights as they are to their average."""
        kept, learned = self.settings.averaging, sb3.to_network(self.model, self.settings.activation).to_arrays()
        if kept > 0:
            before = self.average or learned
            self.average = {
                name: (kept * before[name] + (1 - kept) * array).astype(np.float32) for name, array in learned.items()
            }

    def save(self) -> None:
        """Write a checkpoint; a run that goes on from it does bit for bit what this one does."""
        state = sb3.save_model(self.model) | self.env.save_state()
        if self.teacher is not None:
            state |= {f"teacher.{name}": array for name, array in self.teacher.save_state().items()}
        state |= {f"average.{name}": array for name, array in (self.average or {}).items()}
        checkpoint.save(self.settings.out, self.network(), self.card, state=state, notes=self._notes())

    def observe_rollout(self, extra: dict[str, float] | None = None) -> None:
        """Show and log how the latest episodes went."""
        recent = summarize_scores(self.env.scores) if self.env.scores else {}
        evaluated = self.course.curve[-1] if self.course.curve else {}
        logged = {f"rollout/{name}": value for name, value in recent.items()} | {
            f"evaluation/{name}": value for name, value in evaluated.items() if name not in ("steps", "seconds")
        }
        for name, value in (logged | (extra or {})).items():
            if value is not None:
                self.model.logger.record(name, value)
        self.display.update(recent)

    def _learn(self) -> None:
        with _logging_to(self.settings.out / "tensorboard", self.course.steps) as logger:
            self.model.set_logger(logger)
            if self.teacher is not None:
                imitation.imitate(self, self.teacher)
            left = self.settings.steps - self.course.steps
            if left > 0:
                # The model counts on from the steps that it has.
                first = self.model._last_obs is None
                try:
                    self.model.learn(left, callback=_Watch(self), reset_num_timesteps=first)
                except ValueError as error:
                    sb3.require_finite(self.model, self.settings, self.course.steps, error)
                    raise
                sb3.require_finite(self.model, self.settings, self.course.steps)

    def _go_on(self) -> None:
        _, card, text = checkpoint.read(self.settings.out)
        self._check_same(card.settings)
        arrays = checkpoint.read_state(self.settings.out, text)
        self.course = Course(**text["counters"], curve=text["curve"], rivals=text["rivals"])
        self.env.load_state(arrays)
        if self.teacher is not None:
            self.teacher.load_state(sb3.named("teacher.", arrays))
        self.average = sb3.named("average.", arrays) or None
        sb3.load_model(self.model, arrays, self.course.steps, self.course.updates)


class _Watch(BaseCallback):
    """Keeps the course while Stable-Baselines3 learns: counts, shows, evaluates, stops."""

    def __init__(self, trainer: Sb3Trainer):
        super().__init__()
        self.trainer = trainer
        self._since = time.monotonic()

    def _on_rollout_start(self) -> None:
        # The one moment between an update and the next step: what is saved here is all there is.
        trainer = self.trainer
        sb3.require_finite(self.model, trainer.settings, trainer.course.steps)
        if self.model._n_updates > trainer.course.updates:
            trainer.average_in()
        trainer.course.updates = self.model._n_updates
        if trainer.due():
            self._count_time()
            trainer.evaluate_and_save()
            self._since = time.monotonic()
        trainer.stop_if_asked()
        if self.model.use_sde:
            # The noise has been drawn before this moment: draw it anew, from what a run that goes on knows too.
            torch.manual_seed(trainer.settings.seed << 40 | trainer.course.steps)
            cast(ActorCriticPolicy, self.model.policy).reset_noise(trainer.env.num_envs)

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        trainer = self.trainer
        self._count_time()
        settings, policy = trainer.settings, self.model.policy
        # An update follows: of the critic alone, as long as the settings say.
        both = trainer.course.steps >= settings.imitated_until + settings.critic_steps
        for name, parameter in policy.named_parameters():
            parameter.requires_grad_(both or name in sb3.critic_parameters(policy))
        trainer.course.steps = self.model.num_timesteps
        trainer.observe_rollout()

    def _on_training_end(self) -> None:
        self._count_time()
        self.trainer.average_in()
        self.trainer.course.updates = self.model._n_updates

    def _count_time(self) -> None:
        now = time.monotonic()
        self.trainer.course.seconds += now - self._since
        self._since = now


@contextlib.contextmanager
def _logging_to(folder: Path, steps: int) -> Iterator[Logger]:
    """Log to TensorBoard; what an earlier process logged after its last checkpoint is taken back."""
    if steps:
        SummaryWriter(str(folder), purge_step=steps + 1).close()
    logger = Logger(str(folder), [TensorBoardOutputFormat(str(folder))])
    try:
        yield logger
    finally:
        logger.close()
