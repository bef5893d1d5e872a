"""The benchmark of growth: its evaluation of measured times."""

import numpy as np
import pytest
import timing
from figures import ROOT
from PIL import Image
from speeds import growth
from speeds.served import Side

# Seconds of a step, ours and before: 3 ns a target, and 1 ms.
FOUND = {
    (robots, targets): (np.array([[own, 20 * own], [own, 10 * own], [own, 30 * own]]), [100.0, 200.0])
    for robots in (5, 1001)
    for targets in (1000, 10_000)
    for own in [1e-3 + 3e-9 * targets]
}


def test_a_table_of_growth_has_times_memory_and_ratios():
    # Oracle: by hand. What each further target costs is the slope, without the 1 ms.
    table = growth.table_of(FOUND)
    row = dict(zip(table["columns"], table["rows"][3], strict=True))
    assert row == {
        "one world": "1,001 robots, 10,000 targets", "ms a step": "1.03", "ns a target": "103",
        "ns each further target": "3", "peak [MB]": "100", "ms a step before": "20.6", "times faster": "20",
        "95 % interval": "10 - 30",
    }  # fmt: skip
    alone = growth.table_of({key: (times[:, :1], peaks[:1]) for key, (times, peaks) in FOUND.items()})
    assert alone["rows"][0] == ["5 robots, 1,000 targets", "1", "1e+03", "", "100"]


def test_an_interval_of_a_ratio_is_that_of_pairs():
    # Oracle: pairs that all slow down together have one ratio, whatever their times; others scatter around theirs.
    slow = np.linspace(1, 5, 20)
    assert timing.ratio(slow, 7 * slow) == pytest.approx((7, 7, 7))
    ratios = np.random.default_rng(0).lognormal(np.log(4), 0.1, 200)
    middle, low, high = timing.ratio(np.ones(200), ratios)
    assert low < middle < high
    assert low < 4 < high
    assert high - low < 0.3


def test_a_picture_is_drawn(tmp_path):
    growth.draw(FOUND, tmp_path / "growth.png")
    with Image.open(tmp_path / "growth.png") as picture:
        assert picture.size == (1050, 690)
        assert len(set(picture.convert("RGB").getdata())) > 20


def test_what_is_measured_is_a_step_of_a_world():
    # Oracle: a process that takes some steps has taken time and memory; no thread takes more than all.
    sides = [Side(ROOT, 101, 1000, 1)]
    times, peaks = growth.measured(sides, 2)
    assert times.shape == (2, 1)
    assert (times > 1e-5).all()
    assert (times < 1.0).all()
    assert 50 < peaks[0] < 600
