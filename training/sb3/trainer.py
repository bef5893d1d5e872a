"""`lissajous train` by Stable-Baselines3: it can be stopped at any moment and called again."""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import cast

import numpy as np
import torch
from rich.console import Console
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat
from stable_baselines3.common.policies import ActorCriticPolicy

import baselines
from lissajous_env.console.terminal import make_console
from lissajous_env.storage.folder import Folder
from training.events import open_rows
from training.learned import checkpoint
from training.learned.history import SCORES, History, summarize_scores
from training.learned.named_arrays import prefixed, within
from training.learned.network import Network
from training.sb3 import imitation, ppo
from training.sb3.vec_env import RobotVecEnv
from training.settings import TrainingSettings
from training.trainer import Trainer

_EPISODE = ("r", "l")
"""What Stable-Baselines3 logs of an episode: return, and length [steps]."""


def train(settings: TrainingSettings, console: Console | None = None, writers: Sequence[KVWriter] = ()) -> History:
    """Train to the end, from the last checkpoint where `settings.out` has one.

    Args:
        settings: What is trained, how, and where it goes.
        console: Where lines are printed.
        writers: Where Stable-Baselines3's logger writes besides TensorBoard, such as Weights & Biases or MLflow.

    Raises:
        ValueError: a folder that holds files of others or the results of other settings, or is in use by another
            process; or weights that are no longer finite.
        OSError: the disk is full; the last checkpoint is whole.
        KeyboardInterrupt: Ctrl-C; everything up to then is in the checkpoint.
    """
    with checkpoint.hold(settings.out) as folder:
        return Sb3Trainer(settings, console or make_console(), folder, writers).run()


