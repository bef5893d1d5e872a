"""Points on the curve by closed forms, and where robots begin."""

import itertools
import math

import numpy as np
import pytest

import lissajous_env
from lissajous_env.theory import closed_forms


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


@pytest.mark.parametrize("name", ["ideal", "knot"])
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


def test_no_robots_collide_at_once():
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
    # In these worlds, robots that turn away from a wall turn towards others.
    turned = lissajous_env.Simulation("watch", 2)
    turned.reset(seeds=[361, 640])
    assert (_least_distances(turned, 1.0) > 0.999 * 2 * turned.scenario.robot.radius).all()
    np.testing.assert_array_equal(apart.robots.path.numpy()[:, :, -1], apart.robots.position.numpy())


def test_cars_of_the_included_space_can_all_come_to_rest_from_the_start():
    # Oracle: with the same drag, cars without motors meet where cars that keep their speed for 1/drag do.
    space = lissajous_env.scenario_space("monitoring-v1")
    for scenario in itertools.islice(space.scenarios("train"), 12):
        bare = lissajous_env.scenario(scenario, **{"task.contamination": None, "task.grid": None})
        least = _least_distances(lissajous_env.Simulation(bare, 32), 1 / bare.robot.drag)
        assert (least > 0.999 * 2 * bare.robot.radius).all(), scenario.name


def test_action_minus_one_turns_the_motors_of_the_included_space_off_also_with_noise():
    for scenario in itertools.islice(lissajous_env.scenario_space("monitoring-v1").scenarios("train"), 40):
        robot = scenario.resolve().robot
        deviation = 0.5 * scenario.noise.actuator * (robot.throttle_max - robot.throttle_min)
        assert robot.throttle_min == pytest.approx(robot.dead_zone - 4 * deviation)
