"""Options that commands share, with their help, tables that never cut a number, JSON, progress on stderr, and errors.

The value of `--set name=value` is a Python literal, which is parsed and never run.
"""

import contextlib
import json
import math
import os
import re
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich import box
from rich import progress as bars
from rich.cells import cell_len
from rich.console import Console
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from lissajous_env.settings.formulas import Formula

_PLACE = r"[^\W\d][\w.]*:[^\W\d][\w.]*"
_WORDS = re.compile(rf"{_PLACE}(,{_PLACE})*|(?!(None|True|False|inf|nan)$)[^\W\d_][\w-]*")
"""A bare word, or `module:name`, also several separated by commas."""
_CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""Characters with which a text could change the terminal: all control characters but the tab and the end of a line."""
_PIPE = 120
"""Width of the output without a terminal and without COLUMNS."""
_GAP = 2
"""Characters between two columns of a table."""
_NARROWEST = 16
"""Least width of a column of prose."""


class CommandError(Exception):
    """Failure of a well-formed command: exit code 1 and one line."""


@dataclass(frozen=True)
class Output:
    """Console output."""

    json: bool = False
    """Print only the result, as JSON; undefined numbers are null."""
    quiet: bool = False
    """Print nothing but errors and the JSON; files are still written."""

    def console(self) -> Console:
        """Return the console for readable results; silent with --json or --quiet."""
        return make_console(quiet=self.quiet or self.json)

    def progress(self) -> Console:
        """Return the console on stderr for progress and notes; silent with --quiet."""
        return make_console(stderr=True, quiet=self.quiet)

    def print(self, words: str | Text, style: str | None = None) -> None:
        """Print a line of a readable result; nothing with --json or --quiet."""
        print_line(self.console(), words, style)

    def print_json(self, result: Any) -> None:
        """Print a result if --json is given."""
        if self.json:
            with contextlib.suppress(BrokenPipeError):  # as `_Console`
                print(json.dumps(plain(result), indent=2, allow_nan=False))


DEFAULT_OUTPUT = Output()
ScenarioName = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENARIO")]
ScenarioNames = Annotated[
    tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="[SCENARIO ...]", help_behavior_hint="")
]
ScenarioOption = Annotated[str | None, tyro.conf.arg(metavar="SCENARIO")]
LogFiles = Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG ...", help_behavior_hint="")]
Device = Annotated[str, tyro.conf.arg(help="device of the simulation: `cpu`, `cuda` or `cuda:k` for CUDA device k.")]
OutFile = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
OutFolder = Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")]
Overrides = Annotated[
    tuple[tuple[str, ...], ...],
    tyro.conf.UseAppendAction,
    tyro.conf.arg(
        name="set",
        metavar="NAME=VALUE ...",
        help="fields changed in every scenario, as in --set task.duration=30 targets.count=5",
        help_behavior_hint="",
    ),
]
"""Type of a command's `--set name=value ...`; `parse_overrides` reads it."""
RogueName = Annotated[
    str | None,
    tyro.conf.arg(
        name="rogues",
        metavar="NAME",
        help="rogue (adversary) that moves all targets: wander, flee, shadow or follow-gap; or a "
        "learned one, such as hide-from-sweep or a folder. By default targets move as the scenario defines.",
    ),
]


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    title: str
    """Title; several lines are allowed."""
    prose: bool = False
    """True for text that may be wrapped; other cells are never broken."""
    left: bool = False
    rank: int = 0
    """Rank; if the width is insufficient, columns of the highest rank are omitted first, from the right."""
    style: str = ""
    name: str = ""
    """Name in the list of omitted columns; by default the title."""


def parse_overrides(groups: Iterable[Iterable[str]], rogues: str | None = None) -> dict[str, Any]:
    """Parse the arguments of `--set`, and of `--rogues`.

    A value is a Python literal (which may contain `inf`), a bare word, or `module:name`.

    Raises:
        ValueError: an entry has no name, is given twice, or has another kind of value.
    """
    overrides: dict[str, Any] = {} if rogues is None else {"rogues": rogues}
    for entry in (entry for group in groups for entry in tuple(group) or ("",)):
        name, equals, text = (part.strip() for part in entry.partition("="))
        if not equals or not name:
            raise ValueError(f"--set must be given as name=value, as in curve.a=5, got {entry!r}")
        if name in overrides:
            raise ValueError(f"--set must give {name} once, got {entry!r} too")
        overrides[name] = text if _WORDS.fullmatch(text) else _literal(name, text)
    return overrides


