"""The command `lissajous`: run an installed command, and print errors as one clear line.

A command is a typed function named by an entry point in the group `lissajous_env.commands`, so that other
packages can add commands. The signature of the function is the command line; its docstring is the help. A dot in the
name of an entry point separates two words: `ros.robot` is the command `lissajous ros robot`.
"""

import ast
import contextlib
import functools
import importlib.util
import io
import os
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import tyro

from lissajous_env import siblings
from lissajous_env.console import interrupts
from lissajous_env.console.help import print_help
from lissajous_env.console.interrupts import INTERRUPTED
from lissajous_env.console.terminal import CommandError, complain, make_console
from lissajous_env.device import kernel_cache
from lissajous_env.wording import few_of, nearest, shown, where_raised

GROUP = "lissajous_env.commands"
FAILED = 1
BAD_INPUT = 2
TRACEBACK = "LISSAJOUS_TRACEBACK"
"""Environment variable that enables tracebacks."""
ROS_ARGUMENTS = "--ros-args"
"""Argument from which on the arguments of a command `ros ...` are those of ROS 2, which reads them itself."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `lissajous` and end the process with an exit code: 2 for bad input, 130 after Ctrl-C."""
    _open_streams()
    os.environ.pop("MPLBACKEND", None)  # matplotlib refuses that of a notebook elsewhere; pictures need none
    code = _ended(list(sys.argv[1:] if arguments is None else arguments))
    try:
        sys.stdout.flush()
    except OSError as error:
        # The reader closed the pipe, or the disk is full; the remaining output must not fail again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = code or FAILED
        if not isinstance(error, BrokenPipeError):
            complain(f"error: the output cannot be written: {error.strerror}")
    sys.exit(code)


def commands() -> dict[str, EntryPoint]:
    """Return the installed commands by name."""
    found = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    return {entry.name.replace(".", " "): entry for entry in found}


def _ended(arguments: list[str]) -> int:
    """Run a command and return its exit code; print errors as one line."""
    try:
        with _short_warnings():
            return _dispatch(arguments)
    except SystemExit as ended:  # the reader closed the pipe
        return ended.code if isinstance(ended.code, int) else 0
    except ValueError as error:
        return _failed(BAD_INPUT, error, str(error))
    except BrokenPipeError:
        return FAILED
    except (CommandError, OSError) as error:
        return _failed(FAILED, error, str(error))
    except KeyboardInterrupt as interrupt:
        # The arguments of the interrupt explain how to resume.
        complain(f"interrupted{''.join(f'; {word}' for word in interrupt.args)}")
        return INTERRUPTED
    except Exception as error:
        return _failed(FAILED, error, f"{type(error).__name__}: {error}; set {TRACEBACK}=1 for the traceback")


def _failed(code: int, error: Exception, words: str) -> int:
    if os.environ.get(TRACEBACK):
        print("".join(traceback.format_exception(error)), file=sys.stderr)
    complain(f"error: {words}")
    return code


def _dispatch(arguments: list[str]) -> int:
    known = commands()
    _check_text(arguments)
    if not arguments or arguments[0] in ("-h", "--help"):
        _print_help(known)
        return 0
    words = 2 if " ".join(arguments[:2]) in known else 1
    name = " ".join(arguments[:words])
    if name in ("-V", "--version"):
        from importlib.metadata import version

        print(f"lissajous-env {version('lissajous-env')}")
        return 0
    group = {each: entry for each, entry in known.items() if each.startswith(f"{name} ")}
    if group and {"-h", "--help"} & set(arguments[1:2]):
        _print_help(group)
        return 0
    if group:
        raise ValueError(f"{name} must be followed by {few_of([each.partition(' ')[2] for each in group])}")
    if name not in known:
        raise ValueError(f"command must be one of {few_of(known, name)}, got {shown(name)}{nearest(name, known)}")
    if name.startswith("ros ") and ROS_ARGUMENTS in arguments:
        arguments = arguments[: arguments.index(ROS_ARGUMENTS)]
    quiet = "--quiet" in arguments
    kernel_cache.listener = None if quiet else complain
    if quiet:
        warnings.simplefilter("ignore")  # warnings of libraries
    with contextlib.suppress(OSError):  # the folder was removed
        siblings.look_first_in(os.getcwd())
    try:
        function = siblings.load_entry_point(known[name])
    except Exception as error:
        raise CommandError(f"the command {name} cannot be loaded: {type(error).__name__}: {error}") from error
    program = f"lissajous {name}"
    if {"-h", "--help"} & set(arguments):
        print_help(function, program)
        return 0
    given, named = _bound(function, program, arguments[words:])
    try:
        with interrupts.raised():
            result = function(*given, **named)
    except SystemExit as ended:
        if isinstance(ended.__context__, BrokenPipeError):  # Rich found a closed pipe
            raise
        raise CommandError(f"{name} was ended from within: {where_raised(ended)}") from ended
    return result if isinstance(result, int) else 0


