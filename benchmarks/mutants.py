"""Sample of mutants, and the share that the tests of their room find: `python benchmarks/mutants.py --store`.

A mutant is a copy of the code with one change: another operator, comparison or number, a negated condition, a loop that
does not run. In a clone of a commit, tests run until one fails, the shortest first: those that execute the changed line
in this process, or, if none is known to, as for kernels, all tests of the room; and at most for `MOST_SECONDS` of
processor time. With `--again`, those that survived are tried again without this limit. A mutant *dies* if a test fails
or does not end. Some of those that survive are equivalent: their change has no effect, as that of a limit that nothing
reaches. Tests of other rooms might find some more.

`benchmarks/mutants.jsonl` contains all mutants that were tried, and a second call with the same commit continues its
sample. `--commit` tries those of another commit by the tests of that commit. The table counts all of them.
It requires `pip install cosmic-ray pytest-cov`, which make the mutants and find the tests that execute a line.
"""

import importlib
import json
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from importlib.util import cache_from_source
from pathlib import Path

import figures
import numpy as np
import pytest
from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import use_mutation
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_item import MutationSpec
from coverage import CoverageData
from scipy.stats import binomtest

ROOMS = {
    "theory": ["lissajous_env/theory"],
    "scenario": ["lissajous_env/settings", "lissajous_env/parameters", "lissajous_env/plugins.py"],
    "storage": ["lissajous_env/storage", "lissajous_env/identity.py"],
    "device": ["lissajous_env/device"],
    "world": ["lissajous_env/world"],
    "envs": ["lissajous_env/envs"],
    "episodes": ["lissajous_env/episodes"],
    "pictures": ["lissajous_env/render", "lissajous_env/replay"],
    "robots": ["lissajous_env/logs", "baselines/onboard", "baselines/ros"],
    "policies": ["baselines/policies", "baselines/mpcc", "baselines/safety"],
    "planning": ["baselines/planning"],
    "benchmark": ["baselines/benchmark"],
    "reproduce": ["baselines/reproduce"],
    "training": ["training"],
    "commands": ["lissajous_env/console", "lissajous_env/commands", "baselines/commands"],
}
"""Code of each room, in one of the commits at least; its tests are in the folder of the same name in `tests`."""
BEFORE = "fba8cae7"
"""Commit of 0.18.0, which had twice the code."""
_SWAPPED = ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul")
_COMPARED = ("Lt_LtE", "LtE_Lt", "Gt_GtE", "GtE_Gt", "Lt_Gt", "Gt_Lt", "Eq_NotEq", "NotEq_Eq", "Is_IsNot", "IsNot_Is")
OPERATORS = (
    *(f"core/ReplaceBinaryOperator_{name}" for name in _SWAPPED),
    *(f"core/ReplaceComparisonOperator_{name}" for name in _COMPARED),
    *(f"core/{name}" for name in ("ReplaceUnaryOperator_Delete_USub", "ReplaceUnaryOperator_Delete_Not", "AddNot")),
    *(f"core/{name}" for name in ("ReplaceAndWithOr", "ReplaceOrWithAnd", "NumberReplacer", "ZeroIterationForLoop")),
)
LIBRARIES = ("hypothesis", "warp", "gymnasium", "pettingzoo", "matplotlib.pyplot", "torch", "stable_baselines3")
"""Libraries that are imported before the processes of the tests are forked: this saves most of their start."""
SECONDS = "seconds.json"
"""File in the clone with the processor time of each test that passes without a mutant [s]."""
MOST_SECONDS = 10.0
"""Processor time of the tests that run for a mutant [s]."""
TIMEOUT = 300.0
"""Time after which they are stopped [s]."""
TRIED = Path(__file__).with_name("mutants.jsonl")
FORK = multiprocessing.get_context("fork")


