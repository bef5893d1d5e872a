"""Policies on many scenarios of a space: `python benchmarks/patrol.py --policies portfolio runs/many/best-safe`.

Plays the first scenarios of a split or shift, by default those of `monitoring-v1:test`, which no training uses. Each
policy plays the same seeds as the classical ones. Its detection time in a scenario is divided by that of the best
classical policy with defaults there, by that of `sweep`, and by that of the paper's method; tables show the median of
the first ratio over scenarios, the geometric mean of the second, the share of scenarios in which the third is at most
1, and collisions per episode. Intervals (95 %) are bootstrapped over scenarios. FOLDER contains the mean scores of each
policy in each scenario. If the command is interrupted and called again, it resumes; policies may be added.
"""

import argparse
import itertools
import json
import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import figures
import numpy as np

import baselines
import lissajous_env
from baselines.benchmark.statistics import between, draws
from lissajous_env.parameters.assumptions import AssumptionWarning

PAPERS = "kuramoto-mpcc"
CLASSICAL = (
    PAPERS, "kuramoto-gvf", "consensus-mpcc", "open-loop-mpcc", "sweep", "laps", "partition", "partition-repair",
    "line-abreast",
)  # fmt: skip
PLAYED = ("portfolio",)
SPLITS = ("test", "larger", "longer", "faster")
FIRST_SEED = 10_000
KEPT = ("detection_time_mean", "detected_fraction", "collisions", "distance_mean", "speed_max", "sensed_fraction")
LEAST = 1e-9
SLOWEST = 0.1
"""Least speed limit of rogues, over the robots' top speed."""

Scores = dict[tuple[str, str], dict[str, Any]]
"""Scores by scenario and policy; `refused` with the reason where the policy cannot be made."""


def played(name: str, scenario: lissajous_env.Scenario, episodes: int) -> dict[str, Any]:
    """Return means over episodes of a policy's scores, and the share of the episodes with a collision."""
    try:
        policy = baselines.make(name, scenario, episodes)
    except ValueError as error:
        return {"refused": str(error)}
    rows = lissajous_env.evaluate(policy, scenario, range(FIRST_SEED, FIRST_SEED + episodes))
    means: dict[str, Any] = {}
    for column in KEPT:
        values = [row[column] for row in rows if math.isfinite(row[column])]
        means[column] = sum(values) / len(values) if values else None
    return means | {"episodes_with_collision": sum(row["collisions"] > 0 for row in rows) / episodes}


def scores_of(path: Path, split: str, options: argparse.Namespace) -> Scores:
    """Play what the file does not contain yet, and return all."""
    scores: Scores = {}
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            scores[row.pop("scenario"), row.pop("policy")] = row
    policies = dict.fromkeys([*CLASSICAL, *options.policies])
    with path.open("a", encoding="utf-8") as file:
        for drawn in itertools.islice(lissajous_env.scenario_space(options.space).scenarios(split), options.scenarios):
            changes: dict[str, Any] = {"task.grid": None, "task.contamination": None}
            if options.rogues:
                limit = max(drawn.rogue_speed, SLOWEST * drawn.robot.top_speed)
                changes |= {"targets.rogues": options.rogues, "targets.speed_limit": limit}
            scenario = lissajous_env.scenario(drawn, **changes)
            for name in policies:
                if (scenario.name, name) not in scores:
                    row = scores[scenario.name, name] = played(name, scenario, options.episodes)
                    file.write(json.dumps({"scenario": scenario.name, "policy": name} | row) + "\n")
                    file.flush()
    return scores


def in_words(values: np.ndarray, statistic: Callable[..., np.ndarray], digits: int = 2) -> str:
    """Return a statistic over scenarios, and its bootstrap interval, in words."""
    if len(values) == 0:
        return ""
    counts = draws(len(values))
    resampled = [statistic(np.repeat(values, count)) for count in counts]
    low, high = np.quantile(resampled, [0.025, 0.975])
    interval = between(round(low, digits), round(high, digits))
    return f"{statistic(values):.{digits}f}{f' ({interval})' if interval else ''}"


def geometric_mean(ratios: np.ndarray) -> np.ndarray:
    """Return the geometric mean of ratios."""
    return np.exp(np.log(ratios).mean())


def as_table(scores: Scores, policies: list[str]) -> figures.Table:
    """Return a row for each policy."""
    scenarios = list(dict.fromkeys(scenario for scenario, _ in scores))

    def time_of(scenario: str, policy: str) -> float:
        value = scores.get((scenario, policy), {}).get("detection_time_mean")
        return math.nan if value is None else max(value, LEAST)

    best = {scenario: float(np.nanmin([time_of(scenario, name) for name in CLASSICAL])) for scenario in scenarios}
    rows = []
    for name in policies:
        accepted = [scenario for scenario in scenarios if "detection_time_mean" in scores.get((scenario, name), {})]
        ratios = np.array([time_of(scenario, name) / best[scenario] for scenario in accepted])
        papers = np.array([time_of(scenario, name) / time_of(scenario, PAPERS) for scenario in accepted])
        sweeps = np.array([time_of(scenario, name) / time_of(scenario, "sweep") for scenario in accepted])
        collisions = np.array([scores[scenario, name]["collisions"] for scenario in accepted])
        free = np.array([scores[scenario, name]["episodes_with_collision"] == 0 for scenario in accepted])
        rows.append([
            f"`{name}`", str(len(accepted)), in_words(ratios[np.isfinite(ratios)], np.median),
            in_words(sweeps[np.isfinite(sweeps)], geometric_mean),
            in_words(100.0 * (papers[np.isfinite(papers)] <= 1), np.mean, 0), in_words(collisions, np.mean),
            in_words(100.0 * free, np.mean, 0),
        ])  # fmt: skip
    titles = ["policy", "scenarios", "time over the best one (median)", "over that of `sweep` (geometric mean)",
              f"not slower than `{PAPERS}` [%]", "collisions", "without collision [%]"]  # fmt: skip
    return {"columns": titles, "rows": rows}


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--policies", nargs="*", default=PLAYED, help="names or folders besides the classical ones")
    parser.add_argument("--space", default="monitoring-v1")
    parser.add_argument("--splits", nargs="+", default=SPLITS)
    parser.add_argument("--scenarios", type=int, default=32, help="scenarios of each split")
    parser.add_argument("--rogues", help="rogues that move all targets")
    parser.add_argument("--episodes", type=int, default=8, help="episodes of each scenario")
    parser.add_argument("--out", type=Path, default=Path("results/patrol"))
    options = parser.parse_args()
    warnings.simplefilter("ignore", AssumptionWarning)
    options.out.mkdir(parents=True, exist_ok=True)
    for split in options.splits:
        name = f"{split} {options.rogues}" if options.rogues else split
        scores = scores_of(options.out / f"{name}-{options.episodes}.jsonl", split, options)
        table = as_table(scores, [*CLASSICAL, *options.policies])
        figures.show(f"{options.space}:{name}, {options.scenarios} scenarios, {options.episodes} episodes each", table)
        if options.store:
            figures.store({f"patrol {name}": table | {"episodes": options.episodes}})


if __name__ == "__main__":
    main()
