"""Motion of robots: cars compared with closed forms of (12) and the integrator's order, points with the curve."""

import itertools
import math

import numpy as np
import pytest
import reference
import reference_driving
import warp as wp

import lissajous_env
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.theory import closed_forms

wp.set_module_options(OPTIONS)

ALONE = {
    "robot.count": 1,
    "formation.p": 0,
    "formation.ring": None,
    "formation.start_noise": 0.0,
    "faults.schedule": (),
    "targets.count": 0,
    "targets.arrival_rate": 0.0,
    "task.grid": None,
    "noise.wheelbase_spread": 0.0,
    "noise.drive_spread": 0.0,
}


def one_car(**overrides):
    scenario = lissajous_env.scenario("experiment", **ALONE, **{"task.duration": 200.0, **overrides})
    return lissajous_env.Simulation(scenario)


def throttle_action(robot, throttle):
    return 2 * (throttle - robot.throttle_min) / (robot.throttle_max - robot.throttle_min) - 1


def drive(simulation, action, steps):
    """(steps + 1, 4) x, y, heading, speed of the only car under a constant action."""
    states = []
    for k in range(steps + 1):
        if k:
            simulation.step(np.array(action, dtype=np.float32)[None, None])
        robots = simulation.robots
        x, y, _ = robots.position.numpy()[0, 0]
        states.append([x, y, robots.heading.numpy()[0, 0], robots.speed.numpy()[0, 0]])
    return np.array(states, dtype=float)


@pytest.mark.parametrize("steering", [1.0, -0.5, 0.2])
def test_a_car_drives_a_circle_of_radius_wheelbase_over_tan_steering(steering):
    # Oracle: closed form l / tan(delta); the circle is fitted to the places of one car at steady speed.
    simulation = one_car(**{"robot.wheelbase": 0.3})
    robot = simulation.scenario.robot
    action = [steering, throttle_action(robot, 0.12)]
    drive(simulation, action, 150)
    x, y, heading, _ = drive(simulation, action, 100).T
    radius = robot.wheelbase / math.tan(steering * robot.steering_max)
    # The centre lies a radius to the left of the car, wherever it is; sub-steps cost 1e-4 of the radius.
    centre = np.stack([x - radius * np.sin(heading), y + radius * np.cos(heading)])
    assert np.abs(centre - centre.mean(axis=1, keepdims=True)).max() < 3e-4 * abs(radius)
    fit = np.linalg.lstsq(np.stack([2 * x, 2 * y, np.ones_like(x)], axis=1), x**2 + y**2, rcond=None)[0]
    assert math.sqrt(fit[2] + fit[0] ** 2 + fit[1] ** 2) == pytest.approx(abs(radius), rel=1e-4)


@pytest.mark.parametrize("throttle", [0.11, 0.15, 0.25])
def test_the_steady_speed_is_that_of_drive_offset_and_drag(throttle):
    # Oracle: closed form (drive tau - offset) / drag.
    simulation = one_car()
    robot = simulation.scenario.robot
    speed = drive(simulation, [0.3, throttle_action(robot, throttle)], 180)[-1, 3]
    assert speed == pytest.approx((robot.drive * throttle - robot.offset) / robot.drag, rel=1e-4, abs=1e-5)


def test_a_car_coasts_in_the_dead_zone():
    # Oracle: closed form v0 exp(-c t) up to the edge of the dead zone; just above it the motor drives.
    simulation = one_car(**{"robot.dead_zone": 0.12, "robot.offset": 3.0})
    robot = simulation.scenario.robot
    speeds = drive(simulation, [0.0, throttle_action(robot, 0.119)], 50)[:, 3]
    assert speeds == pytest.approx(speeds[0] * np.exp(-robot.drag * 0.1 * np.arange(51)), rel=1e-4)
    assert drive(simulation, [0.0, throttle_action(robot, 0.121)], 10)[-1, 3] > 0.5


@pytest.mark.parametrize("limit", [0.5, 2.0])
def test_grip_limits_the_yaw_rate(limit):
    # Oracle: closed form, yaw rate a / v, so that the centripetal acceleration v omega is the limit.
    simulation = one_car(**{"robot.lateral_acceleration_max": limit})
    robot = simulation.scenario.robot
    action = [-1.0, throttle_action(robot, 0.15)]
    drive(simulation, action, 150)
    _, _, heading, speed = drive(simulation, action, 50).T
    turned = np.unwrap(heading)
    assert (turned[-1] - turned[0]) / 5.0 == pytest.approx(-limit / speed[0], rel=1e-4)
    free = drive(one_car(**{"robot.lateral_acceleration_max": 1e3}), action, 50)
    assert free == pytest.approx(drive(one_car(), action, 50), abs=0)


