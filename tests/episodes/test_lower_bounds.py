"""Lower bounds of the detection time: compared with independent numbers, sweeps that reach them, and policies."""

import math

import numpy as np
import pytest

import baselines
import lissajous_env
from lissajous_env.episodes.lower_bounds import mean_time_lower_bound, robot_speed_limit, worst_case_lower_bound

STILL = {"targets.fleeing": 0.0, "targets.wandering": 0.0, "targets.drifting": 0.0}
LONG = {"targets.count": 20, "targets.arrival_rate": 0.0, "task.duration": 60.0}


def mean_time_inside(area, robots, radius, speed):
    """The bound for targets that do not move in an area, without an end."""
    return max(area - robots * math.pi * radius**2, 0) ** 2 / (4 * robots * radius * speed * area)


@pytest.mark.parametrize("entry", ["inside", "boundary"])
def test_a_scenario_without_an_end_has_the_closed_form(entry):
    # Oracle: the closed forms, of targets that are there from the start and do not move.
    scenario = lissajous_env.scenario("intruders", **STILL, **LONG, **{"targets.entry": entry})
    speed = robot_speed_limit(scenario)
    closed = mean_time_inside(51.84, 5, 0.5, speed)
    if entry == "boundary":  # what corners save is known to no robot twice
        closed = (31.2 - 5 - 2 * math.sqrt(2)) ** 2 / (2 * 5 * speed * 31.2)
    assert mean_time_lower_bound(scenario) == pytest.approx(closed, rel=5e-3)
    assert mean_time_lower_bound(scenario) < closed  # never above: rounded to the safe side


@pytest.mark.parametrize(("duration", "rate", "count"), [(3.0, 2.0, 4), (0.14, 2.0, 4)])
def test_the_end_of_an_episode_cuts_the_waiting_short(duration, rate, count):
    # Oracle: Monte Carlo of episodes in which discs sweep afresh all the time, drawn one target at a time.
    changes = {"targets.entry": "inside", "task.duration": duration, "targets.arrival_rate": rate}
    scenario = lissajous_env.scenario("intruders", **STILL, **changes, **{"targets.count": count})
    rng = np.random.default_rng(2)
    at_once, per_second = 5 * math.pi * 0.25 / 51.84, 5 * 2 * 0.5 * robot_speed_limit(scenario) / 51.84
    means, duration = [], round(duration / 0.1) * 0.1  # an episode has whole steps
    for _ in range(40_000):
        arrivals = np.ceil(rng.uniform(0, duration, rng.poisson(rate * duration)) / 0.1) * 0.1
        there = duration - np.concatenate([np.zeros(count), arrivals])
        waits = np.maximum(rng.uniform(size=len(there)) - at_once, 0) / per_second
        if len(there):
            means.append(np.minimum(waits, there).mean())
    limit = mean_time_lower_bound(scenario)
    assert limit < np.mean(means) + 3 * np.std(means) / 200
    assert limit > 0.9 * np.mean(means)
    assert worst_case_lower_bound(scenario) <= duration


def test_a_target_that_moves_or_flees_lowers_the_bound():
    def limit(**changes):
        named = {key.replace("__", "."): value for key, value in changes.items()}
        return mean_time_lower_bound(
            lissajous_env.scenario("intruders", **LONG | STILL | {"targets.entry": "inside"} | named)
        )

    still = limit()
    assert limit(targets__wandering=1.0, targets__speed=1e-9) == pytest.approx(still)
    # Relative speed: half of the area left, at 2 + 0.15 m/s instead of 2.
    assert limit(targets__wandering=1.0) == pytest.approx(still * 2.00001 / 2.15001, rel=1e-3)
    assert limit(targets__fleeing=1.0) < limit(targets__wandering=1.0)
    assert limit(targets__wandering=0.5) == pytest.approx((still + limit(targets__wandering=1.0)) / 2)


def test_a_target_that_appears_unseen_raises_the_bound():
    # Oracle: uniform on what no disc covers, the triangle below a line from 1 to 0: half of the time to sweep it.
    scenario = lissajous_env.scenario("intruders", **STILL, **LONG, **{"targets.entry": "inside"})
    inside = mean_time_lower_bound(scenario)
    object.__setattr__(scenario.targets, "entry", "unseen")
    free, per_second = 51.84 - 5 * math.pi * 0.25, 5 * 2 * 0.5 * robot_speed_limit(scenario)
    assert mean_time_lower_bound(scenario) == pytest.approx(free / (2 * per_second), rel=1e-3)
    assert mean_time_lower_bound(scenario) > inside


@pytest.mark.parametrize("limit", [mean_time_lower_bound, worst_case_lower_bound])
def test_nothing_is_said_where_nothing_is_proved(limit):
    for changes in ({"task.boundary": "remove"}, {"targets.count": 0, "targets.arrival_rate": 0.0}):
        assert math.isnan(limit(lissajous_env.scenario("intruders", **changes)))