def _literal(name: str, text: str) -> Any:
    try:
        return Formula(text)({"inf": math.inf}.__getitem__)
    except ValueError:
        rule = "must be given a number, a word or another Python literal without nan"
        raise ValueError(f"--set {name} {rule}, got {text!r}") from None


class _Console(Console):
    """Console whose text cannot change the terminal, and that ends no command when the reader of a pipe has left."""

    def render(self, *arguments: Any, **options: Any) -> Iterator[Segment]:
        """Yield the segments of a renderable, those of text without control characters."""
        for segment in super().render(*arguments, **options):
            yield segment if segment.control else segment._replace(text=_CONTROLS.sub("", segment.text))

    def on_broken_pipe(self) -> None:
        """Print nothing from now on; the command still writes its files."""
        self.quiet = True


def make_console(stderr: bool = False, quiet: bool = False) -> Console:
    """Return a console with the width of COLUMNS or the terminal, or of 120 characters without either."""
    console = _Console(stderr=stderr, quiet=quiet, emoji=False)  # a name between two colons is no emoji
    if not console.is_terminal and not os.environ.get("COLUMNS", "").isdigit():
        console.width = _PIPE
    console.width = min(console.width or 80, 1000)
    return console


def print_table(
    console: Console,
    columns: Sequence[Column | str],
    rows: Sequence[Sequence[str | Text]],
    sections: Sequence[int] = (),
    where: str = "--json has them",
) -> None:
    """Print a table without the columns that do not fit, and a line that names these.

    The first column and one more are always printed, and wrapped in a very narrow terminal.

    Args:
        console: The console.
        columns: The columns, or their titles.
        rows: The cells; strings are printed without markup.
        sections: Indices of the rows that are followed by a rule.
        where: Words on where the values of omitted columns are.
    """
    if console.quiet:
        return
    columns = [Column(column) if isinstance(column, str) else column for column in columns]
    texts = ["\n".join([column.title, *(str(row[k]) for row in rows)]) for k, column in enumerate(columns)]
    line_widths = [max(map(cell_len, text.split("\n"))) for text in texts]
    word_widths = [max(map(cell_len, text.split()), default=0) for text in texts]
    least = [
        max(word, min(_NARROWEST, line)) if column.prose else line
        for word, line, column in zip(word_widths, line_widths, columns, strict=True)
    ]
    indices = list(range(len(columns)))
    while len(indices) > 2 and _width(least, indices) > console.width:
        indices.remove(max(indices[1:], key=lambda k: (columns[k].rank, k)))
    widths = list(line_widths)
    while _width(widths, indices) > console.width and (wide := [k for k in indices if widths[k] > least[k]]):
        widths[max(wide, key=widths.__getitem__)] -= 1
    table = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    table.width = _width(widths, indices)
    for k in indices:
        column = columns[k]
        justify = "left" if column.left or column.prose else "right"
        table.add_column(Text(column.title), justify=justify, style=column.style, width=widths[k])
    for number, row in enumerate(rows):
        shown = [Text(cell) if isinstance(cell, str) else cell for cell in row]
        table.add_row(*(shown[k] for k in indices), end_section=number in sections)
    console.print(table, crop=False)
    names = [column.name or " ".join(column.title.split()) for k, column in enumerate(columns) if k not in indices]
    if names:
        words = f"Columns that do not fit the terminal: {', '.join(names)}. {where}, and a wider terminal shows them."
        print_line(console, words, "yellow")


def print_line(console: Console, words: str | Text, style: str | None = None) -> None:
    """Print text on one line, without markup; the terminal breaks it."""
    console.print(words, style=style, markup=False, highlight=False, soft_wrap=True)


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


class Progress(contextlib.ExitStack):
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


def plain(value: Any) -> Any:
    """Convert a value to JSON types; infinity and functions become words, NaN null, and a dataclass its fields."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain({field.name: getattr(value, field.name) for field in fields(value)})
    if isinstance(value, dict):
        return {str(name): plain(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if hasattr(value, "tolist"):
        array: Any = value
        return plain(array.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    if isinstance(value, (str, int, float, bool, type(None))):
        return value
    return getattr(value, "__qualname__", str(value))  # the text of a function has an address, which changes


def complain(text: str) -> None:
    """Print an error to stderr, in short lines without control characters."""
    shown = "\n".join(_shortened(line) for line in text.strip().splitlines())
    with contextlib.suppress(OSError):  # stderr is closed
        print(shown, file=sys.stderr, flush=True)


def _shortened(line: str) -> str:
    visible = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
    return visible if len(visible) <= 1500 else f"{visible[:750]} ... {visible[-750:]}"


def _width(widths: Any, indices: Sequence[int]) -> int:
    return sum(widths[k] for k in indices) + _GAP * (len(indices) - 1)
