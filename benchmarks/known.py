"""The best known plans of included scenarios: `python benchmarks/known.py NAME --seconds 120 --seed 0`.

Searches for plans of each scenario, as a benchmark plays it, whose robots begin where the scenario places them. The
candidates are the stored plans of all scenarios with the same start, partitions, lines, and the patrols that the
portfolios choose. The seconds are processor time, so the result depends little on other programs. A plan with a shorter
worst-case undetected time than the stored one, of whole episodes or of their second halves, replaces it in
`baselines/benchmark/known`, together with this command and its figures. Plans with a collision, or without a bound, are
not stored. `--again` first plays the stored plans of the scenario and stores their figures, which a change of the
simulation or of the contamination grid alters. `--filtered` includes partitions and lines with the proved filter in the
search, for scenarios in which they collide on the way from the start. `--store` also plays the default policies and
puts a table of them and of all stored plans into docs/figures.json.
"""

import contextlib
import math
import shutil
import time
from collections.abc import Sequence
from pathlib import Path

import figures

from baselines.benchmark import best_known
from baselines.benchmark.statistics import number
from baselines.benchmark.table import bounds_of
from baselines.benchmark.types import WITH_GRID, as_played
from baselines.planning import portfolio
from baselines.planning.families import as_family, defaults, lines, partitions, with_parameters
from baselines.planning.plans import Family, Figures, Plan, Planned, Variables
from baselines.planning.rehearse import Episodes, play
from baselines.planning.search import Search
from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.settings import POLICY_FILE, SCENARIO_FILE
from lissajous_env.episodes.guarantee import cells
from lissajous_env.parameters.assumptions import quietly
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import toml_value
from lissajous_env.storage.files import write_atomically

WHOLE, SETTLED = "whole", "settled"
"""Goals: the worst case of whole episodes, and of their second halves, when all robots have reached their places."""


def alike(task: Scenario) -> Family:
    """Return the stored plans of all scenarios whose robots begin at the same places of the same rectangle."""
    start = task.curve, task.formation, task.num_robots
    return as_family(task, [
        plan for plan in best_known.all_known()
        if (plan.scenario.curve, plan.scenario.formation, plan.scenario.num_robots) == start
    ])  # fmt: skip


def portfolios(task: Scenario) -> Family:
    """Return the patrols that the portfolios play, with the parameters that they have there."""

    def plan(variables: Variables) -> Plan:
        name = variables["portfolio"]
        return Plan("portfolios", task, portfolio.chosen(name, task), name)

    return Family("portfolios", plan, [{"portfolio": name} for name in portfolio.NAMES])


def filtered(family: Family, task: Scenario) -> Family:
    """Return a family under the proved filter, of which the defaults and all numbers of rows or lines come first."""
    counted = {"partition": "rows", "lines": "lines"}[family.name]
    first = ({}, *({counted: count} for count in range(1, 9)))
    policies = [f"{policy}-proved" for policy in family.choices["policy"]]
    others = {name: choices for name, choices in family.choices.items() if name not in ("policy", "start")}
    return with_parameters(task, f"{family.name}-proved", policies, first, others)


def ranked(figures: Figures | best_known.BestKnown, goal: str) -> tuple[float, float]:
    """Return the numbers of which a plan that is better for a goal has less."""
    whole, settled = figures.worst_case, figures.settled
    return (whole, settled) if goal == WHOLE else (settled, whole)


def keep(name: str, finals: Sequence[Planned], command: str) -> list[str]:
    """Store the best plans of an included scenario, where they are better than the stored ones; return their folders.

    Args:
        name: Name of the scenario.
        finals: Plans that were played to the end on it.
        command: Command that found them.
    """
    allowed = [plan for plan in finals if not plan.figures.collisions and math.isfinite(plan.figures.worst_case)]
    written = []
    for goal, folder in ((WHOLE, name), (SETTLED, f"{name}-{SETTLED}")):
        best_known.all_known.cache_clear()  # the second goal is compared with what the first one has written
        stored_ones = [
            ranked(plan, goal) for plan in best_known.all_known() if plan.name in (name, f"{name}-{SETTLED}")
        ]
        best = min(allowed, key=lambda plan: ranked(plan.figures, goal), default=None)
        if best is not None and _shorter(best.figures, goal) < min(stored_ones, default=(math.inf, math.inf)):
            _write(folder, name, best, command)
            written.append(folder)
    best_known.all_known.cache_clear()
    return written


