"""Lower bounds of the detection time: numbers computed elsewhere, sweeps that meet them, and our own policies."""

import math

import numpy as np
import pytest

import baselines
import lissajous_env
from lissajous_env.theory.limits import mean_time_inside, mean_time_on_boundary


def test_intruders_by_the_closed_form():
    # Oracle: 1.10 s, computed independently: 31.2 m of boundary, five robots at 2 m/s, 0.5 m sensors.
    scenario = lissajous_env.scenario("intruders")
    speed = scenario.robot.speed_max
    assert speed == pytest.approx(2.0, abs=0.01)
    assert mean_time_on_boundary(31.2, 5, 0.5, speed) == pytest.approx(1.10, abs=0.01)


def test_one_disc_along_a_strip_as_wide_as_itself_comes_close():
    # Oracle: Monte Carlo of the one sweep that wastes nothing: a strip 1 m wide and 100 m long, end to end at 2 m/s.
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 100, 200_000), rng.uniform(-0.5, 0.5, 200_000)
    reach = np.sqrt(0.25 - y**2)
    mean = np.maximum((x - reach) / 2, 0).mean()
    bound = mean_time_inside(100.0, 1, 0.5, 2.0)
    assert bound <= mean <= 1.02 * bound


@pytest.mark.parametrize("robots", [1, 3, 8])
def test_equally_spaced_laps_of_a_closed_line_meet_the_bound(robots):
    # Oracle: Monte Carlo: the way from the place of a target back to the next sensor's edge behind it.
    gap, radius, speed = 60.0 / robots, 0.5, 2.0
    ahead = np.random.default_rng(1).uniform(0, gap, 400_000)
    waits = np.maximum(np.minimum(ahead, gap) - radius, 0) / speed
    waits[ahead > gap - radius] = 0
    assert waits.mean() == pytest.approx(mean_time_on_boundary(60.0, robots, radius, speed), rel=5e-3)


def test_discs_that_cover_everything_leave_nothing_to_wait_for():
    assert mean_time_inside(1.0, 4, 0.5, 1.0) == 0
    assert mean_time_on_boundary(1.0, 4, 0.5, 1.0) == 0
    assert mean_time_inside(math.pi, 1, 0.5, 1.0) == pytest.approx((0.75 * math.pi) ** 2 / (2 * math.pi))


@pytest.mark.parametrize("name", ["sweep", "laps", "kuramoto-mpcc", "learned-intruders"])
@pytest.mark.parametrize("entry", ["inside", "boundary"])
def test_no_policy_of_ours_beats_them(name, entry):
    # Oracle: the bound itself, for targets that stand still; a tenth is left for corners that are cut.
    still = {"targets.fleeing": 0.0, "targets.wandering": 0.0, "targets.drifting": 0.0}
    scenario = lissajous_env.scenario("intruders", **{"targets.entry": entry, "task.duration": 30.0}, **still)
    rows = lissajous_env.evaluate(baselines.make(name, scenario, 8), scenario, seeds=range(8))
    speed = max(row["speed_max"] for row in rows)
    waited = np.mean([row["detection_time_mean"] for row in rows])
    inside = mean_time_inside(10.8 * 4.8, 5, 0.5, speed)
    bound = inside if entry == "inside" else 0.9 * mean_time_on_boundary(31.2, 5, 0.5, speed)
    assert waited > bound
