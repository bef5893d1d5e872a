"""The worst case of the portfolio, of classical policies and of the best plan of a search, on scenarios of a space.

    python benchmarks/guard.py --scenarios 24 --seconds 30

Each scenario of `monitoring-v1:test` is planned for (`lissajous plan --fixed-start`), on seeds from 0. The policies and
the plan are then played on the same other seeds. A worst case is the longest worst-case undetected time of the
episodes; if an episode shows no bound, it counts as twice the episode. Tables show the median over scenarios of its
ratio to that of the plan, over all scenarios and over those in which robots fail, and collisions per episode; the
intervals (95 %) are bootstrapped over scenarios. If the command is interrupted and called again, it resumes.

    python benchmarks/guard.py --rehearsals --scenarios 24

`--rehearsals` compares the choice with and without rehearsals instead, on `monitoring-v1:validation`: the geometric
mean over scenarios of the ratio to the worst case without, on other seeds than those of the rehearsals.
"""

import argparse
import json
import math
import warnings
from pathlib import Path
from typing import Any

import figures
import numpy as np
from patrol import geometric_mean, in_words
from prior import FIRST_SEED, scenarios_of

from baselines.planning.portfolio import GUARANTEE, NAMES, Prior, chosen, ordered, result_of
from baselines.planning.request import Request
from baselines.planning.search import PlanOutcome
from baselines.policies.settings import PolicySettings
from lissajous_env import Scenario, scenario_space
from lissajous_env.parameters.assumptions import AssumptionWarning

CLASSICAL = ("line-abreast", "partition", "partition-repair", "sweep", "laps", "kuramoto-mpcc")
PLAN = "best plan"
GUARD = "portfolio-guarantee"
REHEARSED = 0, 5, 10, 18
"""Numbers of rehearsed patrols that are compared, the first without any."""

Results = dict[tuple[str, str], dict[str, Any]]


def best_plan(scenario: Scenario, seconds: float) -> PolicySettings | None:
    """Return the plan with the shortest worst case of a search; None if each has a collision or no bound."""
    outcome = PlanOutcome.of(Request(scenario, seconds=seconds, fixed_start=True))
    outcome.search()
    plans = [plan for plan in outcome.plans if math.isfinite(plan.figures.worst_case)]
    return plans[0].plan.settings if plans else None


def settings_of(name: str, scenario: Scenario, seconds: float) -> PolicySettings | None:
    """Return the settings of a policy or of the best plan."""
    if name == PLAN:
        return best_plan(scenario, seconds)
    return chosen(name, scenario) if name in NAMES else PolicySettings(name)


def played(settings: PolicySettings | None, scenario: Scenario, episodes: int) -> dict[str, Any]:
    """Return the worst case [s] and the collisions of a policy; a time of None for none, and one that does not suit."""
    result = None if settings is None else result_of(settings, scenario, episodes, GUARANTEE, FIRST_SEED)
    return {"time": None} if result is None else result._asdict()


def results(path: Path, scenarios: list[Scenario], policies: list[str], options: argparse.Namespace) -> Results:
    """Play what the file does not contain yet, and return all."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    scores: Results = {(row["scenario"], row["policy"]): row for row in map(json.loads, lines)}
    with path.open("a", encoding="utf-8") as file:
        for scenario in scenarios:
            for name in policies:
                if (scenario.name, name) in scores:
                    continue
                settings = settings_of(name, scenario, options.seconds)
                played_now = played(settings, scenario, options.episodes)
                fails = scenario.faults.rate > 0 or scenario.faults.lost > 0
                row = {"scenario": scenario.name, "policy": name, "fails": fails} | played_now
                scores[scenario.name, name] = row
                file.write(json.dumps(row) + "\n")
                file.flush()
    return scores


def as_table(scores: Results, policies: list[str]) -> figures.Table:
    """Return a row for each policy."""
    planned = [row for (_, name), row in scores.items() if name == PLAN and row["time"] is not None]

    def ratios(name: str, failing: bool) -> np.ndarray:
        pairs = [
            (scores[row["scenario"], name]["time"], row["time"])
            for row in planned
            if (row["fails"] or not failing) and scores[row["scenario"], name]["time"] is not None
        ]
        return np.array([time / of_plan for time, of_plan in pairs])

    rows = []
    for name in policies:
        counts = [row["collisions"] for (_, policy), row in scores.items() if policy == name and "collisions" in row]
        collisions = np.array([count for count in counts if count is not None])
        every, failing = ratios(name, False), ratios(name, True)
        rows.append([f"`{name}`" if name != PLAN else name, str(len(every)), in_words(every, np.median),
                     f"{every.min():.2f} to {every.max():.2f}", in_words(failing, np.median),
                     in_words(failing, geometric_mean), in_words(collisions, np.mean)])  # fmt: skip
    titles = ["policy", "scenarios", "worst case over that of the plan (median)", "range", "where robots fail (median)",
              "where robots fail (geometric mean)", "collisions"]  # fmt: skip
    return {"columns": titles, "rows": rows}


def rehearsals(scenarios: list[Scenario], options: argparse.Namespace) -> figures.Table:
    """Return a row for each number of rehearsed patrols."""
    prior, times, collisions = Prior.read(GUARD), [], []
    for scenario in scenarios:
        best = [ordered(prior, scenario, count)[0] for count in REHEARSED]
        scores = [played(settings, scenario, options.episodes) for settings in best]
        if all(row["time"] is not None for row in scores):
            times.append([row["time"] for row in scores])
            collisions.append([row["collisions"] for row in scores])
            print(scenario.name, *(f"{time:.3g}" for time in times[-1]), flush=True)
    ratios = np.array(times) / np.array(times)[:, :1]
    rows = [
        [str(count) if count else "none", str(len(times)), in_words(ratios[:, k], geometric_mean),
         f"{100 * np.mean(ratios[:, k] < 1):.0f}", f"{100 * np.mean(ratios[:, k] > 1):.0f}",
         in_words(np.array(collisions)[:, k], np.mean)]
        for k, count in enumerate(REHEARSED)
    ]  # fmt: skip
    titles = ["rehearsed", "scenarios", "worst case over that without (geometric mean)", "shorter [%]", "longer [%]"]
    return {"columns": [*titles, "collisions"], "rows": rows}


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--policies", nargs="*", default=[GUARD], help="names")
    parser.add_argument("--space", default="monitoring-v1")
    parser.add_argument("--scenarios", type=int, default=24)
    parser.add_argument("--seconds", type=float, default=30.0, help="duration of each search [s]")
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--rehearsals", action="store_true", help="compare a choice with and without rehearsals")
    parser.add_argument("--out", type=Path, default=Path("results/guard"))
    options = parser.parse_args()
    warnings.simplefilter("ignore", AssumptionWarning)
    options.out.mkdir(parents=True, exist_ok=True)
    policies, split = [PLAN, *options.policies, *CLASSICAL], "validation" if options.rehearsals else "test"
    scenarios = list(scenarios_of(scenario_space(options.space), split, options.scenarios, GUARANTEE))
    if options.rehearsals:
        name, table = "guard rehearsed", rehearsals(scenarios, options)
    else:
        scores = results(options.out / "worst-cases.jsonl", scenarios, policies, options)
        name, table = "guard", as_table(scores, policies)
    title = f"{options.space}:{split}, {options.scenarios} scenarios, {options.episodes} episodes each"
    figures.publish(name, title, table, options.store)


if __name__ == "__main__":
    main()