class Sb3Trainer(Trainer):
    """A training by Stable-Baselines3: model and worlds, made anew or as the last checkpoint has them."""

    def __init__(self, settings: TrainingSettings, console: Console, folder: Folder, writers: Sequence[KVWriter] = ()):
        super().__init__(settings, console, folder)
        self._writers = writers
        # Blocks of rows and of worlds have the threads: torch's own would wait for one another at each operation.
        torch.set_num_threads(1)
        penalty = settings.residual_penalty if settings.chosen_base else 0.0
        self.env = RobotVecEnv(
            settings.make_cautious_scenario(),
            settings.num_worlds,
            self.card,
            penalty,
            settings.device,
            threads=settings.threads,
            central=settings.has_central_critic,
            short=settings.short,
            short_time=settings.short_time,
            staggered=True,
        )
        self.model = ppo.make_ppo(settings, self.env, self.card)
        self.average: dict[str, np.ndarray] | None = None
        self.teacher = None
        if settings.imitated is not None:
            self.teacher = baselines.make(settings.imitated, self.scenario, settings.num_worlds, settings.device)
        if (settings.out / checkpoint.FILE).exists():
            self._go_on()
        elif (network := self._network_to_start_from()) is not None:
            ppo.from_network(self.model, network)

    def network(self) -> Network:
        """Copy the policy that has been learned so far."""
        learned = ppo.to_network(self.model, self.settings.activation)
        return learned if self.average is None else Network.from_arrays(self.average, learned.activation)

    def average_in(self) -> None:
        """Add the weights as they are to their average."""
        kept, learned = self.settings.averaging, ppo.to_network(self.model, self.settings.activation).to_arrays()
        if kept > 0:
            before = self.average or learned
            self.average = {
                name: (kept * before[name] + (1 - kept) * array).astype(np.float32) for name, array in learned.items()
            }

    def save(self) -> None:
        """Write a checkpoint; a run that goes on from it does bit for bit what this one does."""
        state = ppo.save_model(self.model) | self.env.save_state()
        if self.teacher is not None:
            state |= prefixed("teacher", self.teacher.save_state())
        state |= prefixed("average", self.average or {})
        watched = [[row[column] for column in SCORES.values()] for row in self.env.scores]
        state["scores"] = np.array(watched).reshape(-1, len(SCORES))
        ended = [[episode[name] for name in _EPISODE] for episode in self.model.ep_info_buffer or ()]
        state["episodes"] = np.array(ended, dtype=float).reshape(-1, len(_EPISODE))
        checkpoint.save(self.folder, self.network(), self.card, state=state, notes=self.history.notes)

    def log(self, values: Mapping[str, float | None]) -> None:
        """Write values, and what the model has recorded of its update, to TensorBoard."""
        for name, value in values.items():
            if value is not None:
                self.model.logger.record(name, value)
        self.model.logger.dump(self.history.steps)

    def observe_rollout(self, extra: dict[str, float] | None = None) -> None:
        """Show and log how the latest episodes went."""
        recent = summarize_scores(self.env.scores) if self.env.scores else {}
        logged = {f"rollout/{name}": value for name, value in recent.items()}
        for name, value in (logged | (extra or {})).items():
            if value is not None:
                self.model.logger.record(name, value)
        self.display.update(recent)

    def keep_update(self) -> None:
        """Keep what the model said of its latest update, for the report."""
        told = self.model.told
        self.history.learned(told | {"entropy": -told["entropy_loss"]})

    def _learn(self) -> None:
        with _logging_to(self.folder.make_folder("tensorboard"), self.history.steps, self._writers) as logger:
            self.model.set_logger(logger)
            if self.teacher is not None:
                self._imitate(self.teacher)
            left = self.settings.steps - self.history.steps
            if left > 0:
                # The model counts on from the steps that it has.
                first = self.model._last_obs is None
                try:
                    self.model.learn(left, callback=_Watch(self), reset_num_timesteps=first)
                except ValueError as error:
                    ppo.require_finite(self.model, self.settings, self.history.steps, error)
                    raise
                ppo.require_finite(self.model, self.settings, self.history.steps)
            self.evaluate_and_save()

    def _imitate(self, teacher: baselines.Policy) -> None:
        """Let the model learn the teacher's action, by least squares, as long as the settings say."""
        settings, env, model, history = self.settings, self.env, self.model, self.history
        if model._last_obs is None:
            model._last_obs = np.asarray(env.reset())
            model._last_episode_starts = np.ones(env.num_envs, dtype=bool)
        if history.steps < settings.imitated_until:
            self.display.begin(f"imitation of {settings.imitated}")
        while history.steps < settings.imitated_until:
            if self.due():
                self.evaluate_and_save()
            self.stop_if_asked()
            began = time.monotonic()
            model._update_current_progress_remaining(history.steps, settings.imitated_until)
            model._update_learning_rate(model.policy.optimizer)
            share = imitation.taught_share(settings, history.steps)
            try:
                rows, wanted = imitation.collect(env, model, teacher, share, settings.rollout)
                loss = imitation.fit(model, settings, rows, wanted)
            except ValueError as error:
                ppo.require_finite(model, settings, history.steps, error)
                raise
            ppo.require_finite(model, settings, history.steps)
            history.steps += settings.rollout * env.num_envs
            history.updates += settings.imitation_epochs
            history.seconds += time.monotonic() - began
            model.num_timesteps, model._n_updates = history.steps, history.updates
            self.observe_rollout({"imitation/error": loss})
            model.logger.dump(history.steps)

    def _go_on(self) -> None:
        _, card, text = checkpoint.read(self.settings.out)
        self._check_same(card)
        arrays = checkpoint.read_state(self.settings.out, text)
        self.keep(History.read(text))
        try:
            self.env.load_state(arrays)
            if self.teacher is not None:
                self.teacher.load_state(within("teacher", arrays))
            self.average = within("average", arrays) or None
            self.env.scores.extend(dict(zip(SCORES.values(), row, strict=True)) for row in arrays["scores"].tolist())
            ppo.load_model(self.model, arrays, self.history.steps, self.history.updates)
            ended = [dict(zip(_EPISODE, row, strict=True)) for row in arrays["episodes"].tolist()]
            most = self.model._stats_window_size
            self.model.ep_info_buffer, self.model.ep_success_buffer = deque(ended, most), deque(maxlen=most)
        except (KeyError, IndexError, TypeError, ValueError, RuntimeError) as error:
            path = self.settings.out / text["files"]["state"]["name"]
            words = f"{type(error).__name__}: {str(error).partition(chr(10))[0][:200]}"
            raise ValueError(f"{path} must hold the state of this training: {words}") from error


