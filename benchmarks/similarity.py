"""Agreement of policies with themselves at another scale: `python benchmarks/similarity.py`.

Lengths are multiplied by L and times by T, each policy plays the same seeds at every scale, and the means in scaled
units are compared with those at the scale of the scenario. Factors that are powers of 2 change no bit, as
`tests/world/test_similarity.py` shows. Others round differently, and after a near collision two episodes that differ in
the last digit part. If they do, more seeds are played until the standard error of each difference allows to detect
1 %. `--store` puts the table into docs/figures.json: the number of policies whose distance and spacing differ by less
than 1 %, and the largest differences over the scales and policies.
"""

import figures
import numpy as np

import baselines
import lissajous_env
from baselines.benchmark.statistics import number
from baselines.planning import portfolio
from baselines.policies.registry import split_suffix

SCENARIOS = ("experiment", "evaders", "intruders")
SCALES = ((10.0, 1.0), (10.0, 10.0), (3.0, 0.5), (0.1, 1.0), (100.0, 10.0))
COLUMNS = ("distance_mean", "spacing_factor", "collisions")
WITHIN = 0.01
FILTERED = "kuramoto-mpcc"
"""Policy that is played with each filter, too."""
ERROR = 0.0035
"""Standard error of a relative difference above which more seeds are played."""


class Scales:
    """Episodes of a policy at all scales, in scaled units.

    Args:
        policy: Name of the policy.
        scenario: The scenario at its own scale.
    """

    def __init__(self, policy: str, scenario: lissajous_env.Scenario):
        self._policy, self._scenario = policy, scenario
        self._episodes = np.zeros((1 + len(SCALES), 0, len(COLUMNS)))

    @property
    def seeds(self) -> int:
        """Return the number of seeds that were played."""
        return self._episodes.shape[1]

    def play(self, seeds: int) -> None:
        """Play further seeds, up to a number of them."""
        new = range(self.seeds, seeds)
        played = [self._played(length, time, new) for length, time in ((1.0, 1.0), *SCALES)]
        self._episodes = np.concatenate([self._episodes, played], axis=1)

    def _played(self, length: float, time: float, seeds: range) -> np.ndarray:
        scaled = self._scenario.scaled(length, time)
        rows = lissajous_env.evaluate(baselines.make(self._policy, scaled, num_worlds=len(seeds)), scaled, seeds)
        return np.array([[row[column] for column in COLUMNS] for row in rows]) / (length, 1.0, 1.0)

    def differences(self) -> tuple[np.ndarray, float]:
        """Return the largest differences of the means, relative except for collisions, and the standard error."""
        apart = (self._episodes[1:] - self._episodes[0]) / (*self._episodes[0].mean(axis=0)[:2], 1.0)
        errors = apart.std(axis=1, ddof=1) / np.sqrt(self.seeds)
        return np.abs(apart.mean(axis=1)).max(axis=0), float(errors[:, :2].max())


def largest_differences(policy: str, scenario: lissajous_env.Scenario, seeds: int) -> tuple[np.ndarray, int]:
    """Return the largest differences of a policy over the scales, and the number of seeds that it took."""
    scales = Scales(policy, scenario)
    scales.play(seeds)
    _, error = scales.differences()
    if error > ERROR:
        scales.play(int(seeds * (error / ERROR) ** 2))
    return scales.differences()[0], scales.seeds


def _policies(scenario: lissajous_env.Scenario) -> list[str]:
    """Return the policies without a filter, portfolios aside, and the paper's method with each filter."""
    names = [name for name in baselines.names(scenario) if split_suffix(name)[0] not in portfolio.NAMES]
    return [name for name in names if split_suffix(name)[0] in (name, FILTERED)]


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--seeds", type=int, default=32)
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS)
    parser.add_argument(
        "--policies", nargs="+", help="by default all without a filter, and the paper's method with each"
    )
    options = parser.parse_args()
    rows = []
    for name in options.scenarios:
        scenario = lissajous_env.scenario(name)
        policies = options.policies or _policies(scenario)
        off, most = [], 0
        for policy in policies:
            apart, seeds = largest_differences(policy, scenario, options.seeds)
            print(name, policy, *map(number, apart), seeds, sep="  ", flush=True)
            off.append(apart)
            most = max(most, seeds)
        distance, spacing, collisions = np.array(off).T
        alike = (distance < WITHIN) & (spacing < WITHIN)
        largest = [f"{100 * differences.max():.2g} %" for differences in (distance, spacing)]
        rows.append(
            [f"`{name}`", str(len(policies)), str(alike.sum()), *largest, number(collisions.max()), f"{most:,}"]
        )
    titles = "policies", "within 1 %", "distance driven", "spacing factor", "collisions per episode", "most seeds"
    table = {"columns": ["scenario", *titles], "rows": rows}
    figures.publish(
        "similarity", f"{options.seeds} seeds and more, at {len(SCALES)} other scales", table, options.store
    )


if __name__ == "__main__":
    main()
