"""Cost and benefit of the collision filters: `python benchmarks/safety.py`.

Measures the time of the filter per robot and step on one thread, for observations of episodes. Then each policy is
played without a filter and with each of them, on the same seeds, in one run. `--seeds 16` makes it short, and `--store`
puts the tables into docs/figures.json.
"""

import time

import figures
import numpy as np

import baselines
import lissajous_env
from baselines.benchmark.statistics import number
from baselines.policies import registry
from baselines.policies.base import Filtered

POLICIES = ("kuramoto-mpcc", "open-loop-mpcc", "tracked-reference-mpcc", "consensus-gvf", "sweep", "random")
FILTERS = ("-safe", "-proved")
COLUMNS = {
    "collisions": "collisions",
    "min_separation": "smallest distance [m]",
    "spacing_factor": "spacing factor",
    "tracking_error_mean": "tracking error, mean [m]",
    "phase_error": "phase error [rad]",
    "detection_time_mean": "detection [s]",
}


def time_per_action(name: str, scenario: str) -> tuple[float, float, float]:
    """Return a filter's time per robot and step [us], mean and slowest, and the share of actions that it changed."""
    policy = baselines.make(name, scenario, num_worlds=64)
    assert isinstance(policy, Filtered)
    simulation = lissajous_env.Simulation(scenario, num_worlds=64)
    policy.reset()
    seen = simulation.observation
    policy.act(seen)
    times, changed = [], []
    for _ in range(simulation.scenario.task.steps):
        wanted = policy.policy.act(seen)
        begin = time.perf_counter()
        action = policy.filter(seen, wanted)
        times.append((time.perf_counter() - begin) / action.shape[0] / action.shape[1] * 1e6)
        changed.append(np.mean((action.numpy() != wanted.numpy()).any(axis=-1)))
        seen, *_ = simulation.step(action)
    return float(np.mean(times)), float(np.max(times)), float(np.mean(changed))


def scores(name: str, scenario: str, seeds: int) -> dict[str, float]:
    """Return the mean score of a policy over the seeds."""
    policy = baselines.make(name, scenario, num_worlds=seeds)
    rows = lissajous_env.evaluate(policy, scenario, range(seeds))
    return {column: float(np.nanmean([row[column] for row in rows])) for column in COLUMNS}


def as_table(scored: dict[tuple[str, str], dict[str, float]]) -> figures.Table:
    """Return the scores by scenario and policy; collisions with a filter also as a share of those without."""
    rows = []
    for (scenario, name), score in scored.items():
        plain = scored[scenario, registry.split_suffix(name)[0]]
        share = ""
        if score is not plain and plain["collisions"]:
            share = number(100 * score["collisions"] / plain["collisions"])
        first, *others = (number(score[column]) for column in COLUMNS)
        rows.append([f"{scenario}, `{name}`", first, share, *others])
    first, *others = COLUMNS.values()
    return {"columns": ["mean of an episode", first, "of those without the filter [%]", *others], "rows": rows}


def by_filter(scored: dict[tuple[str, str], dict[str, float]]) -> figures.Table:
    """Return the collisions per episode of each policy without a filter and with each of them."""
    rows = [
        [
            f"`{scenario}`, `{name}`",
            *(number(scored[scenario, name + ending]["collisions"]) for ending in ("", *FILTERS)),
        ]
        for scenario, name in scored
        if name in POLICIES
    ]
    return {"columns": ["collisions per episode", "no filter", *(f"`{ending}`" for ending in FILTERS)], "rows": rows}


def main():
    parser = figures.parser(__doc__)
    parser.add_argument("--seeds", type=int, default=64, help="episodes of each policy")
    parser.add_argument("--scenarios", nargs="+", default=["experiment", "rough", "intruders"])
    options = parser.parse_args()

    rows = []
    for name, scenario in (("kuramoto-mpcc", "experiment"), ("kuramoto-mpcc", "rough"), ("random", "rough")):
        for ending in FILTERS:
            mean, most, changed = time_per_action(f"{name}{ending}", scenario)
            rows.append([f"{scenario}, `{name}{ending}`", number(mean), number(most), number(100 * changed)])
    columns = ["filter on one thread", "a robot and step [us]", "in the slowest step [us]", "actions it changed [%]"]
    cost: figures.Table = {"columns": columns, "rows": rows}
    figures.publish("filter", "what the filter costs", cost, options.store)

    labels = [f"{name}{ending}" for name in POLICIES for ending in ("", *FILTERS)]
    scored = {(scenario, name): scores(name, scenario, options.seeds)
              for scenario in options.scenarios for name in labels}  # fmt: skip
    title = f"what it buys, {options.seeds} episodes"
    figures.publish("safety", title, as_table(scored), options.store)
    figures.publish("touches", title, by_filter(scored), options.store)


if __name__ == "__main__":
    main()
