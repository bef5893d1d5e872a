"""Detection times of targets in a benchmark, and the Kaplan-Meier estimate of the detected fraction."""

import json

import numpy as np
import pytest
from rich.console import Console

from baselines.benchmark import results_folder
from baselines.benchmark.running import measure, run
from baselines.benchmark.statistics import share_detected
from baselines.benchmark.types import Benchmark

QUIET = Console(quiet=True)


def small(out, **changes):
    given = {"scenarios": ("failure",), "policies": ("kuramoto", "still"), "episodes": 4, "batch": 2}
    overrides = {"task.duration": 4.0, "sensing.radius": 0.3}
    return Benchmark(**given | {"out": out, "overrides": overrides} | changes)


def lines(folder):
    return (folder / results_folder.DETECTIONS).read_text().splitlines()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A benchmark's outcome and its folder."""
    out = tmp_path_factory.mktemp("made") / "out"
    return measure(small(out), console=QUIET), out


def test_the_share_detected_is_the_product_limit():
    # Oracle: Kaplan and Meier's product by hand. Of five, one is seen after 1 s; one was there for 2 s unseen; of the
    # three left one is seen after 3 s; one was there for 3 s; the last is seen after 5 s.
    times, share = share_detected([1.0, 3.0, 5.0], [2.0, 3.0])
    assert times.tolist() == [1, 2, 3, 5]
    survival = np.array([4 / 5, 4 / 5, 4 / 5 * 2 / 3, 0])
    assert share == pytest.approx(1 - survival)


def test_who_leaves_early_unseen_does_not_bend_the_curve():
    # Oracle: closed form. Targets are seen at an exponential time of mean 1 s; half of the episodes end early. The
    # share seen within a second is 1 - 1/e all the same; counted as failed, or left out, it would be off by far.
    rng = np.random.default_rng(0)
    seen, left = rng.exponential(size=40_000), rng.uniform(0, 2, size=40_000)
    found = seen <= left
    times, share = share_detected(seen[found], left[~found])
    at = share[np.searchsorted(times, 1.0) - 1]
    assert at == pytest.approx(1 - np.exp(-1), abs=0.01)
    assert abs((seen[found] <= 1).sum() / len(seen) - at) > 0.05
    assert abs((seen[found] <= 1).mean() - at) > 0.05


def test_the_times_kept_are_those_of_the_score(made):
    # Oracle: the score rows: how many, how many were found, and the mean.
    outcome, out = made
    kept = {(e["policy"], e["episode"]): e for e in map(json.loads, lines(out))}
    assert len(kept) == len(outcome.rows) == 8
    for row in outcome.rows:
        entry = kept[row["policy"], row["episode"]]
        times = [*entry["found"], *entry["unfound"]]
        assert len(times) == row["targets"]
        assert len(entry["found"]) == pytest.approx(row["detected_fraction"] * row["targets"])
        assert np.mean(times) == pytest.approx(row["detection_time_mean"], abs=1e-6)
    assert any(entry["unfound"] for entry in kept.values())


def test_the_curves_are_those_of_all_episodes_of_a_cell(made):
    outcome, out = made
    of = [entry for entry in map(json.loads, lines(out)) if entry["policy"] == "still"]
    found, unfound = (np.concatenate([entry[name] for entry in of]) for name in ("found", "unfound"))
    times, share = share_detected(found, unfound)
    got_times, got_share = outcome.table.curves["failure"]["still"]
    np.testing.assert_array_equal(got_times, times)
    np.testing.assert_array_equal(got_share, share)


def test_an_interrupted_benchmark_ends_with_the_same_curves(made, tmp_path):
    # Oracle: the one that was not. A kill may leave the times of episodes whose rows are not there yet.
    run(small(tmp_path, episodes=2), console=QUIET)
    rows = (tmp_path / "episodes.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "episodes.jsonl").write_text("".join(rows[:-1]))
    outcome = measure(small(tmp_path), console=QUIET)
    for policy, (times, share) in made[0].table.curves["failure"].items():
        np.testing.assert_array_equal(outcome.table.curves["failure"][policy][0], times)
        np.testing.assert_array_equal(outcome.table.curves["failure"][policy][1], share)


@pytest.mark.parametrize(
    "change",
    [{"found": [-1.0]}, {"unfound": ["long"]}, {"episode": 64}, {"policy": 3}, {"found": [1e300]}, {"more": 1}],
)  # fmt: skip
def test_a_damaged_line_is_refused_by_file_and_number(tmp_path, change):
    run(small(tmp_path, episodes=1), console=QUIET)
    first, second = lines(tmp_path)
    (tmp_path / results_folder.DETECTIONS).write_text(f"{first}\n{json.dumps(json.loads(second) | change)}\n")
    with pytest.raises(ValueError, match=r"detections\.jsonl, line 2: .*; delete that line"):
        run(small(tmp_path, episodes=1), console=QUIET)
