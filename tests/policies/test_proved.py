"""The proved filter: no collisions under its conditions, whatever a policy does, and its monitor where they fail."""

import math

import numpy as np
import pytest
import warp as wp

import lissajous_env
from baselines.policies.safety.proved import Proved, ProvedParameters, unmet_conditions

EXACT = {"faults.schedule": (), "faults.rate": 0.0, "targets.count": 0, "targets.arrival_rate": 0.0, "task.grid": None}
RANDOM_STARTS = {"formation.start": "random", "formation.start_noise": 1.0}
CROWD = {**EXACT, **RANDOM_STARTS, "curve.half_width": 1.8, "curve.half_height": 1.8, "task.contamination": None}
"""Fifteen cars in a square in which a car that rolls to rest from 1 m/s crosses a third."""

PAIR = lissajous_env.scenario("experiment", **{"robot.count": 2, "formation.ring": None, **EXACT, **RANDOM_STARTS})
FIVE = lissajous_env.scenario("experiment", **EXACT, **RANDOM_STARTS)
FIFTEEN = lissajous_env.scenario("team", **CROWD)
ALIKE = {"noise.wheelbase_spread": 0.0, "noise.drive_spread": 0.0}
WIDE = {"curve.half_width": 60.0, "curve.half_height": 60.0, "formation.phase_rate": 0.01}
GRIP = {"robot.lateral_acceleration_max": 1.0}
CASES = {
    "two cars": PAIR,
    "five cars": FIVE,
    "alike and fast": lissajous_env.scenario(FIVE, **ALIKE, **{"robot.throttle_max": 0.177017}),
    "fifteen cars": FIFTEEN,
    "motors that fail": lissajous_env.scenario(FIVE, **{"faults.rate": 0.2, "faults.stop": "coast"}),
    "two of five cars stop dead": lissajous_env.scenario(FIVE, **{"faults.schedule": ((0, 1.5, 3.0), (3, 2.0, 9.0))}),
    "stop dead, lost messages": lissajous_env.scenario(FIVE, **{"faults.rate": 0.2, "noise.message_loss": 0.5}),
    "a wall": lissajous_env.scenario(FIVE, **{"task.boundary": "wall"}),
    "wide turns": lissajous_env.scenario(FIVE, **ALIKE, **GRIP, **{"task.boundary": "wall", "task.step": 0.02}),
    "little grip, uneven motors": lissajous_env.scenario(FIVE, **GRIP, **{"robot.drive_factors": ((0, 0.8), (3, 1.3))}),
    "large and slow": FIVE.scaled(length=30.0, time=7.0),
    "a robot is removed": lissajous_env.scenario(FIVE, **{"faults.removed": ((1, 2.0),)}),
}


def towards_the_nearest(simulation, _):
    """Full throttle and full steering towards the nearest other robot, by the true state."""
    position = simulation.robots.position.numpy()[:, :, :2]
    offset = position[:, None] - position[:, :, None]
    square = offset[..., 0] ** 2 + offset[..., 1] ** 2 + 1e9 * np.eye(position.shape[1], dtype=np.float32)
    w, i = np.indices(square.shape[:2])
    away = offset[w, i, square.argmin(axis=2)]
    angle = np.arctan2(away[..., 1], away[..., 0]) - simulation.robots.heading.numpy()
    angle = (angle + np.pi) % (2 * np.pi) - np.pi
    return np.stack([np.clip(4 * angle, -1, 1), np.ones_like(angle)], axis=-1).astype(np.float32)


def at_random(simulation, rng):
    """Independent uniform actions, full throttle half of the time."""
    action = rng.uniform(-1, 1, simulation.action_shape).astype(np.float32)
    action[..., 1] = np.where(rng.random(action.shape[:2]) < 0.5, 1.0, action[..., 1])
    return action


def played(scenario, worlds, steps, adversary, seed=0, parameters=None, assumed=None):
    """Yield simulation and filter in each step, after the decisions and before the motion."""
    simulation, rng = lissajous_env.Simulation(scenario, worlds, seed=seed), np.random.default_rng(seed)
    filter = Proved(assumed or simulation.scenario, worlds, parameters=parameters)
    for _ in range(steps):
        wanted = wp.array(adversary(simulation, rng), dtype=wp.float32, device="cpu")
        action = filter(simulation.observation, wanted)
        yield simulation, filter
        simulation.step(action)


