"""`lissajous train` with Stable-Baselines3's networks; the command resumes an interrupted training."""

import contextlib
import dataclasses
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console
from stable_baselines3.common.logger import KVWriter, Logger

import baselines
from lissajous_env.console.terminal import make_console
from lissajous_env.storage.folder import Folder
from training import scenarios
from training.events import open_rows
from training.learned import checkpoint
from training.learned.history import SCORES, History, summarize_scores
from training.learned.named_arrays import prefixed, within
from training.learned.network import Network
from training.sb3 import imitation
from training.sb3.mixed_vec_env import MixedVecEnv
from training.sb3.ppo import RobotPPO
from training.sb3.vec_env import RobotVecEnv
from training.settings import TrainingSettings
from training.trainer import Trainer


def train(settings: TrainingSettings, console: Console | None = None, writers: Sequence[KVWriter] = ()) -> History:
    """Train until the last step, from the last checkpoint if `settings.out` has one.

    Args:
        settings: Settings of the training.
        console: Console of the progress lines.
        writers: Writers of Stable-Baselines3's logger besides TensorBoard, for Weights & Biases or MLflow.

    Raises:
        ValueError: the folder contains other files or results of other settings, or is in use by another process; or
            weights are no longer finite.
        OSError: the disk is full; the last checkpoint is intact.
        KeyboardInterrupt: Ctrl-C; a checkpoint has been written.
    """
    with checkpoint.hold(settings.out) as folder:
        return Sb3Trainer(settings, console or make_console(), folder, writers).run()


