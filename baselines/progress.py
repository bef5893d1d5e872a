"""Progress of long work, on stderr: a bar in a terminal, a line for each finished piece elsewhere."""

import time
from typing import Any

from rich import progress as bars
from rich.console import Console

_EVERY = 0.1
"""Time between two updates of the bar [s]; drawing it more often would slow down short steps."""


class Progress:
    """Shows the current scenario and policy, the episodes done, the time gone and the time left."""

    def __init__(self, work: list[tuple[Any, list[int]]], quiet: bool = False):
        """Take the cells to play, each with the numbers of the episodes that are left to play."""
        self._console = console = Console(stderr=True, quiet=quiet)
        self._left = {id(cell): len(numbers) for cell, numbers in work}
        self._total = sum(len(numbers) * cell.scenario.task.steps for cell, numbers in work)
        self._episodes, self._done = sum(self._left.values()), 0
        self._gone, self._shown, self._began, self._name = 0.0, 0.0, 0.0, ""
        self._bar = bars.Progress(
            bars.TextColumn("{task.description}"),
            bars.BarColumn(bar_width=None),
            bars.TextColumn("{task.fields[done]}/{task.fields[episodes]} episodes"),
            bars.TimeElapsedColumn(),
            bars.TextColumn("left"),
            bars.TimeRemainingColumn(),
            console=console,
            transient=True,
            expand=True,
            disable=not console.is_terminal,
        )
        self._task = self._bar.add_task("", total=max(self._total, 1), done=0, episodes=self._episodes)

    def begin(self, cell: Any) -> None:
        """Go on to the next cell."""
        self._cell, self._cell_done, self._began = cell, 0, time.monotonic()
        self._name = f"{cell.scenario.name} [bold cyan]{cell.policy}[/]"
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
        if not self._console.is_terminal:
            took = time.monotonic() - self._began
            counted = "1 episode" if self._cell_done == 1 else f"{self._cell_done} episodes"
            self._console.print(f"{self._name}: {word or counted}, {took:.1f} s", highlight=False)

    def __enter__(self) -> "Progress":
        self._bar.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._bar.__exit__(*error)