def driven(scenario, worlds, steps, adversary, on_step=lambda *now: None, **settings):
    """Play adversarial actions through the filter; return (W,) collisions after a proof, proofs, broken proofs.

    Also the least distance after a proof over twice the radius.
    """
    proved, broken = np.zeros((2, worlds), dtype=bool)
    collisions, least = np.zeros(worlds), np.inf
    for step, (simulation, filter) in enumerate(played(scenario, worlds, steps, adversary, **settings)):
        if step > 0:
            collisions += proved * simulation.latest.collisions.numpy().sum(axis=1) / 2
            least = min(least, least_distance(simulation, proved))
            on_step(simulation, filter)
        broken |= proved & ~filter.tails_compatible
        proved |= filter.tails_compatible
    return collisions, proved, broken, least / (2 * simulation.scenario.robot.radius)


def least_distance(simulation, worlds):
    """Least distance [m] of two robots that are there, in some worlds."""
    position = simulation.robots.position.numpy()[worlds, :, :2]
    present = simulation.robots.status.numpy()[worlds] != 2
    least = np.inf
    for i in range(1, position.shape[1]):
        apart = np.linalg.norm(position[:, i:] - position[:, :-i], axis=-1)
        least = min(least, float(apart[present[:, i:] & present[:, :-i]].min(initial=np.inf)))
    return least


ATTACKS = [*((case, towards_the_nearest) for case in CASES), ("five cars", at_random), ("wide turns", at_random)]


@pytest.mark.parametrize(("case", "adversary"), ATTACKS)
def test_no_two_robots_collide_once_their_tails_are_compatible(case, adversary):
    """Oracle: the theorem. Sub-steps' closest approach counts, and the same actions unfiltered collide."""
    scenario = CASES[case]
    worlds = 200 if scenario.num_robots == 2 else 40
    collisions, proved, broken, least = driven(scenario, worlds, 100, adversary, seed=11)
    assert not unmet_conditions(scenario)
    assert proved.mean() > 0.25
    assert collisions.sum() == 0
    assert not broken.any()
    assert least >= 1
    if adversary is towards_the_nearest:
        assert least < 1.1, "the filter is not needed"


NOISE = {"noise.actuator": 0.05, "noise.heading": 0.01, "noise.speed": 0.02, "noise.position": 0.01}


@pytest.mark.parametrize(("noise", "steps"), [({}, 30), (NOISE, 250)], ids=["exact", "noisy"])
def test_wheelbase_and_drive_are_learned_within_bounds_that_hold_the_truth(noise, steps):
    """Oracle: the constants of the simulated cars. In every second world, commands are at an end of their range."""
    most = np.where(np.arange(30) % 2, 1.0, 1e3 if noise else 1.0)[:, None, None]
    scenario, widths = lissajous_env.scenario(FIVE, **noise, **{"task.duration": 60.0}), []
    for simulation, filter in played(scenario, 30, steps, lambda *now: np.clip(most * at_random(*now), -1, 1), seed=3):
        known, robots = filter._memory.factors.numpy().astype(float), simulation.robots
        widths.append(np.median(known[..., 1::2] - known[..., ::2], axis=(0, 1)))
    curvature = scenario.robot.wheelbase / robots.wheelbase.numpy()
    drive = robots.drive.numpy() / scenario.robot.drive
    for truth, low, high in ((curvature, known[..., 0], known[..., 1]), (drive, known[..., 2], known[..., 3])):
        assert (low <= truth + 1e-6).all()
        assert (truth - 1e-6 <= high).all()
    assert (widths[-1] < (0.7 * widths[0] if noise else 1e-3)).all()


def test_far_from_all_the_action_passes_bit_for_bit():
    """Oracle: the wanted action, of cars whose tails cannot meet."""
    wide = lissajous_env.scenario(PAIR, **WIDE)
    simulation = lissajous_env.Simulation(wide, 20, seed=2)
    filter = Proved(wide, 20)
    wanted = at_random(simulation, np.random.default_rng(0))
    action = filter(simulation.observation, wp.array(wanted, dtype=wp.float32, device="cpu")).numpy()
    position = simulation.robots.position.numpy()
    far = np.linalg.norm(position[:, 0] - position[:, 1], axis=-1) > 10
    assert far.sum() > 10
    np.testing.assert_array_equal(action[far], wanted[far])