def test_uneven_cars_differ_by_their_spread():
    # Oracle: mean and deviation of a normal distribution, clipped at three deviations.
    overrides = {"noise.wheelbase_spread": 0.05, "noise.drive_spread": 0.02}
    scenario = lissajous_env.scenario("experiment", **overrides)
    robots = lissajous_env.Simulation(scenario, 2000).robots
    for drawn, middle, spread in [(robots.wheelbase, 0.175, 0.05), (robots.drive, 36.81, 0.02)]:
        relative = drawn.numpy() / middle - 1
        assert abs(relative.mean()) < 4 * spread / math.sqrt(relative.size)
        assert relative.std() == pytest.approx(spread, rel=0.03)
        assert np.abs(relative).max() <= 3.001 * spread


def test_cars_with_their_own_motors_reach_their_own_top_speeds():
    # Oracle: the equilibrium of the motor by hand, (36.81 f tau - 3.681) / 0.945 at full throttle, f per robot.
    factors = np.array([0.7824, 0.855, 1.0, 1.0725, 1.145])
    even = {"noise.drive_spread": 0.0, "task.duration": 30.0}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("evaders-uneven", **even))
    action = np.ones((1, 5, 2), dtype=np.float32)
    action[..., 0] = 0.0
    for _ in range(200):
        simulation.step(action)
    wanted = (36.81 * factors * 0.177017 - 3.681) / 0.945
    np.testing.assert_allclose(simulation.robots.speed.numpy()[0], wanted, rtol=1e-4)
    assert wanted == pytest.approx([1.5, 2.0, 3.0, 3.5, 4.0], abs=0.01)
    doubled = lissajous_env.scenario("experiment", **{"robot.drive_factors": ((1, 0.5), (1, 3.0))})
    assert doubled.drive_factors.tolist() == [1.0, 1.5, 1.0, 1.0, 1.0]


def test_the_phase_of_a_car_is_that_of_the_nearest_point_of_its_branch():
    # Oracle: a dense search for the nearest point within 0.3 rad, at each of 400 steps near curve (16). The phase gets
    # one correction in a step, so it lags by millimetres; in the tight turns, where the nearest point leaps ahead, by
    # centimetres for a few steps.
    simulation = one_car()
    world = reference.world_like(simulation)
    curve, around = simulation.scenario.curve, np.linspace(-0.3, 0.3, 6001)
    excess, phases = [], []
    for action in reference_driving.smooth_actions((1, 2), 400, seed=1):
        action = (reference_driving.pursuit(world) + 0.2 * action).astype(np.float32)
        simulation.step(action[None])
        world.step(action)
        place = simulation.robots.position.numpy()[0, 0, :2]
        phases.append(float(simulation.robots.phase.numpy()[0, 0]))
        distance = np.linalg.norm(closed_forms.curve_point(curve, phases[-1] + around) - place, axis=1)
        excess.append(np.linalg.norm(closed_forms.curve_point(curve, phases[-1]) - place) - distance.min())
    assert np.percentile(excess, 80) < 5e-3
    assert np.percentile(excess, 95) < 0.03
    assert max(excess) < 0.2
    # No jump to another branch, of which there are seven to cross in a lap: the way along the curve adds up.
    steps = np.diff(np.unwrap(phases))
    assert steps.max() < 0.101  # the limit of a correction
    assert steps.min() > -0.05
    assert steps.sum() > 2 * math.pi
    assert 39.9 * 1.0 * 0.8 < steps.sum() / (2 * math.pi) * 23.17 < 39.9 * 1.0 * 1.4


# Points on the curve.


