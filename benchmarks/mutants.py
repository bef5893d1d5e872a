"""Sample of mutants, and the share that the tests of their room find: `python benchmarks/mutants.py --store`.

A mutant is a copy of the code with one change: another operator, comparison or number, a negated condition, a loop that
does not run. In a clone of the last commit, the tests of the room run until the first failure: first those that execute
the changed line, then, if none of them fails or none is known, all of them. A mutant *dies* if a test fails. Some of
those that survive are equivalent: their change has no effect, as that of a limit that nothing reaches.

`benchmarks/mutants.jsonl` contains all mutants that were tried, which the table counts; each call adds others.
It requires `pip install cosmic-ray pytest-cov`, which make the mutants and find the tests that execute a line.
"""

import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import figures
from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_item import MutationSpec, TestOutcome
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
    "policies": ["baselines/policies", "baselines/mpcc"],
    "planning": ["baselines/planning"],
    "benchmark": ["baselines/benchmark"],
    "reproduce": ["baselines/reproduce"],
    "training": ["training"],
    "commands": ["lissajous_env/console", "lissajous_env/commands", "baselines/commands"],
}
"""Code of each room; its tests are in the folder of the same name in `tests`."""
_SWAPPED = ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul")
_COMPARED = ("Lt_LtE", "LtE_Lt", "Gt_GtE", "GtE_Gt", "Lt_Gt", "Gt_Lt", "Eq_NotEq", "NotEq_Eq", "Is_IsNot", "IsNot_Is")
OPERATORS = (
    *(f"core/ReplaceBinaryOperator_{name}" for name in _SWAPPED),
    *(f"core/ReplaceComparisonOperator_{name}" for name in _COMPARED),
    *(f"core/{name}" for name in ("ReplaceUnaryOperator_Delete_USub", "ReplaceUnaryOperator_Delete_Not", "AddNot")),
    *(f"core/{name}" for name in ("ReplaceAndWithOr", "ReplaceOrWithAnd", "NumberReplacer", "ZeroIterationForLoop")),
)
PYTEST = (sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider")
TRIED = Path(__file__).with_name("mutants.jsonl")


def mutants_of(room: str, root: Path) -> Iterator[MutationSpec]:
    """Yield all mutants of a room's code in a clone."""
    for place in ROOMS[room]:
        for path in sorted((root / place).rglob("*.py")) if (root / place).is_dir() else [root / place]:
            nodes = list(ast_nodes(get_ast_from_path(path)))
            for name in OPERATORS:
                operator = get_operator(name)()
                places = (place for node in nodes for place in operator.mutation_positions(node))
                for occurrence, (start, end) in enumerate(places):
                    yield MutationSpec(path, name, occurrence, start, end)


def tests_of_lines(room: str, root: Path) -> CoverageData:
    """Run the tests of a room, and return which of them execute which line; kernels execute none."""
    data = root / ".coverage"
    data.unlink(missing_ok=True)
    sources = [f"--cov={root / place}" for place in ROOMS[room] if (root / place).is_dir()] or [f"--cov={root}"]
    command = [*PYTEST, *sources, "--cov-context=test", "--cov-report=", f"{root}/tests/{room}"]
    if subprocess.run(command, cwd=root, capture_output=True).returncode:
        raise SystemExit(f"the tests of {room} fail without a mutant")
    coverage = CoverageData(str(data))
    coverage.read()
    return coverage


def selections(mutant: MutationSpec, room: str, coverage: CoverageData, root: Path) -> Iterator[str]:
    """Yield the tests to run for a mutant: first those that execute its lines, if any, then all of the room."""
    contexts = coverage.contexts_by_lineno(str(mutant.module_path))
    lines = range(mutant.start_pos[0], mutant.end_pos[0] + 1)
    tests = {context.partition("|")[0] for line in lines for context in contexts.get(line, ())} - {""}
    if tests:
        chosen = root / "chosen.txt"
        chosen.write_text("\n".join(sorted(tests)), encoding="utf-8")
        yield f"@{chosen}"
    yield f"{root}/tests/{room}"


def try_mutants(room: str, count: int, seed: int, commit: str, root: Path) -> None:
    """Try some mutants of a room, drawn at random, and append each result to the file."""
    began = time.monotonic()
    coverage = tests_of_lines(room, root)
    timeout = 60 + 5 * (time.monotonic() - began)
    every = list(mutants_of(room, root))
    for mutant in random.Random(f"{room}/{seed}/{commit}").sample(every, min(count, len(every))):
        commands = (f"{' '.join(PYTEST)} {tests}" for tests in selections(mutant, room, coverage, root))
        outcomes = (mutate_and_test([mutant], command, timeout).test_outcome for command in commands)
        survived = all(outcome is TestOutcome.SURVIVED for outcome in outcomes)
        place = f"{mutant.module_path.relative_to(root)}:{mutant.start_pos[0]}"
        operator, outcome = mutant.operator_name.removeprefix("core/"), "survived" if survived else "died"
        entry = {"commit": commit, "room": room, "place": place, "operator": operator, "outcome": outcome}
        with TRIED.open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry) + "\n")
        print(room, place, operator, outcome, flush=True)


def table() -> dict[str, list]:
    """Return the table of all mutants that were tried."""
    tried = [json.loads(line) for line in TRIED.read_text(encoding="utf-8").splitlines()]
    rows = []
    for room in (*ROOMS, "all"):
        outcomes = [entry["outcome"] == "died" for entry in tried if room in (entry["room"], "all")]
        if outcomes:
            died, count = sum(outcomes), len(outcomes)
            low, high = binomtest(died, count).proportion_ci(method="wilson")
            rows.append([room, str(count), str(died), f"{died / count:.0%} ({low:.0%} to {high:.0%})"])
    return {"columns": ["room", "mutants", "died", "share (95 % interval)"], "rows": rows}


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--rooms", nargs="+", default=list(ROOMS))
    parser.add_argument("--mutants", type=int, default=8, help="mutants of each room")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    here = Path(__file__).parents[1]
    commit = subprocess.check_output(["git", "rev-parse", "--short", "HEAD"], cwd=here, text=True).strip()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "clone"
        subprocess.check_call(["git", "clone", "-q", str(here), str(root)])
        os.environ["PYTHONPATH"] = str(root)
        os.chdir(root)
        for room in options.rooms:
            try_mutants(room, options.mutants, options.seed, commit, root)
    figures.publish("mutants", "mutants that the tests of their room find", table(), options.store)


if __name__ == "__main__":
    main()