def test_who_hears_nothing_comes_to_rest():
    """Story: every message is lost, so nobody decides; the cars roll out along their first tails."""
    deaf = lissajous_env.scenario(FIVE, **{"noise.message_loss": 1.0})
    speeds = [simulation.robots.speed.numpy().max() for simulation, _ in played(deaf, 20, 80, towards_the_nearest)]
    assert driven(deaf, 20, 80, towards_the_nearest)[0].sum() == 0
    assert speeds[1] > 0.5
    assert speeds[-1] < 0.01


def test_numbers_that_are_none_leave_a_valid_action():
    """Oracle: an action that is none lets the tail go on, and a message that is none becomes 0."""
    scenario = lissajous_env.scenario(FIVE, **{"messages.size": 2})
    simulation, filter = lissajous_env.Simulation(scenario, 2, seed=0), Proved(scenario, 2)
    wanted = np.full(simulation.action_shape, 0.5, dtype=np.float32)
    wanted[1, 3] = math.nan, 0.5, 0.5, math.nan
    action = filter(simulation.observation, wp.array(wanted, dtype=wp.float32, device="cpu")).numpy()
    assert np.isfinite(action).all()
    assert action[1, 3].tolist() == [0.0, -1.0, 0.5, 0.0]


@pytest.mark.parametrize(("changed", "words"), [
    ({"task.action": "velocity"}, "1: kind of the robots must be car, got velocity"),
    ({"robot.speed_min": -0.5}, "1: robot.speed_min must be 0, since tails end at rest, got -0.5"),
    ({"robot.throttle_min": 0.11}, "1: robot.throttle_min must be at most dead_zone, 0.1"),
    ({"noise.actuator": 0.05}, "1: noise.actuator must be 0, got 0.05"),
    ({"task.step": 1.0, "task.substeps": 1}, "1: task.step must be short enough"),
    ({"noise.position": 0.01}, "2: noise.position must be 0, since normal noise has no bound"),
    ({"noise.message_delay": 0.1}, "3: noise.message_delay must be below half a step of 0.1 s"),
    ({"task.step": 1e-3, "task.substeps": 8}, "1: task.step must be long enough for a rounding error of"),
    ({"robot.drive_factors": ((0, 4.0),), "task.substeps": 8}, "2: robot.speed_max must be at least 1 / 3.9 of"),
    ({"task.on_collision": "stop"}, "5: task.on_collision must be count or remove"),
])  # fmt: skip
def test_conditions_that_a_scenario_does_not_meet_are_named(changed, words):
    (unmet,) = unmet_conditions(lissajous_env.scenario(FIVE, **changed))
    assert unmet.startswith(words)


def test_shipped_scenarios_to_which_the_theorem_applies():
    """Oracle: their fields, read by hand."""
    apply = {name for name in lissajous_env.scenarios() if not unmet_conditions(lissajous_env.scenario(name))}
    assert apply == {
        "experiment", "intruders", "intruders-inside", "evaders", "evaders-failure", "evaders-lost", "evaders-fast",
        "evaders-uneven", "evaders-walls", "hall", "intruders-walls", "team",
    }  # fmt: skip


def test_the_monitor_sees_robots_that_stop_dead():
    """Story: robots are assumed to coast; one that stands where its tail said it would roll on breaks the proof."""
    dead = lissajous_env.scenario(FIVE, **{"faults.rate": 0.2, "task.duration": 10.0})
    assumed = lissajous_env.scenario(dead, **{"faults.stop": "coast"})
    _, proved, broken, _ = driven(dead, 60, 100, towards_the_nearest, seed=11, assumed=assumed)
    assert (broken & proved).mean() > 0.5


def test_noise_within_its_bound_is_in_the_margin():
    """Oracle: the theorem with noise of 1 mm, whose bound of six deviations no draw of this test exceeds."""
    noisy = lissajous_env.scenario(FIVE, **{"noise.position": 1e-3, "noise.heading": 1e-3, "noise.speed": 1e-3})
    parameters = ProvedParameters(deviations=6.0)
    collisions, proved, broken, least = driven(noisy, 40, 100, towards_the_nearest, seed=4, parameters=parameters)
    assert proved.mean() > 0.3
    assert not broken.any()
    assert collisions.sum() == 0
    assert least > 1
