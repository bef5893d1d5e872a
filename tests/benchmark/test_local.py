"""The benchmark on this machine: what runs on which thread, and how it ends."""

import threading

import pytest
from rich.console import Console

import baselines
import lissajous_env
from baselines.benchmark import results_folder
from baselines.benchmark.running import measure, run
from baselines.benchmark.types import Benchmark

QUIET = Console(quiet=True)
SHORT = {"task.duration": 2.0}
SHIPPED = ("kuramoto", "open-loop", "random", "still")


def settings(out, **changes):
    given = {"scenarios": ("failure",), "policies": SHIPPED, "episodes": 3, "batch": 2, "out": out, "overrides": SHORT}
    return Benchmark(**given | changes)


def still(seen):
    """Return a factory of a user's policy that never moves a robot, and records its threads."""

    def make(scenario, num_worlds, device):
        made = baselines.make("still", scenario, num_worlds, device)
        act = made.act

        def noting(observation):
            seen.append(threading.current_thread())
            return act(observation)

        made.act = noting
        return made

    return make


def test_cells_that_are_played_at_the_same_time_give_the_rows_of_each_alone(tmp_path):
    rows = run(settings(tmp_path, scenarios=("failure", "redundant"), policies=("kuramoto", "random")), console=QUIET)
    for scenario in ("failure", "redundant"):
        for policy in ("kuramoto", "random"):
            alone = lissajous_env.evaluate(baselines.make(policy, scenario, 2), scenario, range(3), **SHORT)
            there = [row for row in rows if (row["scenario"], row["policy"]) == (scenario, policy)]
            assert [row["detection_time_mean"] for row in there] == [row["detection_time_mean"] for row in alone]


def test_what_a_user_brings_is_played_by_the_main_thread_alone(tmp_path):
    seen = []
    run(settings(tmp_path, policies=("kuramoto",)), {"mine": still(seen), "other": still(seen)}, console=QUIET)
    assert set(seen) == {threading.main_thread()}


def test_ctrl_c_ends_all_threads_and_a_second_run_goes_on(tmp_path):
    def interrupted(scenario, num_worlds, device):
        raise KeyboardInterrupt

    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        run(settings(tmp_path / "cut"), {"mine": interrupted}, console=QUIET)
    assert threading.active_count() == before
    again, whole = (run(settings(tmp_path / name), {"mine": still([])}, console=QUIET) for name in ("cut", "whole"))
    assert repr(again) == repr(whole)


def test_an_error_of_the_disk_on_another_thread_reaches_the_caller(tmp_path, monkeypatch):
    def full(self, batch):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(results_folder.Results, "add", full)
    with pytest.raises(OSError, match="No space left"):
        run(settings(tmp_path), console=QUIET)


def test_a_policy_that_refuses_a_scenario_is_left_out_unless_it_was_asked_for(tmp_path):
    # Story: five discs of 0.4 m cannot span 6 m, and portfolios refuse a second, which a comparison must survive.
    wide = {"curve.half_height": 3.0, "curve.half_width": 3.0, "sensing.radius": 0.4, "task.duration": 1.0}
    common = {"scenarios": ("experiment",), "episodes": 1, "overrides": wide, "replays": ("none",)}
    usual = measure(Benchmark(**common, out=tmp_path / "usual"), console=QUIET)
    assert [each.policy for each in usual.left_out] == ["line-abreast", "portfolio", "portfolio-guarantee"]
    assert "5 * 2 * 0.4 < 6" in usual.left_out[0].error
    assert not usual.failures
    asked = measure(Benchmark(**common, policies=("sweep", "line-abreast"), out=tmp_path / "asked"), console=QUIET)
    assert [each.policy for each in asked.failures] == ["line-abreast"]
    assert not asked.left_out
