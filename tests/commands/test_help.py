"""Help of the commands: an example, groups, and the options that are parsed."""

import re
import tomllib
from pathlib import Path
from typing import Literal

import pytest
import tyro
from command_line import called, lissajous

from lissajous_env.console.cli import commands
from lissajous_env.console.help import print_help
from lissajous_env.console.terminal import DEFAULT_OUTPUT, OutputOptions

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
COMMANDS = [name.replace(".", " ") for name in PROJECT["entry-points"]["lissajous_env.commands"]]
"""The project's own commands; other packages may bring more."""


@pytest.mark.parametrize("arguments", [(), ("--help",)])
def test_help_lists_every_command(arguments):
    ended = lissajous(*arguments, width=80)
    assert ended.returncode == 0
    for name in ("benchmark", "evaluate", "plan", "policies", "replay", "run", "scenarios", "train"):
        assert re.search(rf"^  {name} +[A-Z]", ended.stdout, re.MULTILINE), name
    assert all(len(line) <= 80 for line in ended.stdout.splitlines())


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(name, capsys):
    # Oracle: the options that tyro, which parses the command line, lists for the function.
    function, options = commands()[name].load(), r"^\W*(?:-h, )?(--\w[\w-]*)"
    code, out, error = called(capsys, name, "--help")
    assert (code, error) == (0, "")
    assert out.startswith(f"usage: lissajous {name}")
    assert re.search(rf"^example\n +lissajous {name} ", out, re.MULTILINE)
    with pytest.raises(SystemExit):
        tyro.cli(function, args=["--help"])
    listed = re.findall(options, capsys.readouterr().out, re.MULTILINE)
    assert sorted(re.findall(options, out, re.MULTILINE)) == sorted(listed)


def test_help_sorts_options_into_groups(capsys):
    def paint(
        wall: str, colour: Literal["red", "blue"] = "red", coats: int = 2, output: OutputOptions = DEFAULT_OUTPUT
    ):
        """Paint a wall.

        Example:
            lissajous paint north --coats 3

        Options:
            paint: coats, colour

        Args:
            wall: name of the wall,
                or of the room.
            colour: colour of the paint
            coats: number of coats.
            output: Console output.
        """

    print_help(paint, "lissajous paint")
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[:5] == ["usage: lissajous paint [OPTIONS]", "", "Paint a wall.", "", "example"]
    assert lines[lines.index("options") + 1] == "--wall TEXT Name of the wall, or of the room."
    first = lines.index("paint") + 1
    assert lines[first] == "--coats INT Number of coats (default: 2)."
    assert lines[first + 1] == "--colour {red,blue} Colour of the paint (default: red)."


def test_help_names_the_scenario_first(capsys):
    for command, usage in (("run", "SCENARIO [POLICY]"), ("evaluate", "[SCENARIO ...] POLICY")):
        assert usage in called(capsys, command, "--help")[1]
