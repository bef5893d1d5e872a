"""The worst case of the portfolio, of classical policies and of the best plan of a search, on scenarios of a space.

    python benchmarks/guard.py --scenarios 24 --seconds 30

Each scenario of `monitoring-v1:test` is planned for (`lissajous plan --fixed-start`), on seeds from 0. The policies and
the plan are then played on the same other seeds. A worst case is the longest worst-case undetected time of the
episodes; if an episode shows no bound, it counts as twice the episode. Tables show the median over scenarios of its
ratio to that of the plan, over all scenarios and over those in which robots fail, and collisions per episode; the
intervals (95 %) are bootstrapped over scenarios. If the command is interrupted and called again, it resumes.
"""

import argparse
import itertools
import json
import math
import warnings
from pathlib import Path
from typing import Any

import figures
import numpy as np
from patrol import geometric_mean, in_words

from baselines.planning.portfolio import GUARANTEE, NAMES, chosen, result_of
from baselines.planning.request import Request
from baselines.planning.search import PlanOutcome
from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.settings import PolicySettings
from lissajous_env import Scenario, scenario, scenario_space
from lissajous_env.parameters.assumptions import AssumptionWarning

CLASSICAL = ("line-abreast", "partition", "partition-repair", "sweep", "laps", "kuramoto-mpcc")
PLAN = "best plan"
FIRST_SEED = 900_000

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
    if settings is None:
        return {"time": None}
    try:
        time, collisions = result_of(settings, scenario, episodes, GUARANTEE, FIRST_SEED)
    except UnsuitableScenarioError:
        return {"time": None}
    return {"time": time, "collisions": collisions}


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


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--policies", nargs="*", default=[GUARANTEE], help="names")
    parser.add_argument("--space", default="monitoring-v1")
    parser.add_argument("--scenarios", type=int, default=24)
    parser.add_argument("--seconds", type=float, default=30.0, help="duration of each search [s]")
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--out", type=Path, default=Path("results/guard"))
    options = parser.parse_args()
    warnings.simplefilter("ignore", AssumptionWarning)
    options.out.mkdir(parents=True, exist_ok=True)
    policies = [PLAN, *options.policies, *CLASSICAL]
    drawn = itertools.islice(scenario_space(options.space).scenarios("test"), options.scenarios)
    scores = results(
        options.out / "worst-cases.jsonl", [scenario(task, **{"task.grid": None}) for task in drawn], policies, options
    )
    title = f"{options.space}:test, {options.scenarios} scenarios, {options.episodes} episodes each"
    figures.publish("guard", title, as_table(scores, policies), options.store)


if __name__ == "__main__":
    main()
