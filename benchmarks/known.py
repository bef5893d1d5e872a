"""The best known plans of included scenarios: `python benchmarks/known.py NAME --seconds 120 --seed 0`.

Searches for plans of each scenario, as a benchmark plays it, whose robots begin where the scenario places them. The
candidates are the stored plans of all scenarios with the same start, partitions, lines, the patrols that the portfolios
choose, and then free-form paths from the best of these. The seconds are processor time, so the result
depends little on other programs. A plan with a shorter worst-case undetected time than the stored one, of whole
episodes or of their second halves, replaces it in `baselines/planning/known`, together with this command and its
figures. Plans with a collision, or without a bound, are not stored. `--again` first plays the stored plans of the
scenario and stores their figures, which a change of the simulation or of the contamination grid alters. `--filtered`
includes partitions and lines with the proved filter in the search, for scenarios in which they collide on the way from
the start. `--store` also plays the default policies and puts a table of them and of all stored plans into
docs/figures.json.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import figures

from baselines.benchmark.bounds import bounds_of
from baselines.benchmark.standard import as_played
from baselines.benchmark.tables import number
from baselines.planning import best_known, portfolio
from baselines.planning.families.base import Settings
from baselines.planning.families.known import Known
from baselines.planning.families.shipped import Shipped
from baselines.planning.families.tuned import LINES, PARTITIONS, Tuned
from baselines.planning.plans import SETTLED, Plan
from baselines.planning.playing import Episodes, play, quietly
from baselines.planning.search import Search
from lissajous_env.parameters.scenario import Scenario


class Alike(Known):
    """Return the stored plans of all scenarios whose robots begin at the same places of the same rectangle."""

    def starts(self, task: Scenario) -> Sequence[Settings]:
        """Return the stored plans."""
        start = task.curve, task.formation, task.num_robots
        known = best_known.all_known()
        alike = [
            each for each in known if (each.scenario.curve, each.scenario.formation, each.scenario.num_robots) == start
        ]
        return [{"stored": each.name} for each in alike]

    def plan(self, task: Scenario, settings: Settings) -> Plan:
        """Return a stored plan on the task."""
        (found,) = (each for each in best_known.all_known() if each.name == settings["stored"])
        return Plan(self.name, task, found.settings, settings["stored"])


class Chosen(Known):
    """The patrols that the portfolios play, with the parameters that they have there."""

    name = "portfolios"

    def starts(self, task: Scenario) -> Sequence[Settings]:
        """Return the portfolios."""
        return [{"portfolio": name} for name in portfolio.NAMES]

    def plan(self, task: Scenario, settings: Settings) -> Plan:
        """Return the patrol that a portfolio plays."""
        return Plan(self.name, task, portfolio.chosen(settings["portfolio"], task), settings["portfolio"])

    def refusal(self, task: Scenario) -> str:
        """Return nothing: a portfolio refuses a scenario itself."""
        return ""


def filtered(family: Tuned) -> Tuned:
    """Return a family under the proved filter, of which the defaults and all numbers of rows or lines come first."""
    counted = {"partition": "rows", "lines": "lines"}[family.name]
    first = ({}, *({counted: count} for count in range(1, 9)))
    policies = tuple(f"{each}-proved" for each in family.policies)
    return replace(family, name=f"{family.name}-proved", policies=policies, first=first)


def measure_again(name: str) -> None:
    """Store the figures of the stored plans of a scenario, as they are now."""
    for each in best_known.all_known():
        if each.name in (name, f"{name}-{SETTLED}"):
            task = as_played(name, {})
            with quietly():
                figures = play(Plan(Known.name, task, each.settings, each.name), Episodes()).figures
            now = f"{figures.worst_case:.3g} s, {figures.collisions} collisions"
            print(f"{each.name}: {each.worst_case:g} s as stored, now {now}")
            best_known.keep_figures(each, figures)


def row_of(name: str) -> list[str]:
    """Return the row of a scenario: its lower bound, and the stored plans beside the best default policies [s]."""
    task, defaults = as_played(name, {}), Shipped()
    with quietly():
        played = [play(defaults.plan(task, each), Episodes()) for each in defaults.starts(task)]
    without = [each.figures for each in played if not each.figures.collisions]
    whole = min((each.worst_case for each in without), default=math.inf)
    settled = min((each.settled for each in without), default=math.inf)
    best = [number(each) if math.isfinite(each) else "none" for each in (whole, settled)]
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
        task, families = as_played(name, {}), (Alike(), PARTITIONS, LINES, Chosen())
        if options.filtered:
            families += filtered(PARTITIONS), filtered(LINES)
        search = Search(task, Episodes(), families, options.seed, fixed_start=True, clock=time.process_time)
        with quietly():
            search.run(options.seconds, free_paths=True)
        command = f"python benchmarks/known.py {name} --seconds {options.seconds:g} --seed {options.seed}"
        command += " --filtered" if options.filtered else ""
        kept = best_known.keep(name, search.finals, command)
        print(f"{name}: {len(search.looks)} looks, {len(search.finals)} played, stored: {', '.join(kept) or 'nothing'}")
        for each in sorted(search.finals, key=lambda each: each.figures.worst_case):
            of = each.figures
            words = f"worst {of.worst_case:.3g} s, second half {of.settled:.3g} s, {of.collisions} collisions"
            print(f"  {each.plan.settings.policy}: {words} ({each.plan.about})", flush=True)
    if options.store:
        names = dict.fromkeys(each.name.removesuffix(f"-{SETTLED}") for each in best_known.all_known())
        titles = "scenario", "lower bound [s]", "best known [s]", "best default [s]"
        titles = (*titles, "second half: best known [s]", "best default [s]")
        figures.store({"known": {"columns": titles, "rows": [row_of(name) for name in names]}})


if __name__ == "__main__":
    main()
