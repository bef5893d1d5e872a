"""Common part of all trainings, whichever library learns: count steps, evaluate, save, stop on Ctrl-C, resume."""

import contextlib
import hashlib
import json
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

from rich.console import Console

import baselines
from baselines.policies import registry
from lissajous_env import Scenario, ScenarioSpace, evaluate
from lissajous_env.console.terminal import plain
from lissajous_env.identity import parts_of
from lissajous_env.parameters.robot_models import is_shipped, model_of
from lissajous_env.storage.folder import Folder
from training import scenarios
from training.display import Display
from training.learned import checkpoint
from training.learned.card import Card
from training.learned.history import RELATIVE, SCORES, History, summarize_scenarios, summarize_scores
from training.learned.network import Network
from training.learned.policy import Learned, find
from training.pictures import draw_curve
from training.rehearsal import Rehearsal
from training.report import TrainingReport
from training.settings import TrainingSettings

FIRST_EVALUATION_SEED = 20_000


def _code_of(settings: TrainingSettings, scenario: Scenario) -> dict[str, str]:
    """Return digests of the code that a training uses besides the scenario, by name."""
    names = dict.fromkeys(name for name in (settings.chosen_base, settings.imitated) if name)
    found = {f"{part} of {name}": each for name in names for part, each in registry.parts(name).items()}
    kind = scenario.robot.kind
    model = {} if is_shipped(kind) else parts_of(model_of(kind).move)
    found |= {f"{part} of robots of kind {kind}": each for part, each in model.items()}
    return found if settings.space is None else found | {"space of scenarios": _digest_of(settings.space)}


