"""How alike policies drive at another scale: `python benchmarks/similarity.py`.

Lengths are multiplied by L and times by T, each policy plays the same seeds at every scale, and the means in scaled
units are compared with those at the scale of the scenario. Factors that are powers of 2 change no bit, as
`tests/test_similarity.py` shows; others round differently, after which two episodes with a near collision part.
`--store` puts the table into docs/figures.json.
"""

import argparse

import figures
import numpy as np

import baselines
import lissajous_env
from baselines.benchmark.tables import number

SCENARIOS = ("experiment", "evaders", "intruders")
SCALES = ((10.0, 1.0), (10.0, 10.0), (3.0, 0.5), (0.1, 1.0), (100.0, 10.0))
COLUMNS = {"distance_mean": "distance driven", "spacing_factor": "spacing factor", "collisions": "collisions"}


def means(name: str, scenario: lissajous_env.Scenario, length: float, time: float, seeds: int) -> np.ndarray:
    """Return the mean of each column over the seeds, in scaled units."""
    scaled = scenario.scaled(length, time)
    rows = lissajous_env.evaluate(baselines.make(name, scaled, num_worlds=seeds), scaled, range(seeds))
    units = np.array([length, 1.0, 1.0])
    return np.mean([[row[column] for column in COLUMNS] for row in rows], axis=0) / units


def row_of(name: str, scenario: lissajous_env.Scenario, seeds: int) -> list[str]:
    """Return a row of the table: the means at the scenario's own scale, and how far those at the others are off."""
    own = means(name, scenario, 1.0, 1.0, seeds)
    others = np.array([means(name, scenario, length, time, seeds) for length, time in SCALES])
    off = np.abs(others - own).max(axis=0)
    cells = [f"{number(mean)} ({number(most)})" for mean, most in zip(own, off, strict=True)]
    return [f"{scenario.name}, `{name}`", *cells]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=32)
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS)
    parser.add_argument("--policies", nargs="+", help="all that drive cars, unless named")
    parser.add_argument("--store", action="store_true", help="put the table into docs/figures.json, too")
    options = parser.parse_args()
    rows = []
    for name in options.scenarios:
        scenario = lissajous_env.scenario(name)
        for policy in options.policies or baselines.names(scenario):
            rows.append(row_of(policy, scenario, options.seeds))
            print(*rows[-1], sep="  ", flush=True)
    table = {"columns": ["policy", *(f"{title} (largest difference)" for title in COLUMNS.values())], "rows": rows}
    figures.show(f"{options.seeds} seeds, at {len(SCALES)} other scales", table)
    if options.store:
        figures.store({"similarity": table})


if __name__ == "__main__":
    main()
