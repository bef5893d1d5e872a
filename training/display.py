"""Terminal output of a training: a progress bar, and a line per phase and evaluation."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from datetime import timedelta
from typing import Any

from rich import progress as bars
from rich.console import Console
from rich.markup import escape

from baselines.benchmark.progress import bar, in_words
from baselines.policies import registry
from training import scenarios
from training.learned.history import RELATIVE, History
from training.settings import TrainingSettings

_UPDATES = 16
"""Number of latest updates over which the speed is averaged, all in the current phase."""


class Display:
    """Progress bar with phase, speed and remaining time, and lines above it."""

    def __init__(self, settings: TrainingSettings, console: Console, history: History):
        self._settings, self._console, self._history = settings, console, history
        self._phase, self._latest = "", deque(maxlen=_UPDATES + 1)
        self.evaluation_seconds = 0.0
        """Duration of the latest evaluation [s]."""
        self._bar = bar(console, None, bars.TextColumn("{task.description}"), bars.TextColumn("{task.fields[words]}"))
        self._task = self._bar.add_task("", total=settings.steps, completed=history.steps, left="", words="")

    def __enter__(self) -> "Display":
        settings, history = self._settings, self._history
        title = f"[b]{escape(settings.scenario)}[/b], {settings.num_worlds} worlds"
        resumed = f", resumed at {_million(history.steps)}" if history.steps else ""
        self.say(f"{title}, {_million(settings.steps)} over all robots{resumed}, to {escape(str(settings.out))}")
        without = "; --base none trains without" if settings.chosen_base is not None and settings.base is None else ""
        self.say(f"base: {escape(settings.chosen_base or 'none')} ({escape(settings.reason_for_base)}{without})")
        if settings.space is not None:
            learned = f"{settings.num_groups} scenarios at a time from its split {scenarios.LEARNED}"
            count = f"the first {settings.evaluation_scenarios} of {scenarios.EVALUATED}"
            self.say(f"{learned}; evaluated on {count}, {settings.episodes_per_scenario} episodes each")
        else:
            for words in scenarios.about_feedback(settings.make_home_scenario()):
                self.say(escape(words))
        for name in history.rivals:
            self.meet(name)
        self._bar.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._bar.__exit__(*error)

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        self._console.print(text, highlight=False, soft_wrap=True)

    def show(self, words: str) -> None:
        """Show what is done before the training."""
        self._bar.update(self._task, words=escape(words))

    def meet(self, rival: str) -> None:
        """Print the scores of a rival."""
        role = " (the base)" if rival == self._settings.base_label else ""
        self.say(f"{escape(rival)}{role}: {_words(self._history.rivals[rival])}")

    def begin(self, phase: str) -> None:
        """Print the phase if it is new; speed is averaged within a phase."""
        if phase != self._phase:
            self._phase = phase
            self._latest.clear()
            self.say(f"{escape(phase)} from {_million(self._history.steps)}")

    def update(self, recent: Mapping[str, float | None]) -> None:
        """Show the scores of the latest episodes; to be called once per update."""
        history = self._history
        self._latest.append((history.steps, history.seconds))
        # A narrow terminal shows the speed only, so that no number is cut.
        wide = self._console.width >= 110
        words = ", ".join(filter(None, [self._phase, self.speed, _words(recent) if recent and wide else ""]))
        self._bar.update(
            self._task, description=_million(history.steps), completed=history.steps, words=words, left=self.left
        )

    @property
    def speed(self) -> str:
        """Steps per second of the latest updates in this phase, without evaluations, in words."""
        pace = self._pace
        return "" if pace is None else f"{pace / 1e3:.1f} k steps/s"

    @property
    def left(self) -> str:
        """Estimate of the remaining time in words: steps at the latest speed, and evaluations as long as the last one.

        Before the last phase, only the end of the current phase is estimated, because the next speed is unknown.
        """
        settings, steps, pace = self._settings, self._history.steps, self._pace
        ends = [end for end in (settings.imitated_until, settings.steps) if end > steps]
        if pace is None or not ends:
            return ""
        evaluations = ends[0] // settings.evaluate_every - steps // settings.evaluate_every
        if ends[0] == settings.steps and settings.steps % settings.evaluate_every:
            evaluations += 1  # the one at the end
        seconds = (ends[0] - steps) / pace + evaluations * self.evaluation_seconds
        return f"about {in_words(seconds)} left" + ("" if ends[0] == settings.steps else " of this phase")

    @property
    def _pace(self) -> float | None:
        if len(self._latest) < 2:
            return None
        (first, began), (last, now) = self._latest[0], self._latest[-1]
        return (last - first) / max(now - began, 1e-9)

    def evaluated(self, point: Mapping[str, float | None]) -> None:
        """Print a line for an evaluation."""
        at = f"{_million(point['steps'] or 0):>14}, {in_words(point['seconds'] or 0)}"
        how = ", ".join(filter(None, [self._gain(point), self._phase, self.speed, self.left]))
        self.say(f"{at}: {_words(point)}" + (f" ({escape(how)})" if how else ""))

    def _gain(self, point: Mapping[str, Any]) -> str:
        """Return the change of the detection time from the base or, without one, from the untrained policy, in words.

        It is "" if there is nothing to compare with.
        """
        if point["steps"] == 0:
            return "untrained"
        label = self._settings.base_label
        before, than = self._history.rivals.get(label), f"the base {label}"
        if before is None and self._history.curve:
            before, than = self._history.curve[0], "the untrained policy"
        time, now = (before or {}).get("detection_time"), point["detection_time"]
        if not time or now is None:
            return ""
        return f"{abs(now / time - 1):.1%} {'faster' if now < time else 'slower'} than {than}"

    def beaten(self, rival: str, point: Mapping[str, Any]) -> None:
        """Print that the policy is better than a rival for the first time."""
        if point["steps"] == 0:
            self.say(f"the untrained policy is better than {escape(rival)} already")
            return
        after = timedelta(seconds=round(point["seconds"]))
        self.say(f"better than {escape(rival)} after {after}, {point['steps']:,} steps")

    def conclude(self) -> None:
        """Print the scores of the best policy, and a warning for each rival to which it loses."""
        history = self._history
        if history.best is None:
            return
        point = history.best
        gain = "training has not improved it" if point["steps"] == 0 else self._gain(point)
        self.say(
            f"best policy, after {_million(point['steps'])}: {_words(point)}" + (f" ({escape(gain)})" if gain else "")
        )
        lost = {rival: worse for rival in history.rivals if (worse := history.losses(rival))}
        for rival, worse in lost.items():
            self.say(f"[yellow]warning: it loses to {escape(rival)}: {'; '.join(worse)}[/yellow]")
        if lost:
            self.say(f"[yellow]{escape(self._advice(list(lost)))}[/yellow]")

    def _advice(self, lost: Sequence[str]) -> str:
        """Return what may help against the rivals to which the best policy loses."""
        possible = [rival for rival in lost if rival != self._settings.base_label and registry.is_classical(rival)]
        if possible:
            times = {rival: self._history.rivals[rival]["detection_time"] or math.inf for rival in possible}
            fastest = min(possible, key=lambda rival: times[rival])
            return f"--base {fastest} trains a correction of {fastest}, which starts as good as it"
        return "more --steps, another --seed or a smaller --residual may help; until then, use the rival"


def _million(steps: float) -> str:
    return f"{steps / 1e6:.1f} M steps" if steps >= 100_000 else f"{steps:,} steps"


def _words(scores: Mapping[str, float | None]) -> str:
    def number(name: str, digits: int) -> str:
        value = scores.get(name)
        return "none" if value is None else f"{value:.{digits}f}"

    relative = "" if RELATIVE not in scores else f" ({number(RELATIVE, 3)} of the first rival's)"
    counts = f"collisions {number('collisions', 2)}, return {number('return', 2)}"
    return f"detection {number('detection_time', 2)} s{relative}, {counts}"
