"""`lissajous train`: trains a policy, shows how it does, and can be stopped at any moment and called again."""

import contextlib
import math
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from torch.utils.tensorboard.writer import SummaryWriter

import baselines
from baselines.statistics import interquartile_mean
from lissajous_env import evaluate
from lissajous_env.files import locked, remove_leftovers
from training import checkpoint, imitation, sb3
from training.checkpoint import Card
from training.display import Display
from training.learned import Learned, find
from training.pictures import draw_curve
from training.settings import Train

FIRST_EVALUATION_SEED = 20_000


@dataclass
class Course:
    """How a training has gone so far: written into each checkpoint, and read again to go on."""

    steps: int = 0
    """Steps of a robot."""
    updates: int = 0
    """Passes over rollouts."""
    seconds: float = 0.0
    """Time that it took, evaluations left out [s]."""
    curve: list[dict[str, Any]] = field(default_factory=list)
    """Evaluations, in order: steps, seconds, detection_time [s], collisions, return, detected_fraction."""
    rivals: dict[str, dict[str, Any]] = field(default_factory=dict)
    """The same of the policies that it is compared with."""


def train(settings: Train, console: Console | None = None) -> Course:
    """Train to the end, from the last checkpoint where `settings.out` has one.

    Raises:
        ValueError: a folder that holds the results of other settings, or is in use by another process.
        KeyboardInterrupt: Ctrl-C; everything up to then is in the checkpoint.
    """
    console = console or Console()
    if settings.engine == "ray":
        from training import rllib

        return rllib.train(settings, console)
    settings.out.mkdir(parents=True, exist_ok=True)
    with locked(settings.out):
        remove_leftovers(settings.out)
        return Trainer(settings, console).run()


