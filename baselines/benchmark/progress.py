"""Progress of long work, on stderr: a bar in a terminal, a line for each finished piece elsewhere."""

import time
from contextlib import ExitStack
from typing import Any

from rich import progress as bars
from rich.console import Console

from lissajous_env.console.terminal import print_line


def bar(console: Console, counts: str = "") -> bars.Progress:
    """Return a bar with a description, counts and the elapsed and the remaining time for a terminal; none elsewhere.

    A narrow terminal omits first the bar itself, then the description.

    Args:
        console: The console.
        counts: Format of the counts, such as "{task.completed} replays".
    """
    description = bars.TextColumn("{task.description}", markup=False)  # names may contain brackets
    columns: list[bars.ProgressColumn] = [description] if console.width >= 80 else []
    columns += [bars.BarColumn(bar_width=None)] if console.width >= 100 else []
    columns += [bars.TextColumn(counts)] if counts else []
    return bars.Progress(
        *columns,
        bars.TimeElapsedColumn(),
        bars.TimeRemainingColumn(),
        console=console,
        transient=True,
        expand=console.width >= 100,
        disable=not console.is_interactive or console.quiet,
    )


class Progress(ExitStack):
    """Display of the finished episodes, the elapsed and the remaining time; cells may be played at the same time.

    Args:
        work: Cells to play, each with the numbers of the episodes that are left to play.
        console: Console on which it is shown.
    """

    def __init__(self, work: list[tuple[Any, list[int]]], console: Console):
        super().__init__()
        self._console = console
        self._left = {id(cell): len(numbers) for cell, numbers in work}
        self._began: dict[int, float] = {}
        self._bar = self.enter_context(bar(console, "{task.completed}/{task.total} episodes"))
        self._task = self._bar.add_task("", total=sum(self._left.values()))

    def begin(self, cell: Any) -> None:
        """Show that a cell begins."""
        self._began.setdefault(id(cell), time.monotonic())
        self._bar.update(self._task, description=str(cell))

    def finished(self, cell: Any, episodes: int | None = None, word: str = "played") -> None:
        """Show that some episodes of a cell have ended, by default all that are left; then the cell is over.

        The word states how it ended.
        """
        left = self._left[id(cell)]
        if not left:  # the cell failed, and a batch of it that was being played has ended
            return
        ended = left if episodes is None else min(episodes, left)
        self._left[id(cell)] -= ended
        self._bar.update(self._task, description=str(cell), advance=ended)
        if not self._left[id(cell)] and not self._console.is_interactive:
            took = time.monotonic() - self._began[id(cell)]
            print_line(self._console, f"{cell}: {word}, {took:.1f} s")
