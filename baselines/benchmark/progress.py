"""Progress of long work, on stderr: a bar in a terminal, a line for each finished piece elsewhere."""

import threading
import time
from dataclasses import dataclass
from typing import Any

from rich import progress as bars
from rich.console import Console
from rich.markup import escape
from rich.text import Text

_EVERY = 0.1
"""Time between two updates of the bar [s]; drawing it more often would slow down short steps."""
_FIRST = 2.0
"""Time after which the remaining time is shown [s]."""


class Clock(bars.ProgressColumn):
    """Elapsed and remaining time, in words; the remaining time is shown as soon as it can be estimated."""

    def render(self, task: bars.Task) -> Text:
        """Return words for a task; its field `left` is the remaining work if the pace so far does not determine it."""
        gone, done, left = task.elapsed or 0.0, task.completed, task.fields.get("left")
        words = in_words(gone)
        if left is not None:
            words += f", {left}" if left else ""
        elif task.total and done > 0 and gone > _FIRST and not task.finished:
            words += f", {in_words(gone / done * (task.total - task.completed))} left"
        return Text(words, style="cyan", no_wrap=True)


def in_words(seconds: float) -> str:
    """Return a duration in words, as `1 min 20 s`; above a minute to 5 s, above an hour to a minute."""
    if round(seconds) < 60:
        return f"{seconds:.0f} s"
    if (rounded := 5 * round(seconds / 5)) < 3600:
        minutes, rest = divmod(rounded, 60)
        return f"{minutes} min {rest} s" if rest else f"{minutes} min"
    hours, minutes = divmod(round(seconds / 60), 60)
    days, hours = divmod(hours, 24)
    return f"{days} d {hours} h" if days else f"{hours} h {minutes} min" if minutes else f"{hours} h"


def bar(console: Console, name: bars.ProgressColumn | None, *numbers: bars.ProgressColumn) -> bars.Progress:
    """Return a bar for a terminal, and none elsewhere; a narrow terminal omits first the bar itself, then the name."""
    shown = [name] if name is not None and console.width >= 80 else []
    shown += [bars.BarColumn(bar_width=None)] if console.width >= 100 else []
    return bars.Progress(
        *shown,
        *numbers,
        Clock(),
        console=console,
        transient=True,
        expand=console.width >= 100,
        disable=not console.is_interactive or console.quiet,
    )


@dataclass
class _Cell:
    """Name and progress of a cell."""

    name: str
    steps: int
    left: int
    """Episodes that are left to play."""
    began: float = 0.0
    steps_done: int = 0
    """Steps of the episodes that are being played."""
    played: int = 0
    """Episodes that have ended."""


class Progress:
    """Display of the finished episodes, the elapsed and the remaining time; cells may be played at the same time.

    Args:
        work: Cells to play, each with the numbers of the episodes that are left to play.
        console: Console on which it is shown.
    """

    def __init__(self, work: list[tuple[Any, list[int]]], console: Console):
        self._console, self._lock = console, threading.Lock()
        self._cells = {
            id(cell): _Cell(f"{escape(cell.scenario.name)} [bold cyan]{escape(cell.policy)}[/]", steps, len(numbers))
            for cell, numbers in work
            for steps in [cell.scenario.task.steps]
        }
        self._total = sum(cell.left * cell.steps for cell in self._cells.values())
        self._done, self._shown = 0, 0.0
        counted = bars.TextColumn("{task.fields[done]}/{task.fields[episodes]} episodes")
        self._bar = bar(console, bars.TextColumn("{task.description}"), counted)
        episodes = sum(cell.left for cell in self._cells.values())
        self._task = self._bar.add_task("", total=max(self._total, 1), done=0, episodes=episodes)

    def begin(self, cell: Any) -> None:
        """Show that a cell begins."""
        with self._lock:
            this = self._cells[id(cell)]
            this.began = this.began or time.monotonic()
            self._bar.update(self._task, description=f"{this.name} [dim]preparing[/]", refresh=True)

    def step(self, cell: Any, worlds: int) -> None:
        """Show that a batch of some worlds took a step."""
        with self._lock:
            this, now = self._cells[id(cell)], time.monotonic()
            this.steps_done += min(worlds, this.left - this.played)
            if now - self._shown > _EVERY:
                self._shown = now
                self._bar.update(self._task, description=this.name, completed=self._gone())

    def finished(self, cell: Any, episodes: int) -> None:
        """Show that some episodes have ended; with the last of a cell, the cell is over."""
        with self._lock:
            this = self._cells[id(cell)]
            this.played += episodes
            this.steps_done = 0
            self._done += episodes
            self._bar.update(self._task, completed=self._gone(), done=self._done)
            if this.played == this.left:
                self._print(this, "1 episode" if this.played == 1 else f"{this.played} episodes")

    def failed(self, cell: Any, word: str) -> None:
        """Show that a cell is over before its last episode; the word states how it ended."""
        with self._lock:
            this = self._cells[id(cell)]
            self._total -= (this.left - this.played) * this.steps
            this.steps_done = 0
            self._bar.update(self._task, total=max(self._total, 1), completed=self._gone())
            self._print(this, word)

    def _print(self, cell: _Cell, words: str) -> None:
        if not self._console.is_interactive:
            took = time.monotonic() - cell.began
            self._console.print(f"{cell.name}: {words}, {took:.1f} s", highlight=False, soft_wrap=True)

    def _gone(self) -> int:
        """Return the number of steps so far in all worlds."""
        return sum(cell.played * cell.steps + cell.steps_done for cell in self._cells.values())

    def __enter__(self) -> "Progress":
        self._bar.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._bar.__exit__(*error)