class Sb3Trainer(Trainer):
    """A training in this process: model and environments, new or restored from the last checkpoint."""

    def __init__(self, settings: TrainingSettings, console: Console, folder: Folder, writers: Sequence[KVWriter] = ()):
        super().__init__(settings, console, folder)
        self._writers = writers
        torch.set_num_threads(1)  # threads share blocks of rows and of worlds instead, see `BLOCK`
        penalty = settings.residual_penalty if settings.chosen_base else 0.0
        self.env = self._make_env(penalty)
        self.model = RobotPPO(settings, self.env, self.card)
        self.average: dict[str, np.ndarray] | None = None
        self.teacher = None
        if settings.imitated is not None:
            self.teacher = baselines.make(settings.imitated, self.scenario, settings.num_worlds, settings.device)
        if (settings.out / checkpoint.FILE).exists():
            self._resume()
        else:
            self.model.reset()
            if (network := self._network_to_start_from()) is not None:
                self.model.start_from(network)

    def _make_env(self, penalty: float) -> RobotVecEnv | MixedVecEnv:
        settings = self.settings
        common: dict[str, Any] = {
            "residual_penalty": penalty,
            "device": settings.device,
            "threads": settings.threads,
            "central": settings.has_central_critic,
            "staggered": True,
        }
        if settings.space is None:
            common |= {"short": settings.short, "short_time": settings.short_time}
            return RobotVecEnv(settings.make_cautious_scenario(), settings.num_worlds, self.card, **common)
        card = self.card
        with scenarios.without_warnings(settings.space):
            return MixedVecEnv(
                settings.space,
                settings.num_groups,
                settings.num_worlds // settings.num_groups,
                scenarios.LEARNED,
                settings.seed,
                lambda made: dataclasses.replace(card, scenario=made.name, home=None),
                settings.change_drawn,
                **common,
            )

    def network(self) -> Network:
        """Copy the current policy, or the average of its weights where the settings request one."""
        learned = self.model.network()
        return learned if self.average is None else Network.from_arrays(self.average, learned.activation)

    def average_in(self) -> None:
        """Add the current weights to their moving average."""
        decay, learned = self.settings.averaging, self.model.network().to_arrays()
        if decay > 0:
            before = self.average or learned
            self.average = {
                name: (decay * before[name] + (1 - decay) * array).astype(np.float32) for name, array in learned.items()
            }

    def save(self) -> None:
        """Write a checkpoint; a training resumed from it is bit-identical to one that was not interrupted."""
        state = self.model.save_state() | self.env.save_state()
        if self.teacher is not None:
            state |= prefixed("teacher", self.teacher.save_state())
        state |= prefixed("average", self.average or {})
        watched = [[row[column.name] for column in SCORES.values()] for row in self.env.scores]
        state["scores"] = np.array(watched).reshape(-1, len(SCORES))
        checkpoint.save(self.folder, self.network(), self.card, state=state, notes=self.history.notes)

    def log(self, values: Mapping[str, float | None]) -> None:
        """Write values to TensorBoard and the other writers."""
        for name, value in values.items():
            if value is not None:
                self._logger.record(name, value)
        self._logger.dump(self.history.steps)

    def _learn(self) -> None:
        settings, history, model = self.settings, self.history, self.model
        with _logging_to(self.folder.make_folder("tensorboard"), history.steps, self._writers) as self._logger:
            while history.steps < settings.steps:
                if self.due():
                    self.evaluate_and_save()
                self.stop_if_asked()
                began = time.monotonic()
                imitates = history.steps < settings.imitated_until
                try:
                    logged = self._imitate() if imitates else self._reinforce()
                except ValueError as error:
                    model.require_finite(history.steps, error)
                    raise
                model.require_finite(history.steps)
                history.steps += settings.rollout * self.env.num_envs
                history.updates += settings.imitation_epochs if imitates else settings.epochs
                history.seconds += time.monotonic() - began
                self.observe_update(logged)
            self.evaluate_and_save()

    def _imitate(self) -> dict[str, float]:
        """Fit the model to the teacher's actions for one rollout, by least squares."""
        settings, steps = self.settings, self.history.steps
        assert self.teacher is not None
        self.display.begin(f"imitation of {settings.imitated}")
        self.model.set_learning_rate(1 - steps / settings.imitated_until)
        share = imitation.taught_share(settings, steps)
        assert isinstance(self.env, RobotVecEnv)
        rows, wanted = imitation.collect(self.env, self.model, self.teacher, share, settings.rollout)
        return {"imitation/error": imitation.fit(self.model, rows, wanted)}

    def _reinforce(self) -> dict[str, float]:
        """Update the model by PPO with one rollout."""
        settings, steps = self.settings, self.history.steps
        critic_only = steps < settings.imitated_until + settings.critic_steps
        self.display.begin("critic alone" if critic_only else "PPO")
        self.model.set_noise((steps - settings.imitated_until) / max(settings.steps - settings.imitated_until, 1))
        done = (steps + settings.rollout * self.env.num_envs) / settings.steps
        logged = self.model.learn(max(1 - done, 0.0), critic_only)
        self.average_in()
        return {f"train/{name}": value for name, value in logged.items()}

    def observe_update(self, logged: dict[str, float]) -> None:
        """Log an update, and show the scores of the latest episodes."""
        recent = summarize_scores(self.env.scores) if self.env.scores else {}
        self.history.learned({name.removeprefix("train/"): value for name, value in logged.items()})
        # Tools that read logs of Stable-Baselines3 expect this name of the return.
        self.log({f"rollout/{'ep_rew_mean' if name == 'return' else name}": of for name, of in recent.items()} | logged)
        self.display.update(recent)

    def _resume(self) -> None:
        _, card, text = checkpoint.read(self.settings.out)
        self._check_same(card)
        arrays = checkpoint.read_state(self.settings.out, text)
        self.keep(History.read(text))
        with checkpoint.resuming(self.settings.out, text):
            with scenarios.without_warnings(self.settings.space):
                self.env.load_state(arrays)
            if self.teacher is not None:
                self.teacher.load_state(within("teacher", arrays))
            self.average = within("average", arrays) or None
            names = [column.name for column in SCORES.values()]
            self.env.scores.extend(dict(zip(names, row, strict=True)) for row in arrays["scores"].tolist())
            self.model.load_state(arrays)


@contextlib.contextmanager
def _logging_to(folder: Path, steps: int, writers: Sequence[KVWriter]) -> Iterator[Logger]:
    """Log to TensorBoard and to the writers; values logged after the last checkpoint are hidden."""
    before = threading.excepthook

    def quiet(arguments: threading.ExceptHookArgs) -> None:
        # A full disk is reported by the next row; the writing thread need not print its traceback.
        if not isinstance(arguments.exc_value, OSError):
            before(arguments)

    threading.excepthook = quiet
    try:
        logger = Logger(str(folder), [_Rows(folder, steps), *writers])
        with contextlib.closing(logger):
            yield logger
    except OSError as error:
        if error.filename is None:
            raise OSError(error.errno, error.strerror or str(error), str(folder)) from error
        raise
    finally:
        threading.excepthook = before


class _Rows(KVWriter):
    """Writes TensorBoard's rows after a number of steps; later rows of an earlier process are removed."""

    def __init__(self, folder: Path, steps: int):
        self._rows = open_rows(folder, steps)

    def write(self, key_values: dict, key_excluded: dict, step: int = 0) -> None:
        """Write the values of a step."""
        for name, value in key_values.items():
            self._rows.add_scalar(name, value, step)
        self._rows.flush()

    def close(self) -> None:
        """Close the file."""
        self._rows.close()
