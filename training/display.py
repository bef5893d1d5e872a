"""What a training shows in the terminal: a bar while it learns, a line for each evaluation."""

import time
from collections.abc import Mapping
from datetime import timedelta
from typing import Any

from rich import progress as bars
from rich.console import Console
from rich.markup import escape

from baselines.benchmark.progress import bar, in_words
from training.learned.history import History
from training.settings import TrainingSettings


class Display:
    """Bar with return, detection time, collisions and steps per second; lines for evaluations."""

    def __init__(self, settings: TrainingSettings, console: Console, history: History):
        self._settings, self._console, self._history = settings, console, history
        self._from, self._since = history.steps, time.monotonic()
        self._bar = bar(console, None, bars.TextColumn("{task.description}"), bars.TextColumn("{task.fields[words]}"))
        self._task = self._bar.add_task(
            "", total=settings.steps, completed=history.steps, before=history.steps, words=""
        )

    def __enter__(self) -> "Display":
        settings, history = self._settings, self._history
        title = f"[b]{escape(settings.scenario)}[/b], {settings.algorithm}, {settings.worlds} worlds"
        went_on = f", from {history.steps / 1e6:.1f} M steps" if history.steps else ""
        self.say(f"{title}, {settings.steps / 1e6:.1f} M steps{went_on}, to {escape(str(settings.out))}")
        for name, scores in history.rivals.items():
            self.say(f"{escape(name)}: {_words(scores)}")
        self._bar.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._bar.__exit__(*error)

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        self._console.print(text, highlight=False, soft_wrap=True)

    def update(self, recent: Mapping[str, float | None]) -> None:
        """Show the scores of the latest episodes."""
        history, now = self._history, time.monotonic()
        pace = (history.steps - self._from) / max(now - self._since, 1e-9)
        # A narrow terminal has room for the pace alone: a number is never cut.
        wide = self._console.width >= 110
        words = f"{pace / 1e3:.0f} k/s" + (f", {_words(recent)}" if recent and wide else "")
        self._bar.update(
            self._task, description=f"{history.steps / 1e6:.1f} M steps", completed=history.steps, words=words
        )

    def evaluated(self, point: Mapping[str, float | None]) -> None:
        """Print a line for an evaluation."""
        at = f"{(point['steps'] or 0) / 1e6:6.1f} M steps, {in_words(point['seconds'] or 0)}"
        self.say(f"{at}: {_words(point)}")

    def beaten(self, rival: str, point: Mapping[str, Any]) -> None:
        """Print that the policy is better than a rival for the first time."""
        after = timedelta(seconds=round(point["seconds"]))
        self.say(f"better than {escape(rival)} after {after}, {point['steps']:,} steps")


def _words(scores: Mapping[str, float | None]) -> str:
    def number(name: str, digits: int) -> str:
        value = scores.get(name)
        return "none" if value is None else f"{value:.{digits}f}"

    return (
        f"detection {number('detection_time', 2)} s, collisions {number('collisions', 2)}, return {number('return', 2)}"
    )