class Trainer:
    """One training in its folder: model and worlds, made anew or as the last checkpoint has them."""

    def __init__(self, settings: Train, console: Console):
        self.settings, self.console = settings, console
        self.scenario = settings.make_scenario()
        self.card = Card.of(
            self.scenario,
            settings.inputs,
            base=settings.base,
            residual=settings.residual if settings.base else 1.0,
            settings=settings.to_dict(),
        )
        threads = settings.threads or torch.get_num_threads()
        torch.set_num_threads(threads)
        self.env = sb3.RobotVecEnv(self.scenario, settings.worlds, self.card, settings.device, threads=threads)
        self.model = sb3.make_ppo(settings, self.env)
        self.course = Course()
        self.stopping = False
        if (settings.out / checkpoint.FILE).exists():
            self._go_on()
        elif settings.start is not None:
            self._start_from(settings.start)

    def run(self) -> Course:
        """Train to the end."""
        course, settings = self.course, self.settings
        if course.steps >= settings.steps:
            self.console.print(f"{settings.out} is trained: {course.steps:,} steps of {settings.steps:,}")
            return course
        self._meet_rivals()
        with Display(settings, self.console, course) as self.display, self._stopping_gently():
            self._learn()
            self.evaluate_and_save()
        draw_curve(settings.out)
        return course

    def due(self) -> bool:
        """Whether an evaluation is due."""
        every, done = self.settings.evaluate_every, self.course.curve[-1]["steps"] if self.course.curve else 0
        return self.course.steps // every > done // every

    def evaluate_and_save(self) -> None:
        """Evaluate the policy and write a checkpoint."""
        network = sb3.to_network(self.model, self.settings.activation)
        episodes = self.settings.evaluation_episodes
        policy = Learned(network, self.card, self.scenario, episodes, self.settings.device)
        point = {"steps": self.course.steps, "seconds": round(self.course.seconds, 1)}
        point |= _summary(evaluate(policy, self.scenario, _seeds(episodes), self.settings.device))
        best = max((earlier["return"] for earlier in self.course.curve), default=-math.inf)
        self.course.curve.append(point)
        self.display.evaluated(point)
        self.save()
        if point["return"] > best:
            checkpoint.save(self.settings.out / "best", network, self.card, notes={"scores": point})

    def save(self) -> None:
        """Write a checkpoint, and let both this run and one that goes on from it begin at the same point."""
        rows = self.env.resume()
        if self.env.base is not None:
            self.model._last_obs = rows
        state = sb3.save_model(self.model) | {
            f"world.{name}": array for name, array in self.env.simulation.save_state().items()
        }
        course = self.course
        notes = {
            "counters": {"steps": course.steps, "updates": course.updates, "seconds": round(course.seconds, 1)},
            "scores": course.curve[-1] if course.curve else None,
            "rivals": course.rivals,
            "curve": course.curve,
        }
        network = sb3.to_network(self.model, self.settings.activation)
        checkpoint.save(self.settings.out, network, self.card, state=state, notes=notes)

    def observe_rollout(self, extra: dict[str, float] | None = None) -> None:
        """Show and log how the latest episodes went."""
        recent = _summary(self.env.scores) if self.env.scores else {}
        evaluated = self.course.curve[-1] if self.course.curve else {}
        logged = {f"rollout/{name}": value for name, value in recent.items()} | {
            f"evaluation/{name}": value for name, value in evaluated.items() if name not in ("steps", "seconds")
        }
        for name, value in (logged | (extra or {})).items():
            if value is not None:
                self.model.logger.record(name, value)
        self.display.update(recent)

    def stop_if_asked(self) -> None:
        """After Ctrl-C, write a checkpoint and end."""
        if self.stopping:
            self.save()
            raise KeyboardInterrupt(
                f"{self.course.steps:,} steps are kept in {self.settings.out}, the same command goes on from there"
            )

    def _learn(self) -> None:
        with _logging_to(self.settings.out / "tensorboard", self.course.steps) as logger:
            self.model.set_logger(logger)
            if self.course.steps < self.settings.imitated_until:
                imitation.imitate(self)
            left = self.settings.steps - self.course.steps
            if left > 0:
                # The model counts on from the steps that it has.
                self.model.learn(left, callback=_Watch(self), reset_num_timesteps=self.model._last_obs is None)

    def _meet_rivals(self) -> None:
        episodes = self.settings.evaluation_episodes
        for name in self.settings.rivals:
            if name not in self.course.rivals:
                rival = baselines.make(name, self.scenario, episodes, self.settings.device)
                rows = evaluate(rival, self.scenario, _seeds(episodes), self.settings.device)
                self.course.rivals[name] = _summary(rows)

    def _go_on(self) -> None:
        _, card, text = checkpoint.read(self.settings.out)
        if differences := self.settings.differences(card.settings):
            raise ValueError(
                f"out must be a folder that is empty or holds a training of the same settings, "
                f"got {self.settings.out}: {'; '.join(differences)}"
            )
        arrays = checkpoint.read_state(self.settings.out, text)
        self.course = Course(**text["counters"], curve=text["curve"], rivals=text["rivals"])
        prefix = "world."
        worlds = {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
        self.env.simulation.load_state(worlds)
        self.env.resume()
        sb3.load_model(self.model, arrays, self.course.steps, self.course.updates)

    def _start_from(self, name: str) -> None:
        network, card, _ = checkpoint.read(find(name))
        if (card.inputs, card.base) != (self.card.inputs, self.card.base):
            raise ValueError(f"start must read the same inputs and have the same base, got {name} of base {card.base}")
        sb3.from_network(self.model, network)

    @contextlib.contextmanager
    def _stopping_gently(self) -> Iterator[None]:
        """Let the first Ctrl-C end the training where a checkpoint can be written; a second one ends it at once."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def stop(*_: Any) -> None:
            self.stopping = True
            signal.signal(signal.SIGINT, before)
            self.display.say("stopping after this update; once more stops at once")

        before = signal.signal(signal.SIGINT, stop)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)


class _Watch(BaseCallback):
    """Keeps the course while Stable-Baselines3 learns: counts, shows, evaluates, stops."""

    def __init__(self, trainer: Trainer):
        super().__init__()
        self.trainer = trainer
        self._since = time.monotonic()

    def _on_rollout_start(self) -> None:
        # The one moment between an update and the next step: what is saved here is all there is.
        trainer = self.trainer
        trainer.course.updates = self.model._n_updates
        if trainer.due():
            self._count_time()
            trainer.evaluate_and_save()
            self._since = time.monotonic()
        trainer.stop_if_asked()

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        trainer = self.trainer
        self._count_time()
        trainer.course.steps = self.model.num_timesteps
        trainer.observe_rollout()

    def _on_training_end(self) -> None:
        self._count_time()
        self.trainer.course.updates = self.model._n_updates

    def _count_time(self) -> None:
        now = time.monotonic()
        self.trainer.course.seconds += now - self._since
        self._since = now


def _summary(rows: Any) -> dict[str, float | None]:
    """Interquartile mean of the detection time [s], and means of what else a training is watched for."""
    times = [row["detection_time_mean"] for row in rows if math.isfinite(row["detection_time_mean"])]

    def mean(column: str) -> float | None:
        values = [row[column] for row in rows if math.isfinite(row[column])]
        return sum(values) / len(values) if values else None

    return {
        "detection_time": interquartile_mean(times) if times else None,
        "collisions": mean("collisions"),
        "return": mean("return_mean"),
        "detected_fraction": mean("detected_fraction"),
    }


def _seeds(episodes: int) -> range:
    return range(FIRST_EVALUATION_SEED, FIRST_EVALUATION_SEED + episodes)


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
