"""Progress of long work, on stderr: a bar in a terminal, a line for each finished piece elsewhere."""

import time
from typing import Any

from rich import progress as bars
from rich.console import Console
from rich.markup import escape
from rich.text import Text

_EVERY = 0.1
"""Time between two updates of the bar [s]; drawing it more often would slow down short steps."""
_FIRST = 2.0
"""Time after which a guess of the time left is worth a word [s]."""


class Clock(bars.ProgressColumn):
    """Time gone and time left, in words; what is left is said once there is something to judge by."""

    def render(self, task: bars.Task) -> Text:
        """Words for a task; its field `left` says what is left where the pace so far does not tell."""
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
    """Bar in a terminal, nothing elsewhere; where it is narrow the bar itself goes first, then the name."""
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


class Progress:
    """Shows the current scenario and policy, the episodes done, the time gone and the time left."""

    def __init__(self, work: list[tuple[Any, list[int]]], console: Console):
        """Take the cells to play, each with the numbers of the episodes that are left to play."""
        self._console = console
        self._left = {id(cell): len(numbers) for cell, numbers in work}
        self._total = sum(len(numbers) * cell.scenario.task.steps for cell, numbers in work)
        self._episodes, self._done = sum(self._left.values()), 0
        self._gone, self._shown, self._began, self._name = 0.0, 0.0, 0.0, ""
        counted = bars.TextColumn("{task.fields[done]}/{task.fields[episodes]} episodes")
        self._bar = bar(console, bars.TextColumn("{task.description}"), counted)
        self._task = self._bar.add_task("", total=max(self._total, 1), done=0, episodes=self._episodes)

    def begin(self, cell: Any) -> None:
        """Go on to the next cell."""
        self._cell, self._cell_done, self._began = cell, 0, time.monotonic()
        self._name = f"{escape(cell.scenario.name)} [bold cyan]{escape(cell.policy)}[/]"
        self._bar.update(self._task, description=f"{self._name} [dim]preparing[/]", refresh=True)

    def step(self, worlds: int) -> None:
        """Note that a batch of some worlds took a step."""
        self._gone += min(worlds, self._left[id(self._cell)] - self._cell_done)
        now = time.monotonic()
        if now - self._shown > _EVERY:
            self._shown = now
            self._bar.update(self._task, description=self._name, completed=self._gone)

    def finished(self, episodes: int) -> None:
        """Note that some episodes have ended."""
        self._cell_done += episodes
        self._done += episodes
        self._bar.update(self._task, done=self._done)

    def end(self, word: str = "") -> None:
        """Note that the cell is over."""
        skipped = self._left[id(self._cell)] - self._cell_done
        self._total -= skipped * self._cell.scenario.task.steps
        self._bar.update(self._task, total=max(self._total, 1), completed=self._gone)
        if not self._console.is_interactive:
            took = time.monotonic() - self._began
            counted = "1 episode" if self._cell_done == 1 else f"{self._cell_done} episodes"
            self._console.print(f"{self._name}: {word or counted}, {took:.1f} s", highlight=False, soft_wrap=True)

    def __enter__(self) -> "Progress":
        self._bar.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._bar.__exit__(*error)
