"""What a training shows in the terminal: a bar while it learns, a line for each phase and each evaluation."""

from collections import deque
from collections.abc import Mapping
from datetime import timedelta
from typing import Any

from rich import progress as bars
from rich.console import Console
from rich.markup import escape

from baselines.benchmark.progress import bar, in_words
from training.learned.history import History
from training.settings import TrainingSettings

_UPDATES = 16
"""Latest updates over which the speed is taken, all of the present phase."""


class Display:
    """Bar with phase, speed and time left; lines for what is trained, for phases and for evaluations."""

    def __init__(self, settings: TrainingSettings, console: Console, history: History):
        self._settings, self._console, self._history = settings, console, history
        self._phase, self._latest = "", deque(maxlen=_UPDATES + 1)
        self.evaluation_seconds = 0.0
        """Time that the latest evaluation took [s]."""
        self._bar = bar(console, None, bars.TextColumn("{task.description}"), bars.TextColumn("{task.fields[words]}"))
        self._task = self._bar.add_task("", total=settings.steps, completed=history.steps, left="", words="")

    def __enter__(self) -> "Display":
        settings, history = self._settings, self._history
        title = f"[b]{escape(settings.scenario)}[/b], {settings.algorithm}, {settings.num_worlds} worlds"
        went_on = f", from {_million(history.steps)}" if history.steps else ""
        self.say(f"{title}, {_million(settings.steps)} of a robot{went_on}, to {escape(str(settings.out))}")
        without = "; --base none trains without" if settings.chosen_base is not None and settings.base is None else ""
        self.say(f"base: {escape(settings.chosen_base or 'none')} ({escape(settings.reason_for_base)}{without})")
        for name, scores in history.rivals.items():
            self.say(f"{escape(name)}: {_words(scores)}")
        self._bar.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._bar.__exit__(*error)

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        self._console.print(text, highlight=False, soft_wrap=True)

    def begin(self, phase: str) -> None:
        """Print that a phase begins, where it does; speeds are not compared across phases."""
        if phase != self._phase:
            self._phase = phase
            self._latest.clear()
            self.say(f"{escape(phase)} from {_million(self._history.steps)}")

    def update(self, recent: Mapping[str, float | None]) -> None:
        """Show the scores of the latest episodes, once for each update."""
        history = self._history
        self._latest.append((history.steps, history.seconds))
        # A narrow terminal has room for the speed alone: a number is never cut.
        wide = self._console.width >= 110
        words = ", ".join(filter(None, [self._phase, self.speed, _words(recent) if recent and wide else ""]))
        self._bar.update(
            self._task, description=_million(history.steps), completed=history.steps, words=words, left=self.left
        )

    @property
    def speed(self) -> str:
        """Steps per second of the latest updates in this phase, evaluations left out, in words."""
        pace = self._pace
        return "" if pace is None else f"{pace / 1e3:.1f} k steps/s"

    @property
    def left(self) -> str:
        """Estimate of the time left, in words: the steps at the latest speed, and the evaluations as long as the last.

        Before the last phase the speed of the next one is unknown, so that only the end of this phase is estimated.
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
        how = ", ".join(filter(None, [self._phase, self.speed, self.left]))
        self.say(f"{at}: {_words(point)}" + (f" ({escape(how)})" if how else ""))

    def beaten(self, rival: str, point: Mapping[str, Any]) -> None:
        """Print that the policy is better than a rival for the first time."""
        after = timedelta(seconds=round(point["seconds"]))
        self.say(f"better than {escape(rival)} after {after}, {point['steps']:,} steps")

    def conclude(self) -> None:
        """Print how the best policy compares with each rival, and warn where it is worse."""
        history = self._history
        if history.best is None:
            return
        point = history.best["scores"]
        self.say(f"best policy, after {_million(point['steps'])}: {_words(point)}")
        lost = {rival: worse for rival in history.rivals if (worse := history.losses(rival))}
        for rival, worse in lost.items():
            self.say(f"[yellow]warning: it loses to {escape(rival)}: {'; '.join(worse)}[/yellow]")
        if lost:
            self.say(f"[yellow]{self._advice}[/yellow]")

    @property
    def _advice(self) -> str:
        settings = self._settings
        if settings.chosen_base is None and settings.papers_method[0] is not None:
            return f"--base {settings.papers_method[0]} trains a correction of the paper's method, with which it begins"
        return "more --steps, another --seed or a smaller --residual may help; until then, use the rival"


def _million(steps: float) -> str:
    return f"{steps / 1e6:.1f} M steps" if steps >= 100_000 else f"{steps:,} steps"


def _words(scores: Mapping[str, float | None]) -> str:
    def number(name: str, digits: int) -> str:
        value = scores.get(name)
        return "none" if value is None else f"{value:.{digits}f}"

    return (
        f"detection {number('detection_time', 2)} s, collisions {number('collisions', 2)}, return {number('return', 2)}"
    )
