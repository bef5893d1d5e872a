"""Agreement of policies with themselves at another scale: `python benchmarks/similarity.py`.

Lengths are multiplied by L and times by T, each policy plays the same seeds at every scale, and the means in scaled
units are compared with those at the scale of the scenario. Factors that are powers of 2 change no bit, as
`tests/test_similarity.py` shows. Others round differently, and after a near collision two episodes that differ in the
last digit part. The table has the largest difference over the scales, its median over the policies, and how many
policies differ by less than 1 % in distance and spacing. `--store` puts the table into docs/figures.json.
"""

import argparse

import figures
import numpy as np

import baselines
import lissajous_env
from baselines.benchmark.tables import number
from baselines.policies.registry import unwrapped
from training.choosing import chooser

SCENARIOS = ("experiment", "evaders", "intruders")
SCALES = ((10.0, 1.0), (10.0, 10.0), (3.0, 0.5), (0.1, 1.0), (100.0, 10.0))
COLUMNS = ("distance_mean", "spacing_factor", "collisions")
WITHIN = 0.01


def means(name: str, scenario: lissajous_env.Scenario, length: float, time: float, seeds: int) -> np.ndarray:
    """Return the mean of each column over the seeds, in scaled units."""
    scaled = scenario.scaled(length, time)
    rows = lissajous_env.evaluate(baselines.make(name, scaled, num_worlds=seeds), scaled, range(seeds))
    units = np.array([length, 1.0, 1.0])
    return np.mean([[row[column] for column in COLUMNS] for row in rows], axis=0) / units


def largest_differences(name: str, scenario: lissajous_env.Scenario, seeds: int) -> list[float]:
    """Return the differences of the means at two scales, relative except for collisions."""
    own = means(name, scenario, 1.0, 1.0, seeds)
    others = np.array([means(name, scenario, length, time, seeds) for length, time in SCALES])
    off = np.abs(others - own).max(axis=0)
    return [off[0] / own[0], off[1] / own[1], off[2]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=32)
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS)
    parser.add_argument("--policies", nargs="+", help="all that drive the robots, learned choices aside")
    parser.add_argument("--store", action="store_true", help="put the table into docs/figures.json, too")
    options = parser.parse_args()
    rows = []
    for name in options.scenarios:
        scenario = lissajous_env.scenario(name)
        policies = options.policies or [
            each for each in baselines.names(scenario) if unwrapped(each)[0] not in chooser.names()
        ]
        off = []
        for policy in policies:
            off.append(largest_differences(policy, scenario, options.seeds))
            print(name, policy, *map(number, off[-1]), sep="  ", flush=True)
        distance, spacing, collisions = np.array(off).T
        alike = (distance < WITHIN) & (spacing < WITHIN)
        middle = [f"{100 * np.median(each):.2g} %" for each in (distance, spacing)]
        rows.append([f"`{name}`", str(len(policies)), str(alike.sum()), *middle, number(np.median(collisions))])
    titles = "policies", "within 1 %", "distance driven", "spacing factor", "collisions per episode"
    table = {"columns": ["scenario", *titles], "rows": rows}
    figures.show(f"{options.seeds} seeds, at {len(SCALES)} other scales", table)
    if options.store:
        figures.store({"similarity": table})


if __name__ == "__main__":
    main()
