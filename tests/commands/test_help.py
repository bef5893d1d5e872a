"""Help of the commands: a list of all, and of each an example and its options."""

import re
import tomllib
from pathlib import Path

import pytest
from command_line import called

from lissajous_env.console.cli import GROUP

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
COMMANDS = sorted(name.replace(".", " ") for name in PROJECT["entry-points"][GROUP])


@pytest.mark.parametrize("arguments", [(), ("--help",)])
def test_help_lists_every_command(arguments, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    code, out, _ = called(capsys, *arguments)
    assert code == 0
    for name in COMMANDS:
        assert re.search(rf"^  {name} +[A-Z]", out, re.MULTILINE), name
    assert all(len(line) <= 80 for line in out.splitlines())


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_with_an_example(name, capsys):
    code, out, error = called(capsys, name, "--help")
    assert (code, error) == (0, "")
    assert out.startswith(f"usage: lissajous {name}")
    assert re.search(rf"^Example:\n +lissajous {name} ", out, re.MULTILINE)
    assert {"--json", "--quiet"} <= set(re.findall(r"--\w+", out))


def test_help_names_the_scenario_first(capsys):
    for command, usage in (("run", "SCENARIO [POLICY]"), ("evaluate", "[SCENARIO ...] POLICY")):
        assert usage in called(capsys, command, "--help")[1]