@pytest.mark.parametrize("depth", [0.0, 0.7])
def test_a_point_goes_on_at_the_commanded_rate_and_stays_on_the_curve(depth):
    # Oracle: closed form theta0 + rate t, position (10), velocity r' alpha rate.
    overrides = {"faults.schedule": (), "formation.alpha": 3, "curve.half_depth": depth, "curve.c": 5}
    simulation = lissajous_env.Simulation(lissajous_env.scenario("failure", **overrides), seed=4)
    scenario = simulation.scenario
    curve, top = scenario.curve, scenario.robot.phase_rate_max
    rates = np.array([-1.0, -0.3, 0.0, 0.4, 1.0])
    start = simulation.robots.phase.numpy()[0].astype(float)
    for k in range(1, 101):
        simulation.step(rates[None, :, None])
        phases = start + rates * top * 0.1 * k
        got = simulation.robots.phase.numpy()[0]
        assert got.min() >= 0
        assert got.max() < 2 * math.pi
        np.testing.assert_allclose(np.exp(1j * got), np.exp(1j * phases), atol=2e-5)
        places = closed_forms.curve_point_3d(curve, 3 * phases)
        np.testing.assert_allclose(simulation.robots.position.numpy()[0], places, atol=3e-4)
    speed = closed_forms.curve_speed(curve, 3 * phases) * np.abs(3 * rates * top)
    np.testing.assert_allclose(simulation.robots.speed.numpy()[0], speed, rtol=2e-3, atol=2e-3)
    tangent = np.stack([-np.sin(3 * 3 * phases) * 3 * 1.8, np.cos(2 * 3 * phases) * 2 * 0.8]) * rates
    heading = np.arctan2(tangent[1], tangent[0])
    moving = rates != 0
    turned = np.exp(1j * (simulation.robots.heading.numpy()[0] - heading))[moving]
    np.testing.assert_allclose(turned, 1, atol=5e-3)


@pytest.mark.parametrize("name", ["ideal", "perturbation", "failure", "knot", "swarm"])
def test_no_point_goes_at_more_than_three_times_the_rate_of_the_formation(name):
    # Oracle: full action for one step, by phases; K = 1 alone would ask for up to 160 times in `ideal`.
    simulation = lissajous_env.Simulation(lissajous_env.scenario(name, **{"targets.count": 0, "task.grid": None}))
    before = simulation.robots.phase.numpy().copy()
    simulation.step(np.ones(simulation.action_shape, dtype=np.float32))
    scenario = simulation.scenario
    moved = (simulation.robots.phase.numpy() - before) % (2 * math.pi)
    own = scenario.formation.phase_rate / scenario.alpha
    np.testing.assert_allclose(moved, 3 * own * scenario.task.step, rtol=1e-5)


def test_phases_of_the_swarm_are_fine_enough_for_its_bodies():
    # Oracle: closed form of (2) and (3) after 30 s. alpha a = 4,947 multiplies every rounding of a phase: in float32
    # the points would be off by metres, with bodies of 6 mm.
    simulation = lissajous_env.Simulation(lissajous_env.scenario("swarm"), seed=1)
    scenario = simulation.scenario
    own = scenario.formation.phase_rate / scenario.alpha
    start = simulation.robots.phase.numpy()[0]
    turn = np.angle(np.exp(1j * (start - scenario.equilibrium)).mean())
    action = np.full(simulation.action_shape, own / scenario.robot.phase_rate_max, dtype=np.float32)
    for _ in range(scenario.task.steps):
        simulation.step(action)
    rate = float(action[0, 0, 0]) * scenario.robot.phase_rate_max
    phases = scenario.alpha * (scenario.equilibrium + turn + rate * scenario.task.duration)
    places = closed_forms.curve_point(scenario.curve, phases)
    assert np.abs(simulation.robots.position.numpy()[0, :, :2] - places).max() < 2e-3
    (row,) = simulation.score()
    assert row["collisions"] == 0
    assert row["min_separation"] > 2 * scenario.robot_radius_bound


# Where they begin.