def _digest_of(space: ScenarioSpace) -> str:
    """Return a digest of the values that determine the scenarios of a space."""
    base = plain(space.base.to_dict())
    text = json.dumps([space.name, base, space.draw, space.require], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


class Trainer:
    """A training in a locked folder. Subclasses implement the learner: `network`, `save`, `log` and `_learn`."""

    def __init__(self, settings: TrainingSettings, console: Console, folder: Folder):
        self.settings, self.console, self.folder = settings, console, folder
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
            settings=settings.to_dict() | {"code": _code_of(settings, self.scenario)},
        )
        self.stopping = False
        self.keep(History())
        self.report = TrainingReport(folder, settings, self.scenario, FIRST_EVALUATION_SEED)

    def keep(self, history: History) -> None:
        """Use a history, and a display of it."""
        self.history = history
        self.display = Display(self.settings, self.console, history)

    def network(self) -> Network:
        """Copy the current policy."""
        raise NotImplementedError

    def save(self) -> None:
        """Write a checkpoint from which a training can be resumed."""
        raise NotImplementedError

    def log(self, values: Mapping[str, float | None]) -> None:
        """Write values to TensorBoard, at the current number of steps."""
        raise NotImplementedError

    def _learn(self) -> None:
        """Learn until the last step; call `evaluate_and_save` whenever `due` and at the end, and `stop_if_asked`."""
        raise NotImplementedError

    def run(self) -> History:
        """Train until the last step."""
        history, settings = self.history, self.settings
        if history.steps >= settings.steps:
            self.console.print(f"{settings.out} is finished: {history.steps:,} of {settings.steps:,} steps")
            self._draw_curve()
            self.display.conclude()
            return history
        with scenarios.without_warnings(settings.space), self.display:
            try:
                self._meet_rivals()
            except KeyboardInterrupt:
                words = f"the rehearsal so far is stored in {settings.out}; the same command resumes there"
                raise KeyboardInterrupt(words) from None
            with self._stopping_gently():
                self._learn()
        self._draw_curve()
        self.display.conclude()
        return history

    def due(self) -> bool:
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
            history.best = checkpoint.best_of(network, history.counters, point)
        self.log({f"evaluation/{name}": point[name] for name in (*SCORES, RELATIVE) if name in point})
        self.save()
        alone = Learned(network, self.card, self.scenario, 1, settings.device)
        self.report.write(history, alone, last=history.steps >= settings.steps)
        self.display.evaluated(point)
        for rival in history.rivals:
            # The untrained policy differs from its base by the random initial weights only.
            if history.first_better(rival, after=0 if rival == settings.base_label else -1) is point:
                self.display.beaten(rival, point)

    def stop_if_asked(self) -> None:
        """After Ctrl-C, write a checkpoint and raise KeyboardInterrupt."""
        if self.stopping:
            self.save()
            raise KeyboardInterrupt(
                f"{self.history.steps:,} steps are saved in {self.settings.out}; the same command resumes there"
            )

    def _meet_rivals(self) -> None:
        """Evaluate the rivals that have not been evaluated."""
        settings, device = self.settings, self.settings.device
        names = [*settings.chosen_rivals]
        if settings.rivals is None:
            names += [*self._rehearse(), settings.base_label]
        for name in filter(None, dict.fromkeys(names)):
            if name not in self.history.rivals:
                make = self.card.make_base if name == settings.base_label else partial(baselines.make, name)
                self.display.show(f"evaluation of {name}")
                self.history.rivals[name] = self._evaluated(lambda made, worlds, make=make: make(made, worlds, device))
                self.display.meet(name)

    def _rehearse(self) -> tuple[str, ...]:
        """Return the best classical policies for the scenarios of the evaluations, by playing all of them."""
        display = self.display
        with self.folder.journal(checkpoint.REHEARSAL) as journal:
            if not journal.entries:
                display.say(
                    "rehearsal: all classical policies play, and the best becomes a rival; --rivals names others"
                )
            device = self.settings.device
            found = Rehearsal(
                self.evaluated_on, journal, device, lambda name: display.show(f"rehearsal of {name}"), display.say
            ).best()
        display.rehearsed(found)
        return found

    def _evaluated(self, make: Callable[[Scenario, int], Any]) -> dict[str, Any]:
        """Return the scores of the policy that `make` returns for a scenario and a number of worlds."""
        began, device, count = time.monotonic(), self.settings.device, self.settings.episodes_per_scenario
        seeds = range(FIRST_EVALUATION_SEED, FIRST_EVALUATION_SEED + count)
        each = {
            made.name: summarize_scores(evaluate(make(made, count), made, seeds, device)) for made in self.evaluated_on
        }
        self.display.evaluation_seconds = time.monotonic() - began
        if self.settings.space is None:
            return each[self.scenario.name]
        rivals = self.history.rivals
        return summarize_scenarios(each, rivals[next(iter(rivals))]["scenarios"] if rivals else each)

    def _draw_curve(self) -> None:
        with self.folder.replacing("curve.png") as path:
            draw_curve(self.settings.out, path)

    def _check_same(self, stored: Card) -> None:
        """Raise ValueError if the folder contains a training with other settings, scenario or code."""
        differences = self.settings.differences(stored.settings)
        there, here = stored.home or {}, self.card.home or {}
        for part in here:
            if part not in ("name", "description") and not differences and there.get(part) != here[part]:
                differences.append(f"{part} of the scenario = {there.get(part)} there, {here[part]} here")
        code = self.card.settings["code"], stored.settings.get("code") or {}
        differences += [f"{part} has changed" for part in code[0] if code[0][part] != code[1].get(part)]
        if differences:
            raise ValueError(
                f"out must be an empty folder or contain a training with the same settings, "
                f"got {self.settings.out}: {'; '.join(differences)}"
            )

    def _network_to_start_from(self) -> Network | None:
        """Read the network given by `start`.

        Raises:
            ValueError: its inputs, base, layers or activation differ from the settings.
        """
        name = self.settings.start
        if name is None:
            return None
        network, card, _ = checkpoint.read(find(name))
        shared = ("inputs", "constants", "base", "base_parameters")
        theirs = {each: getattr(card, each) for each in shared}
        theirs |= {"layers": network.hidden, "activation": network.activation}
        settings = self.settings
        ours = {each: getattr(self.card, each) for each in shared}
        ours |= {"layers": tuple(settings.layers)}
        for what, wanted in (ours | {"activation": settings.activation}).items():
            if theirs[what] != wanted:
                raise ValueError(f"start must have the same {what} ({wanted}), got {name} with {theirs[what]}")
        return network

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
