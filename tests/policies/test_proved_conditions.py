"""The proved filter at the ends of its conditions: absence, clipped speeds, own constants, and random attacks."""

import numpy as np
import pytest
import warp as wp
from test_proved import FIVE, WIDE, driven, played, towards_the_nearest

import lissajous_env
from baselines.policies.safety import commitment
from baselines.policies.safety.proved import Proved, integration_error, unmet_conditions
from benchmarks import attacked
from lissajous_env.world.observation import layout

FAILED, REMOVED = 1, 2
QUICK = {"robot.throttle_max": None, "robot.speed_max": 1.5, "task.duration": 100.0}
SILENT = {"noise.message_loss": 0.5, "formation.phase_rate": 3.0}
"""A ring neighbour's message is soon too old for the phase dynamics."""


@pytest.mark.parametrize(("way", "changed"), [
    ("schedule", {"faults.removed": ((0, 0.0), (2, 1.0), (3, 2.0))}),
    ("chance", {"faults.lost": 3, "task.duration": 4.0}),
    ("boundary", {"task.boundary": "remove"}),
    ("collision", {"task.on_collision": "remove"}),
])  # fmt: skip
def test_a_robot_is_absent_exactly_if_it_is_removed(way, changed):
    """Oracle: the true state, while robots fail and half of the messages are lost."""
    scenario = lissajous_env.scenario(FIVE, **{**QUICK, **SILENT, "faults.rate": 0.3, **changed})
    assert not unmet_conditions(scenario)
    heard = np.zeros((40, 5), dtype=bool)
    gone = failed = 0

    def outwards(simulation, rng):
        goal = 20 * np.sign(simulation.robots.position.numpy()[..., :2])
        return attacked.drive_to(simulation.robots, goal) if way == "boundary" else towards_the_nearest(simulation, rng)

    for step, (simulation, filter) in enumerate(played(scenario, 40, 40, outwards)):
        status = simulation.robots.status.numpy()
        heard |= (simulation.links.heard_at.numpy() >= 0).any(axis=-1) & (status != REMOVED)
        absent = filter._memory.presence.numpy() == commitment.REMOVED
        assert not absent[status != REMOVED].any()
        assert absent[(status == REMOVED) & (heard | (step == 0))].all()
        gone, failed = gone + absent.sum(), failed + (status == FAILED).sum()
    assert gone > 100
    assert failed > 100


def test_failed_robots_that_are_not_heard_are_not_hit():
    """Oracle: the theorem, where nearly every failed robot is silent for a while."""
    scenario = lissajous_env.scenario(FIVE, **QUICK, **SILENT, **{"faults.rate": 0.3})
    collisions, proved, broken, least = driven(scenario, 60, 60, towards_the_nearest, seed=79000)
    assert proved.mean() > 0.5
    assert collisions.sum() == 0
    assert not broken.any()
    assert least > 1


def test_the_proof_is_tested_anew_if_a_removed_robot_comes_back():
    """Story: rows show that a robot is removed, another one drives to its place, and rows show that it stands there."""
    scenario = lissajous_env.scenario(FIVE, **QUICK)
    size = scenario.curve.half_width, scenario.curve.half_height
    names = layout(scenario).names
    links = [k for k, name in enumerate(names) if name.startswith("neighbour_") or name == "works"]
    simulation = lissajous_env.Simulation(scenario, 20, seed=2)
    filter = Proved(scenario, 20)
    place = simulation.observation.numpy()[:, 0].copy()
    place[:, 4] = 0.0
    goal = np.repeat(place[:, None, :2] * size, 5, axis=1)
    for step in range(40):
        rows = simulation.observation.numpy().copy()
        if step > 0:
            rows[:, 0] = place
            rows[:, 0, links] = 0.0
        wanted = wp.array(attacked.drive_to(simulation.robots, goal).astype(np.float32), dtype=wp.float32, device="cpu")
        simulation.step(filter(wp.array(rows, dtype=wp.float32, device="cpu"), wanted))
    rows = simulation.observation.numpy().copy()
    near = np.linalg.norm(simulation.robots.position.numpy()[:, 1:, :2] - goal[:, 1:], axis=-1).min(axis=1) < 0.2
    rows[:, 0, :5] = place[:, :5]
    before = filter.tails_compatible
    filter(wp.array(rows, dtype=wp.float32, device="cpu"), wp.zeros_like(simulation.action))
    assert (near & before).sum() > 3
    assert not filter.tails_compatible[near].any()