def test_starts_are_as_the_formation_says():
    # Oracle: equation (2) and the statistics of what is random.
    def phases(**overrides):
        scenario = lissajous_env.scenario("experiment", **{"formation.start_noise": 0.0, **overrides})
        return scenario, lissajous_env.Simulation(scenario, 4000, seed=9).robots.phase.numpy()

    scenario, start = phases()
    equilibrium = closed_forms.equilibrium_phases(5, 2, (0, 1, 4, 2, 3))
    np.testing.assert_allclose(np.angle(np.exp(1j * (start - equilibrium))), 0, atol=1e-6)
    displaced = np.angle(np.exp(1j * (phases(**{"formation.displaced": ((1, 0.2), (1, 0.1))})[1] - equilibrium)))
    np.testing.assert_allclose(displaced, np.broadcast_to([0, 0.3, 0, 0, 0], displaced.shape), atol=1e-6)
    noisy = np.angle(np.exp(1j * (phases(**{"formation.start_noise": 0.1})[1] - equilibrium)))
    assert noisy.std() == pytest.approx(0.1, rel=0.03)
    assert abs(noisy.mean()) < 0.1 * 4 / math.sqrt(noisy.size)
    turned = np.angle(np.exp(1j * (phases(**{"formation.start": "rotated"})[1] - equilibrium)))
    assert np.abs(turned - turned[:, :1]).max() < 1e-5
    assert abs(np.exp(1j * turned[:, 0]).mean()) < 4 / math.sqrt(4000)
    free = phases(**{"formation.start": "random"})[1]
    assert abs(np.exp(1j * free).mean()) < 4 / math.sqrt(free.size)
    assert abs(np.exp(1j * (free[:, 0] - free[:, 1])).mean()) < 4 / math.sqrt(4000)
    speed = closed_forms.curve_speed(scenario.curve, scenario.alpha * equilibrium) * 0.3
    np.testing.assert_allclose(lissajous_env.Simulation(scenario).robots.speed.numpy()[0], speed, rtol=1e-4)


def _least_distances(simulation, time):
    """Return the smallest distance (W, N, N) of robots that go straight on for a time [s], from 300 moments of it."""
    place, speed, heading = (array.numpy() for array in (simulation.robots.position, simulation.robots.speed,
                                                         simulation.robots.heading))  # fmt: skip
    velocity = speed[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    apart = place[:, :, None, :2] - place[:, None, :, :2]
    parting = velocity[:, :, None] - velocity[:, None]
    least = np.full(apart.shape[:-1], np.inf)
    for moment in np.linspace(0, time, 300):
        least = np.minimum(least, np.linalg.norm(apart + moment * parting, axis=-1))
    return least + np.where(np.eye(least.shape[1], dtype=bool), np.inf, 0)


def test_no_robots_of_a_team_collide_at_once():
    # Oracle: straight lines, in NumPy, and the starts without a headway, which all other worlds have.
    scenario = lissajous_env.scenario("team", **{"task.contamination": None, "task.duration": 1.0})
    headway, touch = scenario.formation.start_headway, 2 * scenario.robot.radius
    plain = lissajous_env.Simulation(scenario, 128, **{"formation.start_headway": 0.0})
    apart = lissajous_env.Simulation(scenario, 128)
    meets = (_least_distances(plain, headway) < touch).any(axis=(1, 2))
    assert 10 < meets.sum() < 64
    assert (_least_distances(apart, headway) > 0.999 * touch).all()
    before, after = plain.robots.phase.numpy(), apart.robots.phase.numpy()
    np.testing.assert_array_equal(before[~meets], after[~meets])
    changed = (before != after).sum(axis=1)
    assert (changed[meets] >= 1).all()
    assert changed.max() <= 4  # of fifteen
    np.testing.assert_array_equal(apart.robots.track.numpy()[:, :, -1], apart.robots.position.numpy())


def test_cars_of_the_included_space_can_all_come_to_rest_from_the_start():
    # Oracle: with the same drag, cars without motors meet where cars that keep their speed for 1/drag do.
    space = lissajous_env.scenario_space("monitoring-v1")
    for scenario in itertools.islice(space.scenarios("train"), 12):
        made = lissajous_env.scenario(scenario, **{"task.contamination": None, "task.grid": None})
        least = _least_distances(lissajous_env.Simulation(made, 32), 1 / made.robot.drag)
        assert (least > 0.999 * 2 * made.robot.radius).all(), scenario.name


def test_action_minus_one_turns_the_motors_of_the_included_space_off_also_with_noise():
    for scenario in itertools.islice(lissajous_env.scenario_space("monitoring-v1").scenarios("train"), 40):
        robot = scenario.resolve().robot
        deviation = 0.5 * scenario.noise.actuator * (robot.throttle_max - robot.throttle_min)
        assert robot.throttle_min == pytest.approx(robot.dead_zone - 4 * deviation)


def test_a_start_without_room_ends():
    # Two robots whose places are given leave no other draw: the last one remains, and a reset ends.
    together = {"formation.displaced": ((1, 2 * math.pi / 5), (1, 2 * math.pi / 5)), "formation.start_headway": 0.2}
    scenario = lissajous_env.scenario("experiment", **{"formation.start_noise": 0.0, **together})
    assert _least_distances(lissajous_env.Simulation(scenario), 0.0).min() < 2 * scenario.robot.radius