def keep_figures(stored_plan: best_known.BestKnown, figures: Figures) -> None:
    """Store figures of a stored plan in place of its own; remove the plan if it collides or has no bound."""
    if figures.collisions or not math.isfinite(figures.worst_case):
        shutil.rmtree(best_known.FOLDER / stored_plan.name)
    else:
        _write_figures(best_known.FOLDER / stored_plan.name, figures, stored_plan.command)
    best_known.all_known.cache_clear()


def _shorter(figures: Figures, goal: str) -> tuple[float, float]:
    """Return `ranked` of figures as they are stored."""
    first, second = ranked(figures, goal)
    return _short(first), _short(second)


def _write(folder: str, name: str, best: Planned, command: str) -> None:
    path = best_known.FOLDER / folder
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir(parents=True)
    home = [f'name = "{folder}-best-known"', f'base = "{name}"']
    home += [f"\n[task]\ncontamination = {list(cells(as_played(name)))}"] if name in WITH_GRID else []
    write_atomically(path / SCENARIO_FILE, "\n".join(home) + "\n")
    write_atomically(path / POLICY_FILE, best.plan.settings.as_toml())
    _write_figures(path, best.figures, command)


def _write_figures(path: Path, figures: Figures, command: str) -> None:
    entries = {"command": command, "worst_case": _short(figures.worst_case), "settled": _short(figures.settled)}
    write_atomically(
        path / best_known.FOUND, "".join(f"{key} = {toml_value(key, value)}\n" for key, value in entries.items())
    )


def _short(seconds: float) -> float:
    return float(f"{seconds:.6g}")


def measure_again(name: str) -> None:
    """Store the figures of the stored plans of a scenario, as they are now."""
    for plan in best_known.all_known():
        if plan.name in (name, f"{name}-{SETTLED}"):
            task = as_played(name)
            with quietly():
                figures = play(Plan(best_known.BEST_KNOWN, task, plan.settings, plan.name), Episodes()).figures
            now = f"{figures.worst_case:.3g} s, {figures.collisions} collisions"
            print(f"{plan.name}: {plan.worst_case:g} s as stored, now {now}")
            keep_figures(plan, figures)


def row_of(name: str) -> list[str]:
    """Return the row of a scenario: its lower bound, and the stored plans beside the best default policies [s]."""
    task = as_played(name)
    family = defaults(task)
    played = []
    with quietly():
        for settings in family.first:
            with contextlib.suppress(UnsuitableScenarioError):
                played.append(play(family.plan(settings), Episodes()))
    without = [plan.figures for plan in played if not plan.figures.collisions]
    whole = min((plan.worst_case for plan in without), default=math.inf)
    settled = min((plan.settled for plan in without), default=math.inf)
    best = [number(worst_case) if math.isfinite(worst_case) else "none" for worst_case in (whole, settled)]
    bounds = bounds_of(task)
    return [
        f"`{name}`",
        number(bounds.worst_case),
        number(bounds.best_known),
        best[0],
        number(bounds.best_known_settled),
        best[1],
    ]


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("scenarios", nargs="*")
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--filtered", action="store_true")
    options = parser.parse_args()
    for name in options.scenarios:
        if options.again:
            measure_again(name)
        task = as_played(name)
        families = [family_of(task) for family_of in (alike, partitions, lines, portfolios)]
        if options.filtered:
            families += [filtered(family_of(task), task) for family_of in (partitions, lines)]
        budget = {"seconds": options.seconds, "clock": time.process_time}
        search = Search(task, families, seed=options.seed, fixed_start=True, **budget)
        with quietly():
            search.run()
        command = f"python benchmarks/known.py {name} --seconds {options.seconds:g} --seed {options.seed}"
        command += " --filtered" if options.filtered else ""
        folders = keep(name, search.finals, command)
        print(
            f"{name}: {len(search.looks)} looks, {len(search.finals)} played, stored: {', '.join(folders) or 'nothing'}"
        )
        for final in sorted(search.finals, key=lambda final: final.figures.worst_case):
            stats = final.figures
            words = f"worst {stats.worst_case:.3g} s, second half {stats.settled:.3g} s, {stats.collisions} collisions"
            print(f"  {final.plan.settings.policy}: {words} ({final.plan.about})", flush=True)
    if options.store:
        names = dict.fromkeys(plan.name.removesuffix(f"-{SETTLED}") for plan in best_known.all_known())
        titles = "scenario", "lower bound [s]", "best known [s]", "best default [s]"
        titles = (*titles, "second half: best known [s]", "best default [s]")
        figures.store({"known": {"columns": titles, "rows": [row_of(name) for name in names]}})


if __name__ == "__main__":
    main()
