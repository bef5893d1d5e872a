"""The command `lissajous`: run an installed command, and print errors as one clear line.

A command is a typed function named by an entry point in the group `lissajous_env.commands`, so that other
packages can add commands. The signature of the function is the command line; its docstring is the help; a whole number
that it returns is the exit code. A dot in the name of an entry point separates two words: `ros.robot` is the command
`lissajous ros robot`.

Each `--import MODULE` or `--import=MODULE`, anywhere on the command line, first imports a module, also from the current
folder. The command then accepts the names that it registers, of scenarios, policies, robot models and rogues.
"""

import ast
import gc
import importlib.util
import inspect
import io
import os
import sys
import traceback
import warnings
from collections.abc import Mapping, Sequence
from importlib.metadata import EntryPoint, entry_points, version
from pathlib import Path

import tyro

from lissajous_env.console import interrupts
from lissajous_env.console.interrupts import INTERRUPTED
from lissajous_env.console.terminal import CommandError, complain, make_console
from lissajous_env.device import compilation
from lissajous_env.plugins import import_module, search_current_folder
from lissajous_env.wording import few_of, require, shown, where_raised

GROUP = "lissajous_env.commands"
FAILED = 1
BAD_INPUT = 2
TRACEBACK = "LISSAJOUS_TRACEBACK"
"""Environment variable that enables tracebacks."""
_OPTIONS = tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff
"""Form of options: --field for a field of a dataclass, and no --no-flag beside --flag."""
IMPORT = "--import"
ROS_ARGUMENTS = "--ros-args"
"""Argument from which on the arguments of a command `ros ...` are those of ROS 2, which reads them itself."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `lissajous` and end the process with an exit code: 2 for bad input, 130 after Ctrl-C."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # prints "?" for characters that the terminal does not have
    os.environ.pop("MPLBACKEND", None)  # matplotlib refuses that of a notebook elsewhere; pictures need none
    warnings.formatwarning = lambda message, *_, **__: f"warning: {message}\n"  # without its place in the code
    code = _exit_code(list(sys.argv[1:] if arguments is None else arguments))
    for stream in filter(None, (sys.stdout, sys.stderr)):
        try:
            stream.flush()
        except OSError as error:
            # The remaining output must not fail again at exit.
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
            if not isinstance(error, BrokenPipeError):  # the disk is full; a reader of a pipe may leave when it likes
                code = code or FAILED
                complain(f"error: the output cannot be written: {error.strerror}")
    sys.exit(code)


def commands() -> dict[str, EntryPoint]:
    """Return the installed commands by name."""
    entries = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    return {entry.name.replace(".", " "): entry for entry in entries}


def _exit_code(arguments: list[str]) -> int:
    """Run a command and return its exit code; print errors as one line."""
    try:
        return _run(arguments)
    except SystemExit as end:  # of tyro after the help or an error, of rich after a closed pipe, or of a command
        if end.code is None or isinstance(end.code, int):
            return int(end.code or 0)
        return _failed(FAILED, end, str(end.code))
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
        return _failed(FAILED, error, f"{where_raised(error)}; set {TRACEBACK}=1 for the traceback")


def _failed(code: int, error: BaseException, words: str) -> int:
    if os.environ.get(TRACEBACK):
        print("".join(traceback.format_exception(error)), file=sys.stderr)
    complain(f"error: {words}")
    return code


def _run(arguments: list[str]) -> int:
    known = commands()
    arguments = _import_modules(arguments)
    if not arguments or arguments[0] in ("-h", "--help"):
        _print_commands(known)
        return 0
    if arguments[0] in ("-V", "--version"):
        print(f"lissajous-env {version('lissajous-env')}")
        return 0
    words = 2 if " ".join(arguments[:2]) in known else 1
    name, options = " ".join(arguments[:words]), arguments[words:]
    group = {command: entry for command, entry in known.items() if command.startswith(f"{name} ")}
    if group and options[:1] in (["-h"], ["--help"]):
        _print_commands(group)
        return 0
    if group:
        raise ValueError(f"{name} must be followed by {few_of([command.partition(' ')[2] for command in group])}")
    require(name in known, "command", f"must be one of {few_of(known, name)}", name, known)
    if name.startswith("ros ") and ROS_ARGUMENTS in options:
        options = options[: options.index(ROS_ARGUMENTS)]
    quiet = "--quiet" in options
    compilation.listener = None if quiet else complain
    if quiet:
        warnings.simplefilter("ignore")  # warnings of libraries
    search_current_folder()
    try:
        function = known[name].load()
    except Exception as error:
        raise CommandError(f"the command {name} cannot be loaded: {type(error).__name__}: {error}") from error
    finally:
        if not gc.isenabled():  # since the import of `interrupts`
            gc.freeze()
            gc.enable()
    description = (inspect.getdoc(function) or "").partition("\nArgs:")[0]
    with interrupts.raised():
        result = tyro.cli(function, prog=f"lissajous {name}", description=description, args=options, config=_OPTIONS)
    return result if type(result) is int else 0  # True is a result, not an exit code


def _import_modules(arguments: list[str]) -> list[str]:
    """Import the modules that `--import` names, and return the other arguments.

    Raises:
        ValueError: no module follows, or it cannot be imported; the message contains the reason and the line.
    """
    others, left = [], iter(arguments)
    for argument in left:
        option, equals, module = argument.partition("=")
        if option != IMPORT:
            others.append(argument)
            continue
        module = module if equals else next(left, "")
        try:
            import_module(module)
        except (Exception, SystemExit) as error:
            rule = "must be followed by a module that can be imported"
            raise ValueError(f"{IMPORT} {rule}, got {shown(module)}: {where_raised(error)}") from error
    return others


def _print_commands(known: Mapping[str, EntryPoint]) -> None:
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
    words = (
        "\n[b]lissajous COMMAND --help[/b] prints the options of a command, [b]--version[/b] the version. "
        "[b]--import MODULE[/b] first\nimports a module of yours, whose scenarios, policies, robot models and rogues a "
        "command then knows by name."
    )
    console.print(words, highlight=False)


def _summary(entry: EntryPoint) -> str:
    """Return the first line of a command's docstring from its source, since imports would take seconds."""
    top, *inner = entry.module.split(".")
    spec = importlib.util.find_spec(top)
    if spec is None or spec.origin is None:
        return ""
    path = Path(spec.origin).parent.joinpath(*inner).with_suffix(".py") if inner else Path(spec.origin)
    if path.is_file():
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and node.name == entry.attr:
                return (ast.get_docstring(node) or "").partition("\n")[0]
    return ""