def _bound(function: Callable[..., Any], program: str, arguments: list[str]) -> tuple[tuple, dict[str, Any]]:
    """Return the arguments of a command's function from a command line, without calling it.

    Raises:
        ValueError: the command line is invalid.
    """

    @functools.wraps(function)
    def bind(*given: Any, **named: Any) -> Any:
        return given, named

    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), _wide_frames():
            return tyro.cli(bind, prog=program, args=arguments)
    except SystemExit:
        words = _without_frame(said.getvalue())
        # Errors of the settings themselves need no hint.
        refused = re.fullmatch(r"error parsing \w+: (.*)", words)
        raise ValueError(refused[1] if refused else f"{words}\n{program} --help prints the options") from None


@contextlib.contextmanager
def _short_warnings() -> Iterator[None]:
    """Print each warning on one line, without its place in the code."""
    before = warnings.formatwarning
    warnings.formatwarning = lambda message, *_, **__: f"warning: {message}\n"
    try:
        yield
    finally:
        warnings.formatwarning = before


@contextlib.contextmanager
def _wide_frames() -> Iterator[None]:
    """Make tyro print its messages without line breaks."""
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "10000"
    try:
        yield
    finally:
        del os.environ["COLUMNS"]
        if before is not None:
            os.environ["COLUMNS"] = before


def _without_frame(said: str) -> str:
    """Return the message in tyro's frame as one line, with similar options."""
    lines = re.sub(r"\x1b\[[0-9;]*m", "", said).splitlines()
    # The frame has a title and a last line; without line characters the title is underlined.
    underlined = bool(lines[1:]) and not lines[1].strip(" -")
    inside = "\n".join(line.strip("\u2502| ") for line in lines[1 + underlined : -1])
    first, *others = re.split(r"\n?^[\u2500-]{3,}$\n?", inside, flags=re.MULTILINE)
    words = " ".join(first.split()) or "the command line cannot be read"
    for part in others:
        if part.startswith("Perhaps"):
            near = [line for line in part.splitlines() if line.startswith("-")]
            words += f"; did you mean {', '.join(near)}?"
    return words[:1].lower() + words[1:]


def _check_text(arguments: list[str]) -> None:
    """Check that no argument is empty or invalid text.

    Raises:
        ValueError: an argument is empty or contains bytes that are not UTF-8.
    """
    for number, argument in enumerate(arguments):
        if not argument or re.fullmatch(r"--[\w-]+=", argument):
            before = argument.rstrip("=") or next(
                (a for a in arguments[number - 1 :: -1] if number and a), "an argument"
            )
            raise ValueError(f"{' '.join(before.split())[:160]} must be followed by a value, got ''")
        if "\0" in argument or any("\ud800" <= c <= "\udfff" for c in argument):
            raise ValueError(f"arguments must be text in UTF-8, got {argument!r}")


def _open_streams() -> None:
    """Replace closed streams, and replace characters that the terminal cannot print."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            # Occupy the descriptor; otherwise a file would get it, and with it the printed output.
            os.open(os.devnull, os.O_RDWR)
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if number == 0 else "w"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # prints "?" instead


def _print_help(known: dict[str, EntryPoint]) -> None:
    from rich.table import Table
    from rich.text import Text

    console = make_console()
    console.print("usage: lissajous [b]COMMAND[/b] ...\n")
    console.print("Simulate, compare and train teams of robots that monitor an area and detect targets.\n")
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False, pad_edge=False)
    table.add_column(no_wrap=True)
    for name, entry in known.items():
        table.add_row(f"  [bold cyan]{name}", Text(_summary(entry)))
    console.print(table)
    words = "\n[b]lissajous COMMAND --help[/b] prints the options of a command, [b]--version[/b] the version."
    console.print(words, highlight=False)


def _summary(entry: EntryPoint) -> str:
    """Return the first line of a command's docstring from its source, since imports would take seconds."""
    name = entry.module.partition(".")[0]
    top = None if name in siblings.NAMES else importlib.util.find_spec(name)
    for folder in [siblings.PARENT / name] if top is None else top.submodule_search_locations or ():
        path = Path(folder, *entry.module.split(".")[1:]).with_suffix(".py")
        if not path.exists():
            path = path.with_suffix("") / "__init__.py"
        if path.exists():
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.name == entry.attr:
                    return (ast.get_docstring(node) or "").partition("\n")[0]
    return ""
