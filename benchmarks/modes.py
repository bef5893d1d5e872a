"""Reasons for long worst cases of patrols: `python benchmarks/modes.py`.

Plays the patrol of `portfolio-guarantee` on `team`, and lines at 0.85 of the top speed on `intruders`, from the starts
of the scenario, from exact starts (`formation.start_noise=0`) and without failures. The table has the worst-case
undetected time of the episodes, that of their first and last parts, and the widest gap between the places in the file
that the robots compute when they start, over an even spacing (median and largest). `--store` puts it into
docs/figures.json.
"""

from typing import Any

import figures
import numpy as np
from limits import worst_undetected_times

import baselines
from baselines.benchmark.statistics import in_words, number, summarize_largest
from baselines.benchmark.types import as_played
from baselines.policies.patrol import Sweep
from baselines.policies.settings import PolicySettings
from lissajous_env import Scenario, Simulation
from lissajous_env import scenario as make_scenario

FIRST_SEED = 50_000
EARLY = 10.0
"""Time in which the cars reach their places [s]."""
EXACT, WHOLE = {"formation.start_noise": 0.0}, {"faults.schedule": ()}
LINES = PolicySettings("line-abreast", {"lines": 1, "speed": 1.7})
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "team": ("team", {}),
    "team, exact starts": ("team", EXACT),
    "team, no failures": ("team", WHOLE),
    "team, exact starts, no failures": ("team", EXACT | WHOLE),
    "intruders": ("intruders", {}),
    "intruders, exact starts": ("intruders", EXACT),
}


def widest_gaps(settings: PolicySettings, scenario: Scenario, seeds: range) -> np.ndarray:
    """Return the widest gap (W,) between the places in the file, over an even spacing; NaN without a file."""
    policy: Any = settings.make(scenario, len(seeds))
    patrol = getattr(policy, "policy", policy)
    if not isinstance(patrol, Sweep):
        return np.full(len(seeds), np.nan)
    simulation = Simulation(scenario, len(seeds))
    simulation.reset(seeds=list(seeds))
    policy.act(simulation.observation)
    turns = np.sort(patrol._memory.numpy()[..., 0] / len(patrol._loop.numpy()) % 1.0, axis=1)
    return np.diff(turns, axis=1, append=turns[:, :1] + 1).max(axis=1) * scenario.num_robots


def row_of(name: str, episodes: int) -> list[str]:
    """Return the cells of a case."""
    base, changes = CASES[name]
    whole, seeds = as_played(base), range(FIRST_SEED, FIRST_SEED + episodes)
    settings = LINES if base == "intruders" else baselines.chosen("portfolio-guarantee", whole)
    scenario = make_scenario(whole, **changes)
    times = worst_undetected_times(settings.make(scenario, episodes), scenario, seeds)
    gaps, early = widest_gaps(settings, scenario, seeds), round(EARLY / scenario.task.step)
    parts = [summarize_largest(part.max(axis=1)) for part in (times, times[:, :early], times[:, early:])]
    cells = [f"{value} ({beside})" for value, beside in map(in_words, parts)]
    wide = "" if np.isnan(gaps).all() else f"{number(float(np.median(gaps)))}, {number(float(gaps.max()))}"
    return [name, *cells, wide]


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=48)
    options = parser.parse_args()
    rows = [row_of(name, options.episodes) for name in CASES]
    titles = "starts", "worst case [s]", f"first {EARLY:g} s", "later", "widest gap in the file"
    table = {"columns": titles, "rows": rows}
    figures.publish("modes", f"{options.episodes} episodes each", table, options.store)


if __name__ == "__main__":
    main()
