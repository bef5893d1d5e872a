"""The command `lissajous`: finds the commands that are installed, runs one, and turns errors into one clear line.

A command is a typed function named by an entry point in the group `lissajous_env.commands`, so that packages which
build on this one can add their own. Its signature is its command line; its docstring is its help.
"""

import ast
import difflib
import importlib.util
import io
import os
import re
import sys
from collections.abc import Iterable, Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Annotated, Any

import tyro

GROUP = "lissajous_env.commands"
BAD_INPUT = 2
INTERRUPTED = 130

Overrides = Annotated[
    tuple[tuple[str, ...], ...],
    tyro.conf.UseAppendAction,
    tyro.conf.arg(name="set", metavar="NAME=VALUE ...", help_behavior_hint=""),
]
"""Type of a command's `--set name=value ...`; `parse_overrides` reads it."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `lissajous`; ends the process with the command's exit code: 2 for bad input, 130 after Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that lacks a character shows "?" instead of failing
    try:
        sys.exit(_dispatch(list(sys.argv[1:] if arguments is None else arguments)))
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    except BrokenPipeError:
        # Who read the output has seen enough; what is still buffered must not fail again when the process ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt as interrupt:
        # What a command has to say about how to go on travels with the interrupt.
        print(f"\ninterrupted{''.join(f'; {word}' for word in interrupt.args)}", file=sys.stderr)
        sys.exit(INTERRUPTED)


def commands() -> dict[str, EntryPoint]:
    """Return the commands that are installed, by name."""
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name)}


def parse_overrides(groups: Iterable[Iterable[str]]) -> dict[str, Any]:
    """Read what `--set` was given: `name=value`, the value a Python literal, a bare word or `inf`.

    Raises:
        ValueError: an entry without a name or with a value that is none of these.
    """
    overrides = {}
    for entry in (entry for group in groups for entry in group):
        name, equals, text = entry.partition("=")
        if not equals or not name:
            raise ValueError(f"--set must be given as name=value, as in curve.a=5, got {entry!r}")
        overrides[name.strip()] = _value(name, text.strip())
    return overrides


def _dispatch(arguments: list[str]) -> int:
    known = commands()
    if not arguments or arguments[0] in ("-h", "--help"):
        _print_help(known)
        return 0
    name = arguments[0]
    if name == "--version":
        from importlib.metadata import version

        print(f"lissajous-env {version('lissajous-env')}")
        return 0
    if name not in known:
        nearest = difflib.get_close_matches(name, known, n=1, cutoff=0.0)
        hint = f"; did you mean {nearest[0]}?" if nearest else ""
        raise ValueError(f"command must be one of {', '.join(known)}, got {name!r}{hint}")
    try:
        function = known[name].load()
    except ImportError as error:
        raise OSError(f"the command {name} cannot be loaded: {error}") from error
    result = tyro.cli(function, prog=f"lissajous {name}", args=arguments[1:])
    return result if isinstance(result, int) else 0


def _print_help(known: dict[str, EntryPoint]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    console.print("usage: lissajous [b]COMMAND[/b] ...\n")
    console.print("Monitor an area with a team of robots on Lissajous curves.\n")
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False, pad_edge=False)
    widest = max(map(len, known), default=0)
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    for name, entry in known.items():
        summary = Text(_summary(entry))
        summary.truncate(max(console.width - widest - 6, 10), overflow="ellipsis")
        table.add_row(f"  [bold cyan]{name}", summary)
    console.print(table)
    console.print("\n[b]lissajous COMMAND --help[/b] lists the options of a command.", highlight=False)


def _summary(entry: EntryPoint) -> str:
    """First line of a command's docstring, read from its source: importing every command would take seconds."""
    top = importlib.util.find_spec(entry.module.partition(".")[0])
    for folder in (top.submodule_search_locations or []) if top else []:
        path = Path(folder, *entry.module.split(".")[1:]).with_suffix(".py")
        if not path.exists():
            path = path.with_suffix("") / "__init__.py"
        if path.exists():
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.name == entry.attr:
                    return (ast.get_docstring(node) or "").partition("\n")[0]
    return ""


def _value(name: str, text: str) -> Any:
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        pass
    if text == "inf":
        return float("inf")
    if re.fullmatch(r"[A-Za-z][\w-]*", text):
        return text
    raise ValueError(f"--set {name} must be given a number, a word or another Python literal, got {text!r}")
