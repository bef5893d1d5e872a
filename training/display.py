"""Terminal output of a training: a progress bar, and a line per phase and evaluation."""

from collections import deque
from collections.abc import Mapping
from datetime import timedelta
from typing import Any

from rich import progress as bars
from rich.console import Console
from rich.markup import escape

from baselines.benchmark.progress import bar, in_words
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
        title = f"[b]{escape(settings.scenario)}[/b], {settings.algorithm}, {settings.num_worlds} worlds"
        resumed = f", resumed at {_million(history.steps)}" if history.steps else ""
        self.say(f"{title}, {_million(settings.steps)} over all robots{resumed}, to {escape(str(settings.out))}")
        without = "; --base none trains without" if settings.chosen_base is not None and settings.base is None else ""
        self.say(f"base: {escape(settings.chosen_base or 'none')} ({escape(settings.reason_for_base)}{without})")
        if settings.space is not None:
            learned = f"{settings.num_groups} scenarios at a time from its split {scenarios.LEARNED}"
            count = f"the first {settings.evaluation_scenarios} of {scenarios.EVALUATED}"
            self.say(f"{learned}; evaluated on {count}, {settings.episodes_per_scenario} episodes each")
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
        how = ", ".join(filter(None, [self._phase, self.speed, self.left]))
        self.say(f"{at}: {_words(point)}" + (f" ({escape(how)})" if how else ""))

    def beaten(self, rival: str, point: Mapping[str, Any]) -> None:
        """Print that the policy is better than a rival for the first time."""
        after = timedelta(seconds=round(point["seconds"]))
        self.say(f"better than {escape(rival)} after {after}, {point['steps']:,} steps")

    def conclude(self) -> None:
        """Print the scores of the best policy, and a warning for each rival to which it loses."""
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
            return (
                f"--base {settings.papers_method[0]} trains a correction of the paper's method, starting as good as it"
            )
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
