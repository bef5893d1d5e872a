"""The interval over trainings and seeds of `benchmarks/trainings.py`, against variances and the truth."""

import numpy as np
import pytest
from trainings import two_level_interval

from baselines.benchmark.statistics import bootstrap_interval


def simulated(rng, trainings, seeds, between=1.0, of_seeds=0.7, rest=0.5):
    effects = rng.normal(0, between, (trainings, 1)) + rng.normal(0, of_seeds, (1, seeds))
    return 3 + effects + rng.normal(0, rest, (trainings, seeds))


def test_two_levels_have_the_deviation_of_both():
    # Oracle: the variance of a mean over crossed samples, s_t^2 / K + s_e^2 / n + s^2 / (K n), averaged over 40 tables.
    rng = np.random.default_rng(9)
    widths = [np.diff(two_level_interval(simulated(rng, 12, 30), cut=0.0, resamples=500))[0] for _ in range(40)]
    deviation = np.sqrt(1 / 12 + 0.49 / 30 + 0.25 / 360)
    assert np.mean(widths) == pytest.approx(2 * 1.96 * deviation, rel=0.1)


def test_two_levels_cover_the_truth_where_episodes_alone_do_not():
    # Oracle: how often an interval holds the 3 that the tables are drawn around, over 300 tables of 6 trainings.
    rng = np.random.default_rng(10)
    tables = [simulated(rng, 6, 24) for _ in range(300)]
    both = [two_level_interval(table, resamples=400) for table in tables]
    pooled = [bootstrap_interval(table.ravel(), resamples=400) for table in tables]
    hits, alone = (np.mean([low <= 3 <= high for low, high in each]) for each in (both, pooled))
    assert 0.83 <= hits <= 0.97
    assert alone < 0.5


@pytest.mark.parametrize("rows", [[[1.0, 2.0]], [[1.0], [2.0]], [[1.0, 2.0], [1.0]], [[1.0, np.nan], [1.0, 2.0]]])
def test_two_levels_need_a_whole_table(rows):
    with pytest.raises(ValueError, match="rows_by_training must"):
        two_level_interval(rows)
