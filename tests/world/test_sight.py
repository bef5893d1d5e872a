"""Detection between control steps: the first time that a disc contains a target, for any step length."""

import math

import numpy as np
import pytest
import warp as wp

import lissajous_env
from lissajous_env.device.compilation import OPTIONS

wp.set_module_options(OPTIONS)

# One car that drives straight ahead at 2 m/s: no drag to speed up or slow down, wheels straight.
COASTING = {
    "robot.count": 1, "formation.p": 0, "formation.ring": None, "faults.schedule": (), "noise.wheelbase_spread": 0.0,
    "noise.drive_spread": 0.0, "robot.drag": 1e-3, "robot.throttle_max": 0.11, "curve.half_width": 20.0,
    "curve.half_height": 20.0, "sensing.radius": 0.4, "targets.arrival_rate": 0.0, "targets.wandering": 0.0,
    "task.grid": None, "task.duration": 20.0,
}  # fmt: skip


@lissajous_env.target_motion
def leap(world):
    """To the other side of the middle, and back."""
    return -world.targets.position


def coasting(robot, targets, speed=2.0, name="experiment", **overrides):
    """A world with a car at a place that rolls along x at a speed, and targets at places, none of them seen yet."""
    scenario = lissajous_env.scenario(name, **{**COASTING, "targets.count": len(targets), **overrides})
    simulation = lissajous_env.Simulation(scenario)
    simulation.targets.status.fill_(1)
    simulation.targets.found_at.fill_(2**30)
    simulation.targets.in_sight.zero_()
    simulation.targets.position.assign(np.array([targets], dtype=np.float32))
    simulation.robots.position.assign(np.array([[[*robot, 0.0]]], dtype=np.float32))
    simulation.robots.heading.zero_()
    simulation.robots.speed.fill_(speed)
    return simulation


def roll(simulation, steps):
    action = np.zeros(simulation.action_shape, dtype=np.float32)
    action[..., 1] = -1
    for _ in range(steps):
        simulation.step(action)


def found_times(simulation):
    """Time of each target's detection [s], infinite before."""
    targets = simulation.targets
    times = (targets.found_at.numpy()[0] - targets.found_early.numpy()[0].astype(float)) * simulation.scenario.task.step
    return np.where(targets.found_at.numpy()[0] == 2**30, np.inf, times)


@pytest.mark.parametrize("step", [1.0, 0.1])
def test_a_car_that_passes_a_target_sees_it_when_its_disc_arrives(step):
    # Oracle: closed form. At speed v from x = 0, the disc of radius r reaches a target at (x, y) at
    # (x - sqrt(r^2 - y^2)) / v; beside it by r or more, never. So it is whatever the step, one of 1 s included, in
    # which the car drives five radii and no end of a step has most of the targets in the disc.
    places = [(1.3, 0.0), (2.77, 0.3), (4.1, -0.39), (5.0, 0.41), (6.2, 0.1), (7.0, -0.5)]
    simulation = coasting((0.0, 0.0), places, **{"task.step": step})
    roll(simulation, round(4 / step))
    expected = [(x - math.sqrt(0.16 - y * y)) / 2 if abs(y) < 0.4 else math.inf for x, y in places]
    assert found_times(simulation) == pytest.approx(expected, abs=5e-3)
    (row,) = simulation.score()
    assert row["detected_fraction"] == pytest.approx(4 / 6)
    assert simulation.latest.waiting.numpy()[0] == 2


def test_a_target_that_is_moved_by_ones_own_rule_is_seen_on_its_way():
    # Oracle: closed form: it is put from x = -1 to x = 1 in each step and back, through a disc of 0.25 m at 0.375.
    overrides = {**COASTING, "targets.custom": 1.0, "targets.count": 1, "sensing.radius": 0.25}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", extensions=(leap,), **overrides))
    simulation.robots.position.zero_()
    simulation.robots.speed.zero_()
    simulation.targets.status.fill_(0)
    simulation.targets.found_at.fill_(2**30)
    simulation.targets.position.assign(np.array([[[-1.0, 0.0]]], dtype=np.float32))
    roll(simulation, 1)
    assert found_times(simulation) == [math.inf], "it appears at the end of this step"
    roll(simulation, 1)
    assert found_times(simulation) == pytest.approx([0.1 + 0.0375], abs=1e-6)


def test_a_swarm_detects_every_target_within_the_bound():
    # Oracle: T_max = (2 pi / omega) / (N / kappa). Robots go up to 2.4 m in a control step, with discs of 0.73 m:
    # sampled at the ends of the steps, about one and a half in a hundred targets are missed for longer than that.
    simulation = lissajous_env.Simulation(lissajous_env.scenario("swarm", **{"task.grid": None}), 2)
    scenario = simulation.scenario
    rate = scenario.formation.phase_rate / scenario.alpha
    for _ in range(math.ceil(scenario.detection_time_bound / scenario.task.step) + 1):
        simulation.step(np.full(simulation.action_shape, rate / scenario.robot.phase_rate_max, dtype=np.float32))
    for row in simulation.score():
        assert row["targets"] == 2000
        assert row["detected_fraction"] == row["detected_within_bound"] == 1
        assert row["detection_time_max"] <= scenario.detection_time_bound


# Unseen entry.

UNSEEN = {
    "targets.entry": "unseen", "targets.count": 30, "targets.arrival_rate": 30.0, "targets.wandering": 0.0,
    "task.duration": 3.0, "task.grid": None, "faults.schedule": (), "robot.count": 1, "formation.p": 0,
    "formation.start": "rotated",
}  # fmt: skip


def appeared(simulation, before):
    """(K, 2) places of the targets that appeared in the latest step, and (K, N, 2) the robots of their worlds [m]."""
    appears_at = simulation.targets.appears_at.numpy()
    world, slot = np.nonzero((appears_at <= simulation.clock.step.numpy()[:, None]) & ~before)
    return simulation.targets.position.numpy()[world, slot], simulation.robots.position.numpy()[world, :, :2]


def test_an_unseen_target_appears_in_no_disc():
    # Story: one robot in a small rectangle, whose disc is a third of it. Oracle: distances in NumPy; and uniform where
    # it is not seen: of 64 places one is free but with probability 1e-30, so as many left as right, above as below.
    simulation = lissajous_env.Simulation(lissajous_env.scenario("failure", **UNSEEN, **{"sensing.radius": 0.75}), 20)
    places, robots = appeared(simulation, np.zeros(simulation.targets.status.shape, dtype=bool))
    assert len(places) == 600
    assert (np.linalg.norm(places - robots[:, 0], axis=1) >= 0.75 - 1e-6).all()
    everything = [places]
    action = np.ones(simulation.action_shape, dtype=np.float32)
    for _ in range(30):
        before = simulation.targets.appears_at.numpy() <= simulation.clock.step.numpy()[:, None]
        simulation.step(action)
        places, robots = appeared(simulation, before)
        assert (np.linalg.norm(places - robots[:, 0], axis=1) >= 0.75 - 1e-6).all()
        everything.append(places)
    x, y = np.concatenate(everything).T
    assert len(x) > 2000
    assert np.abs(x).max() <= 1.8
    assert np.abs(y).max() <= 0.8
    assert abs((x > 0).mean() - 0.5) < 0.06
    assert abs((y > 0).mean() - 0.5) < 0.06