class _Watch(BaseCallback):
    """Keeps the history while Stable-Baselines3 learns: counts, shows, evaluates, stops."""

    def __init__(self, trainer: Sb3Trainer):
        super().__init__()
        self.trainer = trainer
        self._since = time.monotonic()

    def _on_rollout_start(self) -> None:
        # The one moment between an update and the next step: what is saved here is all there is.
        trainer = self.trainer
        ppo.require_finite(self.model, trainer.settings, trainer.history.steps)
        if self.model._n_updates > trainer.history.updates:
            trainer.average_in()
            trainer.keep_update()
            trainer.log({})
        trainer.history.updates = self.model._n_updates
        if trainer.due():
            self._count_time()
            trainer.evaluate_and_save()
            self._since = time.monotonic()
        trainer.stop_if_asked()
        alone = trainer.history.steps < trainer.settings.imitated_until + trainer.settings.critic_steps
        trainer.display.begin("critic alone" if alone else "PPO")
        self._set_noise()
        if self.model.use_sde:
            # The noise has been drawn before this moment: draw it anew, from what a run that goes on knows too.
            torch.manual_seed(trainer.settings.seed << 40 | trainer.history.steps)
            cast(ActorCriticPolicy, self.model.policy).reset_noise(trainer.env.num_envs)

    def _set_noise(self) -> None:
        """Let the noise be what the settings say for this moment."""
        settings, began = self.trainer.settings, self.trainer.settings.imitated_until
        if settings.log_std_end is not None:
            done = (self.trainer.history.steps - began) / max(settings.steps - began, 1)
            fall = max(settings.log_std - settings.log_std_end, 0.0)
            with torch.no_grad():
                cast(ActorCriticPolicy, self.model.policy).log_std.fill_(settings.log_std - fall * min(done, 1.0))

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        trainer = self.trainer
        self._count_time()
        settings, policy = trainer.settings, self.model.policy
        # An update follows: of the critic alone, as long as the settings say.
        both = trainer.history.steps >= settings.imitated_until + settings.critic_steps
        for name, parameter in policy.named_parameters():
            parameter.requires_grad_(both or name in ppo.critic_parameters(policy))
        trainer.history.steps = self.model.num_timesteps
        trainer.observe_rollout()

    def _on_training_end(self) -> None:
        self._count_time()
        self.trainer.average_in()
        self.trainer.keep_update()
        self.trainer.history.updates = self.model._n_updates

    def _count_time(self) -> None:
        now = time.monotonic()
        self.trainer.history.seconds += now - self._since
        self._since = now


@contextlib.contextmanager
def _logging_to(folder: Path, steps: int, writers: Sequence[KVWriter]) -> Iterator[Logger]:
    """Log to TensorBoard and to the writers; what an earlier process logged after its last checkpoint is taken back."""
    before = threading.excepthook

    def quiet(told: threading.ExceptHookArgs) -> None:
        # A disk that is full is told by the next row: the thread that writes need not print where it was.
        if not isinstance(told.exc_value, OSError):
            before(told)

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


class _Rows(TensorBoardOutputFormat):
    """Rows of TensorBoard that go on after some steps; later ones of another process are taken back."""

    def __init__(self, folder: Path, steps: int):
        self.writer = open_rows(folder, steps)
        self._is_closed = False