def test_top_speed_of_robots_is_never_passed():
    # Oracle: the speeds that were driven, also by cars that are too slow for the formation in which they start.
    slow = ("intruders", "kuramoto-mpcc", {"robot.speed_max": 0.5})
    for name, policy, changes in (("intruders", "laps", {}), ("failure", "random", {}), ("team", "still", {}), slow):
        scenario = lissajous_env.scenario(name, **{"task.duration": 5.0}, **changes)
        (row,) = lissajous_env.evaluate(baselines.make(policy, scenario), scenario, seeds=[1])
        assert row["speed_max"] < 1.001 * robot_speed_limit(scenario)


@pytest.mark.parametrize("name", ["sweep", "kuramoto-mpcc"])
@pytest.mark.parametrize(
    "changes",
    [{}, STILL | {"targets.entry": "inside"}, {"targets.fleeing": 1.0, "targets.wandering": 0.0}],
    ids=["intruders", "still inside", "fleeing"],
)
def test_no_policy_of_ours_beats_them(name, changes):
    # Oracle: the bound itself, for the mean of the episodes and of every quarter of them.
    scenario = lissajous_env.scenario("intruders", **changes, **{"task.duration": 30.0})
    rows = lissajous_env.evaluate(baselines.make(name, scenario, 32), scenario, seeds=range(32))
    waited = np.array([row["detection_time_mean"] for row in rows]).reshape(4, 8)
    assert (waited.mean(axis=1) > mean_time_lower_bound(scenario)).all()


def test_a_guarantee_takes_as_long_as_to_sweep_everything():
    # Oracle: by hand. 10.8 m x 4.8 m, five discs of 0.5 m at 2 m/s: (51.84 - 3.927) / 10 s; on its boundary
    # (31.2 - 5 - 2.828) / 10 s.
    scenario = lissajous_env.scenario("intruders", **{"targets.entry": "inside"})
    speed = robot_speed_limit(scenario)
    assert worst_case_lower_bound(scenario) == pytest.approx(47.913 / (5 * speed), rel=1e-3)
    assert worst_case_lower_bound(lissajous_env.scenario("intruders")) == pytest.approx(23.372 / (5 * speed), rel=1e-3)
    assert worst_case_lower_bound(lissajous_env.scenario(scenario, **{"sensing.radius": 20.0})) == 0.0


def test_evaders_have_to_be_revisited():
    # Oracle: by hand. Six points in two rows of three, the second shifted by e: (3.6 - e) / 2 = sqrt(1.6^2 + e^2) at
    # e = 0.332, where both are 1.634 m; (1.634 - 1.2) m at 3.414 m/s, six points for five robots, less what the first
    # and last visits of 60 s save. The drives of cars differ by at most 6 %: (36.81 x 1.06 x 0.177017 - 3.681) / 0.945.
    speed = 3.4136
    assert robot_speed_limit("evaders") == pytest.approx(speed, rel=1e-4)
    apart = (1.63406 - 1.2) / speed
    wanted = 6 * 60 * apart / (5 * 60 + 11 * apart)
    assert worst_case_lower_bound("evaders") == pytest.approx(wanted, rel=2e-3)
    # Where all targets are there from the start, none has to be visited twice: only what a sweep takes.
    once = {"targets.count": 5, "targets.arrival_rate": 0.0}
    left = 5.76 - 5 * math.pi * 0.36
    assert worst_case_lower_bound(lissajous_env.scenario("evaders", **once)) == pytest.approx(
        left / (6 * speed), rel=1e-3
    )


def test_no_policy_guarantees_anything_against_rogues_that_are_too_fast():
    # Oracle: by hand. Three discs of 0.2 m block 1.2 m of 1.6 m and clear 1.2 m x 3.41 m/s; rogues regain 0.4 m x u.
    few = {"robot.count": 3, "sensing.radius": 0.2, "formation.ring": None, "formation.p": 1}
    for rogue_speed, hopeless in ((10.0, False), (10.4, True)):
        changes = few | {"targets.speed_limit": rogue_speed, "task.contamination": None, "robot.drive_factors": ()}
        scenario = lissajous_env.scenario("evaders", **changes)
        assert (worst_case_lower_bound(scenario) == pytest.approx(59.9)) == hopeless
    assert worst_case_lower_bound(lissajous_env.scenario(scenario, **{"targets.count": 1})) == 60.0


FOLLOWED = [name for name in lissajous_env.scenarios() if lissajous_env.scenario(name).task.contamination]


@pytest.mark.parametrize("name", FOLLOWED)
def test_no_episode_beats_the_bound(name):
    scenario = lissajous_env.scenario(name, **{"task.duration": 15.0})
    for policy in ("kuramoto-mpcc", "sweep") if scenario.robot.kind == "car" else ("kuramoto", "random"):
        rows = lissajous_env.evaluate(baselines.make(policy, scenario, 2), scenario, seeds=range(2))
        assert min(row["guaranteed_detection_time"] for row in rows) >= worst_case_lower_bound(scenario), policy