class _Tests:
    """Plugin of pytest that runs the tests `order`, or all if None, and then stores the time of those that pass."""

    def __init__(self, order: Sequence[str] | None) -> None:
        self.order, self.seconds = order, {}

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        if self.order is not None:
            rank = {test: place for place, test in enumerate(self.order)}
            items[:] = sorted((item for item in items if item.nodeid in rank), key=lambda item: rank[item.nodeid])

    def pytest_runtest_logstart(self) -> None:
        self.began = time.process_time()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" and report.passed:
            self.seconds[report.nodeid] = time.process_time() - self.began

    def pytest_sessionfinish(self) -> None:
        if self.order is None:
            Path(SECONDS).write_text(json.dumps(self.seconds), encoding="utf-8")


def _run(arguments: Sequence[str], order: Sequence[str] | None) -> None:
    os.setpgrp()
    silent = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(silent, stream)
    os._exit(pytest.main(["-q", "-p", "no:cacheprovider", *arguments], plugins=[_Tests(order)]))


def run(arguments: Sequence[str], order: Sequence[str] | None = None, timeout: float | None = None) -> bool:
    """Run tests in a process of its own; return True if all pass before the timeout [s]."""
    process = FORK.Process(target=_run, args=(arguments, order))
    process.start()
    process.join(timeout)
    if process.is_alive():
        os.killpg(process.pid, signal.SIGKILL)
        process.join()
    return process.exitcode == 0


def mutants_of(room: str, root: Path) -> Iterator[MutationSpec]:
    """Yield all mutants of a room's code in a clone."""
    for place in ROOMS[room]:
        for path in sorted((root / place).rglob("*.py")) or [path for path in [root / place] if path.is_file()]:
            nodes = list(ast_nodes(get_ast_from_path(path)))
            for name in OPERATORS:
                operator = get_operator(name)()
                places = (place for node in nodes for place in operator.mutation_positions(node))
                for occurrence, (start, end) in enumerate(places):
                    yield MutationSpec(path, name, occurrence, start, end)


def tests_of_lines(room: str, root: Path) -> tuple[CoverageData, dict[str, float]]:
    """Run the tests of a room; return which of them execute which line, and the time of those that pass [s]."""
    data = root / ".coverage"
    data.unlink(missing_ok=True)
    packages = (f"--cov={package}" for package in ("lissajous_env", "baselines", "training"))
    run([*packages, "--cov-context=test", "--cov-report=", "--continue-on-collection-errors", f"tests/{room}"])
    coverage = CoverageData(str(data))
    coverage.read()
    return coverage, json.loads((root / SECONDS).read_text(encoding="utf-8"))


def sample_of(room: str, commit: str, root: Path) -> list[MutationSpec]:
    """Return all mutants of a room's code in a clone, in the random order in which they are tried."""
    sample = list(mutants_of(room, root))
    random.Random(f"{room}/{commit}").shuffle(sample)
    return sample


class Tests:
    """The tests of a room in a clone, which run for its mutants; `most` is the processor time for each [s]."""

    def __init__(self, room: str, root: Path, most: float):
        self.root, self.most = root, most
        self.coverage, self.seconds = tests_of_lines(room, root)
        assert self.seconds, f"no test of {room} passes without a mutant"
        print(f"{room}: {len(self.seconds)} tests, {sum(self.seconds.values()):.0f} s", flush=True)

    def find(self, mutant: MutationSpec) -> bool:
        """Return whether a test fails, or does not end, with a mutant."""
        contexts, seconds = self.coverage.contexts_by_lineno(str(mutant.module_path)), self.seconds
        lines = range(mutant.start_pos[0], mutant.end_pos[0] + 1)
        executing = {context.partition("|")[0] for line in lines for context in contexts.get(line, ())} & seconds.keys()
        order = sorted(executing or seconds, key=lambda test: seconds[test])
        order = order[: np.searchsorted(np.cumsum([seconds[test] for test in order]), self.most) + 1]
        files = sorted({test.partition("::")[0] for test in order})
        with use_mutation(mutant.module_path, get_operator(mutant.operator_name)(), mutant.occurrence):
            compiled = Path(cache_from_source(str(mutant.module_path)))
            compiled.unlink(missing_ok=True)  # Its time stamp has seconds, and a mutant may live for less.
            passed = run(["-x", *files], order, timeout=TIMEOUT)
            compiled.unlink(missing_ok=True)
        return not passed

    def place(self, mutant: MutationSpec) -> str:
        """Return the file and the line of a mutant."""
        return f"{mutant.module_path.relative_to(self.root)}:{mutant.start_pos[0]}"


