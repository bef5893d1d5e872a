"""Terminal output: complete numbers and names at any width, closed streams, kernels, remaining time."""

import math
import re
import subprocess
import sys

import pytest
from command_line import called

import lissajous_env
from baselines.planning import report
from baselines.planning.plans import Figures, Plan, Planned
from baselines.planning.request import Request
from baselines.planning.search import PlanOutcome
from baselines.policies.settings import PolicySettings
from baselines.reproduce import claims
from baselines.reproduce.claims import Claim
from lissajous_env.console.terminal import make_console
from lissajous_env.device import compilation
from lissajous_env.parameters import named

CLAIMS = [
    Claim(f"claim {k} of a lap of 12.5 s", "1.234 m", f"{k}.567 to 9.8765 m", "at most 3", k > 1, "", "fig3")
    for k in range(3)
]
EVADERS = lissajous_env.scenario("evaders")
RUN = "run failure still --set task.duration=1"
PLANS = [
    Planned(
        Plan("Lissajous", EVADERS, PolicySettings("kuramoto-mpcc-safe"), f"a:b = {k}:2, omega = 0.31{k} rad/s"),
        Figures(1.25 * k, 1.1, math.inf, 0.512, 0, 17, 0.0123, 0.0, False, 123.4, "phases of ring neighbours"),
        [], [],
    )
    for k in range(1, 4)
]  # fmt: skip
OUTCOME = PlanOutcome(Request(EVADERS, failures=1), scenarios={5: EVADERS}, lower_bounds={5: 0.105}, finals=PLANS)


@pytest.mark.parametrize("command", ["scenarios", "policies", "plan", "reproduce"])
@pytest.mark.parametrize("width", [40, 80, 86])
def test_tables_fit_and_cut_nothing(command, width, capsys, monkeypatch):
    def shown(columns, **place):
        for name, value in {"COLUMNS": str(columns), **place}.items():
            monkeypatch.setenv(name, value)
        if command in ("scenarios", "policies"):
            return called(capsys, command)[1]
        if command == "plan":
            report.print_plans(make_console(), OUTCOME, PLANS)
        else:
            claims.print_claims(make_console(), CLAIMS)
        return capsys.readouterr().out

    whole, text = shown(1000), shown(width)
    rows = [line for line in text.partition("\nTake ")[0].splitlines() if not line.startswith("Columns that")]
    assert max(map(len, rows)) <= width
    words = {word for line in rows for word in line.split() if re.search(r"\d", word)}
    assert words <= set(whole.split())
    assert shown(width, TERM="dumb", NO_COLOR="1") == text


@pytest.mark.parametrize(("line", "code", "files"), [
    ("nothing <&- >&- 2>&-", 2, []), ("--help > /dev/full", 1, []), (f"{RUN} --out a.npz | true", 0, ["a.npz"]),
    (f"{RUN} --json --out b.npz 2>&1 | true", 0, ["b.npz"]),
])  # fmt: skip
def test_streams_that_are_closed_or_full_end_no_command_in_a_traceback(line, code, files, tmp_path):
    command = f"set -o pipefail; {sys.executable} -m lissajous_env {line}"
    ended = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60, cwd=tmp_path)
    assert (ended.returncode, sorted(path.name for path in tmp_path.iterdir())) == (code, files)
    assert not re.search("Traceback|Exception ignored", ended.stderr)
    assert "\ufffd" not in ended.stdout


def test_a_description_of_somebody_else_does_not_change_the_terminal(tmp_path, capsys):
    (tmp_path / "a.toml").write_text('base = "failure"\ndescription = "\\u001b[2Ja\\u009bb\\r\\u0007c"\n')
    assert "  [2Jabc" in called(capsys, "scenarios", tmp_path / "a.toml")[1]


def test_the_command_says_that_it_compiles_unless_quiet(monkeypatch, capsys):
    monkeypatch.setattr(compilation, "listener", None)
    for options, heard in (([], "compiling\n"), (["--quiet"], "")):
        monkeypatch.setattr(
            named, "scenarios", lambda: (compilation.listener and compilation.listener("compiling")) or ()
        )
        code, _, error = called(capsys, "scenarios", *options)
        assert (code, error) == (0, heard)


def test_version(capsys):
    assert (0, called(capsys, "-V")[1], "") == called(capsys, "-V") == called(capsys, "--version")