WEAK = {"robot.drive_factors": tuple((i, 0.8) for i in range(5)), "noise.wheelbase_spread": 0.1}
SHORT = {"noise.wheelbase_spread": 0.3, "robot.steering_max": 1.0, "task.step": 0.2, "task.substeps": 64}


@pytest.mark.parametrize(("turns_below", "throttle", "changed", "steps"), [
    (0.06, -0.99, WEAK, 20), (np.inf, -1.0, SHORT, 6),
])  # fmt: skip
def test_cars_that_brake_to_a_stop_or_spin_learn_nothing_wrong(turns_below, throttle, changed, steps):
    """Oracle: the simulated cars. Weak motors brake above the dead zone; short wheelbases turn by laps in a step."""

    def wanted(simulation, _):
        turns = simulation.robots.speed.numpy() < turns_below
        return np.stack([turns, np.full(turns.shape, throttle)], axis=-1).astype(np.float32)

    scenario = lissajous_env.scenario(FIVE, **QUICK, **changed, **WIDE)
    for simulation, filter in played(scenario, 400, steps, wanted):
        known = filter._memory.factors.numpy()
        curvature = scenario.robot.wheelbase / simulation.robots.wheelbase.numpy()
        assert (curvature >= known[..., 0] * (1 - 1e-4)).all()
        assert (curvature <= known[..., 1] * (1 + 1e-4)).all()


def test_a_slow_car_that_float32_stops_stays_on_its_tail():
    """Oracle: the simulated cars, in small sub-steps and far from the middle, which roll on after 50 steps."""

    def rolling(simulation, _):
        away = attacked.drive_to(simulation.robots, 20 * simulation.robots.position.numpy()[..., :2])
        return np.where(simulation.clock.step.numpy()[:, None, None] < 50, away, np.nan).astype(np.float32)

    scenario = lissajous_env.scenario(FIVE, **QUICK, **{"task.substeps": 64})
    assert not unmet_conditions(scenario)
    begin, bound = 0.0, np.inf
    for simulation, filter in played(scenario, 40, 150, rolling):
        assert (np.linalg.norm(simulation.robots.position.numpy()[..., :2] - begin, axis=-1) <= bound).all()
        tail = filter._memory.tail.numpy()
        begin, bound = tail["begin"][..., :2].copy(), tail["w"][..., 0] + filter._terms.position_error


@pytest.mark.parametrize(("slowing", "turn"), [(0.05, 2.0), (1.0, 0.1), (1.0, 2.0)])
def test_bound_of_the_integration_error(slowing, turn):
    """Oracle: the closed form of a car that rolls on an arc, against the Runge-Kutta method in float64."""
    robot = lissajous_env.scenario("experiment", **QUICK, **{"noise.drive_spread": 0.0, "noise.wheelbase_spread": 0.0})
    radius = robot.robot.wheelbase / np.tan(robot.robot.steering_max)
    step = turn * radius / 1.5
    motor = {"robot.offset": 0.0, "robot.dead_zone": 0.0, "robot.throttle_min": 0.0}
    changed = {"task.step": step, "task.substeps": 1, "robot.drag": slowing / step, "task.duration": 100 * step}
    scenario = lissajous_env.scenario(robot, **changed, **motor)
    car, c = np.array([0.0, 0.0, 0.0, 1.5]), slowing / step

    def rate(state):
        return np.array([state[3] * np.cos(state[2]), state[3] * np.sin(state[2]), state[3] / radius, -c * state[3]])

    for n in range(1, 30):
        k1 = rate(car)
        k2 = rate(car + 0.5 * step * k1)
        k3 = rate(car + 0.5 * step * k2)
        car = car + step / 6 * (k1 + 2 * k2 + 2 * k3 + rate(car + step * k3))
        way = 1.5 / c * (1 - np.exp(-c * n * step))
        exact = radius * np.array([np.sin(way / radius), 1 - np.cos(way / radius)])
        error = np.linalg.norm(car[:2] - exact)
        assert error <= integration_error(scenario) * way + 3e-4 * radius


def test_random_attacks():
    """Oracle: the theorem, in random scenarios, of which each violates no condition that is named."""
    rows, _ = attacked.campaign(20_000, first_seed=500)
    assert sum(row[3] for row in rows) >= 20_000
    assert min(row[4] for row in rows) > 1


@pytest.mark.long
def test_random_attacks_of_ten_million_pair_steps():
    """Oracle: the theorem, as above."""
    rows, _ = attacked.campaign(10_000_000, first_seed=1_000_000)
    assert min(row[4] for row in rows) > 1