def try_mutants(room: str, count: int, commit: str, root: Path) -> None:
    """Append the results of mutants of a room to the file, until it has `count` of this room and commit."""
    sample = sample_of(room, commit, root)
    tried = sum((entry["room"], entry["commit"]) == (room, commit) for entry in entries())
    if tried >= min(count, len(sample)):
        return
    tests = Tests(room, root, MOST_SECONDS)
    for mutant in sample[tried:count]:
        place, outcome = tests.place(mutant), "died" if tests.find(mutant) else "survived"
        operator = mutant.operator_name.removeprefix("core/")
        entry = {"commit": commit, "room": room, "place": place, "operator": operator, "outcome": outcome}
        with TRIED.open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry) + "\n")
        print(room, place, operator, outcome, flush=True)


def try_again(room: str, commit: str, root: Path) -> None:
    """Try the mutants of a room and commit that survived again, with all tests, and store those that die."""
    tried = [entry for entry in entries() if (entry["room"], entry["commit"]) == (room, commit)]
    tests = Tests(room, root, np.inf)
    for mutant, entry in zip(sample_of(room, commit, root), tried, strict=False):
        assert tests.place(mutant) == entry["place"]
        if entry["outcome"] == "survived" and tests.find(mutant):
            known = entries()
            known[known.index(entry)]["outcome"] = "died"
            TRIED.write_text("".join(json.dumps(one) + "\n" for one in known), encoding="utf-8")
            print(room, *list(entry.values())[2:4], "died", flush=True)


def entries() -> list[dict[str, str]]:
    """Return the results of all mutants that were tried."""
    return [json.loads(line) for line in TRIED.read_text(encoding="utf-8").splitlines()]


def share(outcomes: Sequence[str]) -> list[str]:
    """Return the cells of a sample: its size, and the share that died with its interval."""
    if not outcomes:
        return ["", ""]
    died, count = outcomes.count("died"), len(outcomes)
    low, high = binomtest(died, count).proportion_ci(method="wilson")
    return [str(count), f"{died / count:.0%} ({low:.0%} to {high:.0%})"]


def table() -> dict[str, list]:
    """Return the table of all mutants that were tried, of the code before and after it was halved."""
    tried = entries()
    rows = []
    for room in (*ROOMS, "all"):
        samples: dict[bool, list[str]] = {False: [], True: []}
        for entry in tried:
            if room in (entry["room"], "all"):
                samples[entry["commit"] == BEFORE].append(entry["outcome"])
        if any(samples.values()):
            rows.append([room, *share(samples[False]), *share(samples[True])])
    died = "died (95 % interval)"
    return {"columns": ["room", "mutants", died, "mutants of 0.18.0", f"{died}, 0.18.0"], "rows": rows}


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--rooms", nargs="+", default=list(ROOMS))
    parser.add_argument("--mutants", type=int, default=20, help="mutants of each room")
    parser.add_argument("--commit", default="HEAD")
    parser.add_argument("--again", action="store_true", help="try those that survived again, with all tests")
    options = parser.parse_args()
    here = Path(__file__).parents[1]
    show = ["git", "rev-parse", "--short=8", options.commit]
    commit = subprocess.check_output(show, cwd=here, text=True).strip()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder).resolve() / "clone"
        subprocess.check_call(["git", "clone", "-q", str(here), str(root)])
        subprocess.check_call(["git", "checkout", "-q", commit], cwd=root)
        for library in LIBRARIES:
            importlib.import_module(library)
        os.environ["PYTHONPATH"] = str(root)
        sys.path[0] = str(root)
        os.chdir(root)
        for room in options.rooms:
            if options.again:
                try_again(room, commit, root)
            else:
                try_mutants(room, options.mutants, commit, root)
        os.chdir(here)
    figures.publish("mutants", "mutants that the tests of their room find", table(), options.store)


if __name__ == "__main__":
    main()
