"""Worst cases and collisions of partitions and lines, at their best and beyond: `python benchmarks/limits.py`.

Each case is a scenario with changes and a policy. The table has the longest worst-case undetected time of the
episodes, the longest after 5 s, and the collisions. Where a robot stops, each robot does so in its share of the
episodes, for 10 s, at a moment that is drawn for each eighth of a share. `--store` puts the table into
docs/figures.json, from which docs/policies.md has its numbers.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import figures
import numpy as np

import baselines
import lissajous_env
from baselines.benchmark.statistics import number
from baselines.policies.base import Filtered
from baselines.policies.partition import PartitionRepair, RepairParameters
from baselines.policies.safety.proved import Proved
from lissajous_env.episodes.evaluation import ActingPolicy, EpisodeRunner
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import COLLISIONS, WORST_CASE

FIRST_SEED = 30_000
STOP = 10.0
"""Time for which a robot has failed [s]."""
MOMENTS = 8
"""Moments at which each robot stops."""


class Case(NamedTuple):
    """Episodes of a policy."""

    scenario: str
    policy: Any
    """Name of the policy, or a factory."""
    episodes: int
    changes: Mapping[str, Any] = {}
    stops: bool = False
    """True if one robot stops in each episode."""


def six_rows(scenario: Scenario, num_worlds: int, proved: bool) -> Any:
    """Make `partition-repair` with six rows of cells, under the proved filter or not."""
    policy = PartitionRepair(scenario, num_worlds, parameters=RepairParameters(rows=6))
    return Filtered(policy, Proved) if proved else policy


INTRUDERS = {"task.contamination": (108, 48), "targets.speed_limit": 0.6}
CASES = {
    "evaders": Case("evaders", "partition", 256),
    "evaders-failure": Case("evaders-failure", "partition-repair", 128),
    "evaders where one stops": Case("evaders", "partition-repair", 400, stops=True),
    "team rotated": Case("team", "partition", 128, {"formation.start": "rotated", "faults.schedule": ()}),
    "team": Case("team", "partition-repair", 64),
    "team with six rows": Case("team", partial(six_rows, proved=False), 64),
    "team with six rows proved": Case("team", partial(six_rows, proved=True), 64),
    "intruders in line": Case("intruders", "line-abreast", 256, INTRUDERS),
    "team in lines": Case("team", "line-abreast-proved", 128),
    "team by a choice": Case("team", "portfolio-guarantee", 128),
}


def plays(case: Case) -> Iterator[tuple[Scenario, Sequence[int]]]:
    """Yield scenarios, with the seeds that are played on each."""
    scenario = lissajous_env.scenario(case.scenario, **case.changes)
    if not case.stops:
        yield scenario, range(FIRST_SEED, FIRST_SEED + case.episodes)
        return
    episodes = case.episodes // (scenario.num_robots * MOMENTS)
    latest = scenario.task.duration - 2 * STOP
    draws, first = np.random.default_rng(FIRST_SEED), FIRST_SEED
    for robot in range(scenario.num_robots):
        for begin in draws.uniform(STOP, latest, MOMENTS).round(1).tolist():
            schedule = ((robot, begin, begin + STOP),)
            yield lissajous_env.scenario(scenario, **{"faults.schedule": schedule}), range(first, first + episodes)
            first += episodes


def worst_undetected_times(policy: ActingPolicy, scenario: Scenario, seeds: Sequence[int]) -> np.ndarray:
    """Return (episodes, steps + 1) how long a target can have stayed undetected by each step [s], from the reset on."""
    simulation, ages = lissajous_env.Simulation(scenario, policy.num_worlds), []
    runner = EpisodeRunner(policy, simulation)
    runner.play(seeds, lambda _: ages.append(simulation.contamination.age.numpy().copy()))
    return np.stack(ages, axis=1) * scenario.task.step


def row_of(case: Case) -> list[str]:
    """Play the episodes of a case and return the cells of its row."""
    times, collisions = [], []
    for scenario, seeds in plays(case):
        make = partial(baselines.make, case.policy) if isinstance(case.policy, str) else case.policy
        worst = worst_undetected_times(make(scenario, len(seeds)), scenario, seeds)
        rows = lissajous_env.evaluate(make(scenario, len(seeds)), scenario, seeds)
        later = worst[:, round(5.0 / scenario.task.step) :].max(axis=1)
        times += [[row[WORST_CASE.name], after] for row, after in zip(rows, later, strict=True)]
        collisions += [row[COLLISIONS.name] for row in rows]
    longest, after = np.max(times, axis=0)
    cells = [number(float(score)) for score in (longest, after, np.mean(collisions))]
    return [str(len(times)), *cells, f"{np.sum(collisions):.0f}"]


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=CASES)
    options = parser.parse_args()
    rows = []
    for name in options.cases:
        rows.append([name, *row_of(CASES[name])])
        print(*rows[-1], sep="  ", flush=True)
    titles = "case", "episodes", "longest [s]", "longest after 5 s [s]", "collisions", "in all"
    table = {"columns": titles, "rows": rows}
    figures.publish("limits", "partitions and lines", table, options.store)


if __name__ == "__main__":
    main()
