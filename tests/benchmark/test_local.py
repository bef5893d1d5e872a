"""The benchmark on this machine: what runs on which thread, and how it ends."""

import threading

import pytest
from benchmarks_in_the_small import QUIET, SHORT, furthest, small

import baselines
import lissajous_env
from baselines.benchmark import local, results_folder, types
from baselines.benchmark.running import measure, run
from baselines.benchmark.types import Cell

THREE = {"policies": ("kuramoto", "random", "still"), "episodes": 3}


def still(seen):
    """Return a factory of a user's policy that never moves a robot, and records its threads."""

    def make(scenario, num_worlds, device):
        policy = baselines.make("still", scenario, num_worlds, device)
        act = policy.act

        def noting(observation):
            seen.append(threading.current_thread())
            return act(observation)

        policy.act = noting
        return policy

    return make


def test_cells_that_are_played_at_the_same_time_give_the_rows_of_each_alone(tmp_path):
    seen = []
    rows = run(small(tmp_path, scenarios=("failure", "redundant"), **THREE), {"mine": still(seen)}, console=QUIET)
    for scenario in ("failure", "redundant"):
        for policy in ("kuramoto", "random"):
            alone = lissajous_env.evaluate(baselines.make(policy, scenario, 2), scenario, range(3), **SHORT)
            there = [row for row in rows if (row["scenario"], row["policy"]) == (scenario, policy)]
            assert [row["detection_time_mean"] for row in there] == [row["detection_time_mean"] for row in alone]
    assert set(seen) == {threading.main_thread()}  # what a user brings


def test_ctrl_c_ends_all_threads_and_a_second_run_goes_on(tmp_path):
    def interrupted(scenario, num_worlds, device):
        raise KeyboardInterrupt

    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        run(small(tmp_path / "cut", **THREE), {"mine": interrupted}, console=QUIET)
    assert threading.active_count() == before
    again, whole = (
        run(small(tmp_path / name, **THREE), {"mine": still([])}, console=QUIET) for name in ("cut", "whole")
    )
    assert repr(again) == repr(whole)


def test_an_error_of_the_disk_on_another_thread_reaches_the_caller(tmp_path, monkeypatch):
    def full(self, batch):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(results_folder.Results, "add", full)
    with pytest.raises(OSError, match="No space left"):
        run(small(tmp_path, **THREE), console=QUIET)


def test_code_of_users_is_played_by_the_main_thread():
    scenario = lissajous_env.scenario("failure")
    baselines.register("theirs", None, still([]))
    lissajous_env.rogue("theirs")(lambda rows: rows[..., :2])
    assert local.may_be_shared(Cell(scenario, "kuramoto", None), "cpu")
    for theirs in ({"extensions": (furthest,)}, {"rogues": "theirs"}):
        assert not local.may_be_shared(Cell(lissajous_env.scenario("failure", **theirs), "kuramoto", None), "cpu")
    assert not local.may_be_shared(Cell(scenario, "theirs", None), "cpu")
    assert not local.may_be_shared(Cell(scenario, "kuramoto", None), "cuda")


def test_an_error_stops_the_other_jobs_and_is_raised(monkeypatch):
    monkeypatch.setattr(local, "cores", lambda: 2)
    waited = []

    def play(_, numbers, stopped):
        if not numbers:
            raise OSError("full")
        waited.append(stopped.wait(600))

    cell = Cell(lissajous_env.scenario("failure"), "kuramoto", None)
    with pytest.raises(OSError, match="full"):
        local.on_cores([(cell, [1]), (cell, [])], "cpu", play)
    assert waited == [True]


def test_a_policy_that_refuses_a_scenario_is_left_out_unless_it_was_asked_for(tmp_path, monkeypatch):
    # Story: five discs of 0.4 m cannot span 6 m, which a comparison of the standard policies must survive.
    wide = {"curve.half_height": 3.0, "curve.half_width": 3.0, "sensing.radius": 0.4, "task.duration": 1.0}
    common = {"scenarios": ("experiment",), "episodes": 1, "overrides": wide}
    monkeypatch.setattr(types, "POLICIES", ("sweep", "line-abreast"))
    usual = measure(small(tmp_path / "usual", **common, policies=()), console=QUIET)
    assert [refusal.policy for refusal in usual.left_out] == ["line-abreast"]
    assert "to span 6 m with discs of 0.4 m" in usual.left_out[0].error
    assert not usual.failures
    asked = measure(small(tmp_path / "asked", **common, policies=("sweep", "line-abreast")), console=QUIET)
    assert [failure.policy for failure in asked.failures] == ["line-abreast"]
    assert not asked.left_out
