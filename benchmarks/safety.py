"""What the collision filter costs and what it buys: `python benchmarks/safety.py`.

Time of the filter per robot and step on one thread, on observations met in episodes; then collisions, spacing and the
rest of each policy with the filter and without it, on the same seeds, in one run. `--seeds 16` makes it short.
"""

import argparse
import time

import numpy as np

import baselines
import lissajous_env
from baselines.safety.filter import Safe

POLICIES = ("kuramoto-mpcc", "open-loop-mpcc", "tracked-reference-mpcc", "consensus-gvf", "sweep", "random")
COLUMNS = (
    "collisions",
    "min_separation",
    "spacing_factor",
    "tracking_error_mean",
    "phase_error",
    "detection_time_mean",
)


def time_per_action(name: str, scenario: str, worlds: int = 64) -> tuple[float, float, float]:
    """Time of the filter per robot and step [us], mean and in the slowest step; the share of actions it changed."""
    policy = baselines.make(f"{name}-safe", scenario, num_worlds=worlds)
    assert isinstance(policy, Safe)
    simulation = lissajous_env.Simulation(scenario, num_worlds=worlds)
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
    """Mean score of a policy over the seeds."""
    policy = baselines.make(name, scenario, num_worlds=seeds)
    rows = lissajous_env.evaluate(policy, scenario, range(seeds))
    return {column: float(np.nanmean([row[column] for row in rows])) for column in COLUMNS}


def main():
    parser = argparse.ArgumentParser(description="What the collision filter costs and what it buys.")
    parser.add_argument("--seeds", type=int, default=64, help="episodes of each policy")
    parser.add_argument("--scenarios", nargs="+", default=["experiment", "rough", "intruders"])
    options = parser.parse_args()

    print("filter, us per robot and step on one thread")
    for name, scenario in (("kuramoto-mpcc", "experiment"), ("kuramoto-mpcc", "rough"), ("random", "rough")):
        mean, most, changed = time_per_action(name, scenario)
        print(
            f"  {name:24s}{scenario:12s}{mean:6.2f} mean, {most:.2f} in the slowest step; changed {100 * changed:.1f} %"
        )

    print(f"\nmeans of {options.seeds} episodes{'':19s}" + "".join(f"{column:>21s}" for column in COLUMNS))
    for scenario in options.scenarios:
        for name in POLICIES:
            plain, safe = scores(name, scenario, options.seeds), scores(f"{name}-safe", scenario, options.seeds)
            for label, score in ((name, plain), (f"{name}-safe", safe)):
                print(f"{scenario:12s}{label:28s}" + "".join(f"{score[column]:21.3f}" for column in COLUMNS))
            if plain["collisions"]:
                print(f"{'':12s}{'':28s}{100 * safe['collisions'] / plain['collisions']:19.1f} %")


if __name__ == "__main__":
    main()
