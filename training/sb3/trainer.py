"""`lissajous train`: imitate, collect, update, evaluate, save; the command resumes an interrupted training."""

import contextlib
import hashlib
import json
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from rich.console import Console
from rich.markup import escape
from stable_baselines3.common.logger import KVWriter

import baselines
from lissajous_env import Scenario, ScenarioSpace, evaluate
from lissajous_env.console.terminal import make_console, plain
from lissajous_env.device.devices import cores
from lissajous_env.storage.folder import Folder
from training import scenarios
from training.display import Display
from training.events import logging_to
from training.learned import checkpoint
from training.learned.card import Card
from training.learned.checkpoint import prefixed, within
from training.learned.history import RELATIVE, SCORES, History, summarize_scenarios, summarize_scores
from training.learned.network import Network
from training.learned.policy import Learned, find
from training.rehearsal import best_policies
from training.report import TrainingReport
from training.sb3.imitation import imitate
from training.sb3.mixed_vec_env import MixedVecEnv
from training.sb3.ppo import RobotPPO
from training.sb3.vec_env import RobotVecEnv
from training.settings import TrainingSettings

FIRST_EVALUATION_SEED = 20_000


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
        return Trainer(settings, console or make_console(), folder, writers).run()


class Trainer:
    """A training in a locked folder, new or restored from the last checkpoint."""

    def __init__(self, settings: TrainingSettings, console: Console, folder: Folder, writers: Sequence[KVWriter] = ()):
        self.settings, self.console, self.folder, self._writers = settings, console, folder, writers
        torch.set_num_threads(settings.threads or cores())
        self.scenario = settings.make_scenario()
        self.evaluated_on = settings.make_evaluation_scenarios()
        """Scenarios of the evaluations."""
        self.card = Card.of(
            settings.make_home_scenario(),
            settings.inputs,
            base=settings.chosen_base,
            base_parameters=settings.chosen_base_parameters,
            residual=settings.residual if settings.chosen_base else 1.0,
            constants=settings.constants,
            settings=settings.to_dict() | ({} if settings.space is None else {"space": _digest_of(settings.space)}),
        )
        self.stopping = False
        """True after Ctrl-C."""
        self._use(History())
        self.report = TrainingReport(folder, settings, self.scenario, FIRST_EVALUATION_SEED)
        self.env = self._make_env()
        self.model = RobotPPO(settings, self.env, self.card)
        self.average: dict[str, np.ndarray] | None = None
        """Moving average of the weights, if the settings request one."""
        self.teacher = None
        if settings.imitated is not None:
            self.teacher = baselines.make(settings.imitated, self.scenario, settings.num_worlds, settings.device)
        if (settings.out / checkpoint.FILE).exists():
            self._resume()
        elif (network := self._network_to_start_from()) is not None:
            self.model.start_from(network)

    def run(self) -> History:
        """Train until the last step."""
        settings = self.settings
        if self.history.steps >= settings.steps:
            self.console.print(f"{settings.out} is finished: {self.history.steps:,} of {settings.steps:,} steps")
        else:
            with scenarios.without_warnings(settings.space), self.display:
                self._meet_rivals()
                log_folder = self.folder.make_folder("tensorboard")
                with self._stopping_gently(), logging_to(log_folder, self.history.steps, self._writers) as logger:
                    self.model.set_logger(logger)
                    self._learn()
        self.display.conclude()
        return self.history

    def _learn(self) -> None:
        settings, history, model = self.settings, self.history, self.model
        while history.steps < settings.steps:
            if self._due():
                self.evaluate_and_save()
            if self.stopping:
                self.save()
                raise KeyboardInterrupt(
                    f"{history.steps:,} steps are saved in {settings.out}; the same command resumes there"
                )
            began = time.monotonic()
            try:
                if history.steps < settings.imitated_until:
                    self._imitate()
                else:
                    self._reinforce()
            except ValueError as error:
                model.require_finite(history.steps, error)
                raise
            model.require_finite(history.steps)
            history.steps += settings.rollout * self.env.num_envs
            history.seconds += time.monotonic() - began
            self.observe_update()
        self.evaluate_and_save()

    def _imitate(self) -> None:
        """Fit the model to the teacher's actions for one rollout."""
        self.display.begin(f"imitation of {self.settings.imitated}")
        assert self.teacher is not None
        assert isinstance(self.env, RobotVecEnv)
        done = self.history.steps / self.settings.imitated_until
        self.model.logger.record("imitation/error", imitate(self.model, self.env, self.teacher, done))

    def _reinforce(self) -> None:
        """Update the model by PPO with one rollout."""
        settings, steps = self.settings, self.history.steps
        critic_only = steps < settings.imitated_until + settings.critic_steps
        self.display.begin("critic alone" if critic_only else "PPO")
        self.model.set_noise((steps - settings.imitated_until) / max(settings.steps - settings.imitated_until, 1))
        done = (steps + settings.rollout * self.env.num_envs) / settings.steps
        self.model.learn_once(min(done, 1.0), critic_only)
        self.average_in()

    def average_in(self) -> None:
        """Add the current weights to their moving average."""
        decay, learned = self.settings.averaging, self.model.network().to_arrays()
        if decay > 0:
            before = self.average or learned
            self.average = {
                name: (decay * before[name] + (1 - decay) * array).astype(np.float32) for name, array in learned.items()
            }

    def observe_update(self) -> None:
        """Log an update, whose diagnostics the model has recorded, and show the scores of the latest episodes."""
        recent = summarize_scores(self.env.scores) if self.env.scores else {}
        recorded = self.model.logger.name_to_value
        self.history.learned({name.removeprefix("train/"): float(value) for name, value in recorded.items()})
        # Tools that read logs of Stable-Baselines3 expect this name of the return.
        self.log({f"rollout/{'ep_rew_mean' if name == 'return' else name}": value for name, value in recent.items()})
        self.display.update(recent)

    def log(self, values: Mapping[str, float | None]) -> None:
        """Write values to TensorBoard and the other writers, at the current number of steps."""
        for name, value in values.items():
            if value is not None:
                self.model.logger.record(name, value)
        self.model.logger.dump(self.history.steps)

    def network(self) -> Network:
        """Copy the current policy, or the average of its weights where the settings request one."""
        learned = self.model.network()
        return learned if self.average is None else Network.from_arrays(self.average)

    def _due(self) -> bool:
        """Return True if the next evaluation is due; the first one is that of the untrained policy."""
        if not self.history.curve:
            return True
        every, done = self.settings.evaluate_every, self.history.curve[-1]["steps"]
        return self.history.steps // every > done // every

    def evaluate_and_save(self) -> None:
        """Evaluate the policy and write a checkpoint; the best policy so far is also written under `best`."""
        network, settings, history = self.network(), self.settings, self.history
        point: dict[str, Any] = {"steps": history.steps, "seconds": round(history.seconds, 1)}
        point |= self._evaluated(lambda made, worlds: Learned(network, self.card, made, worlds, settings.device))
        if history.add(point):
            checkpoint.save(self.folder, network, self.card, notes=history.notes, place=checkpoint.BEST)
        self.log({f"evaluation/{name}": point[name] for name in (*SCORES, RELATIVE) if name in point})
        self.save()
        alone = Learned(network, self.card, self.scenario, 1, settings.device)
        self.report.write(history, alone, last=history.steps >= settings.steps)
        self.display.evaluated(point)
        for rival in history.rivals:
            # The untrained policy differs from its base by the random initial weights only.
            if history.first_better(rival, after=0 if rival == settings.base_label else -1) is point:
                self.display.beaten(rival, point)

    def save(self) -> None:
        """Write a checkpoint; a training resumed from it is bit-identical to one that was not interrupted."""
        state = self.model.save_state() | self.env.save_state()
        if self.teacher is not None:
            state |= prefixed("teacher", self.teacher.save_state())
        state |= prefixed("average", self.average or {})
        watched = [[row[column.name] for column in SCORES.values()] for row in self.env.scores]
        state["scores"] = np.array(watched).reshape(-1, len(SCORES))
        notes = self.history.notes | {"best": self.history.best}
        checkpoint.save(self.folder, self.network(), self.card, state=state, notes=notes)

    def _resume(self) -> None:
        _, card, text = checkpoint.read(self.settings.out)
        self._check_same(card)
        arrays = checkpoint.read_state(self.settings.out, text)
        self._use(History.read(text))
        with checkpoint.resuming(self.settings.out, text):
            with scenarios.without_warnings(self.settings.space):
                self.env.load_state(arrays)
            if self.teacher is not None:
                self.teacher.load_state(within("teacher", arrays))
            self.average = within("average", arrays) or None
            names = [column.name for column in SCORES.values()]
            self.env.scores.extend(dict(zip(names, row, strict=True)) for row in arrays["scores"].tolist())
            self.model.load_state(arrays)

    def _use(self, history: History) -> None:
        self.history = history
        self.display = Display(self.settings, self.console, history)

    def _check_same(self, stored: Card) -> None:
        """Raise ValueError if the folder contains a training with other settings or another scenario."""
        differences = self.settings.differences(stored.settings)
        there, here = stored.home, self.card.home
        for part in here:
            if part not in ("name", "description") and not differences and there.get(part) != here[part]:
                differences.append(f"{part} of the scenario = {there.get(part)} there, {here[part]} here")
        if self.card.settings.get("space") != stored.settings.get("space"):
            differences.append("the space of scenarios has changed")
        if differences:
            raise ValueError(
                f"out must be an empty folder or contain a training with the same settings, "
                f"got {self.settings.out}: {'; '.join(differences)}"
            )

    def _network_to_start_from(self) -> Network | None:
        """Read the network given by `start`.

        Raises:
            ValueError: its inputs, base or layers differ from the settings.
        """
        name = self.settings.start
        if name is None:
            return None
        network, card, _ = checkpoint.read(find(name))
        shared = ("inputs", "constants", "base", "base_parameters")
        wanted = {part: getattr(self.card, part) for part in shared}
        wanted |= {"layers": tuple(self.settings.layers)}
        read = {part: getattr(card, part) for part in shared}
        read |= {"layers": network.hidden}
        for part, value in wanted.items():
            if read[part] != value:
                raise ValueError(f"start must have the same {part} ({value}), got {name} with {read[part]}")
        return network

    def _make_env(self) -> RobotVecEnv | MixedVecEnv:
        settings, card = self.settings, self.card
        common: dict[str, Any] = {
            "device": settings.device,
            "threads": settings.threads,
            "central": True,
            "staggered": True,
        }
        if settings.space is None:
            common |= {"short": settings.short, "short_time": settings.short_time}
            return RobotVecEnv(settings.make_cautious_scenario(), settings.num_worlds, card, **common)
        with scenarios.without_warnings(settings.space):
            return MixedVecEnv(
                settings.space,
                settings.num_groups,
                settings.num_worlds // settings.num_groups,
                scenarios.LEARNED,
                settings.seed,
                card,
                settings.change_drawn,
                **common,
            )

    def _meet_rivals(self) -> None:
        """Evaluate the rivals that have not been evaluated."""
        settings, device, display = self.settings, self.settings.device, self.display
        names = [*settings.chosen_rivals]
        if settings.rivals is None:
            if not self.history.rivals:
                display.say("rehearsal: every classical policy plays; the best becomes a rival; --rivals names others")
                best = best_policies(self.evaluated_on, device, display.show, display.say)
                words = " and ".join(best) or "no policy can be played"
                display.say(f"best classical policy in a rehearsal: {escape(words)}")
                names += best
            names.append(settings.base_label)
        for name in filter(None, dict.fromkeys(names)):
            if name not in self.history.rivals:
                make = self.card.make_base if name == settings.base_label else partial(baselines.make, name)
                display.show(f"evaluation of {name}")
                self.history.rivals[name] = self._evaluated(lambda made, worlds, make=make: make(made, worlds, device))
                display.meet(name)

    def _evaluated(self, make: Callable[[Scenario, int], Any]) -> dict[str, Any]:
        """Return the scores of the policy that `make` returns for a scenario and a number of worlds."""
        began, device, count = time.monotonic(), self.settings.device, self.settings.episodes_per_scenario
        seeds = range(FIRST_EVALUATION_SEED, FIRST_EVALUATION_SEED + count)
        scores = {
            made.name: summarize_scores(evaluate(make(made, count), made, seeds, device)) for made in self.evaluated_on
        }
        self.display.evaluation_seconds = time.monotonic() - began
        if self.settings.space is None:
            return scores[self.scenario.name]
        rivals = self.history.rivals
        return summarize_scenarios(scores, rivals[next(iter(rivals))]["scenarios"] if rivals else scores)

    @contextlib.contextmanager
    def _stopping_gently(self) -> Iterator[None]:
        """Let the first Ctrl-C end the training after the current update, and a second one immediately."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def stop(*_: Any) -> None:
            self.stopping = True
            signal.signal(signal.SIGINT, before)
            self.display.say("stopping after this update; press Ctrl-C again to stop immediately")

        before = signal.signal(signal.SIGINT, stop)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)


def _digest_of(space: ScenarioSpace) -> str:
    """Return a digest of the values that determine the scenarios of a space."""
    base = plain(space.base.to_dict())
    text = json.dumps([space.name, base, space.draw, space.require], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
