"""The simulation against the independent float64 reference, over 200 steps of the same smooth actions.

Differences are those of float32, whose last bit is 5e-7 rad of a phase and of a heading; what they grow to in 200 steps
is stated beside the comparison. Events are whole steps and must agree exactly, but for cells of the grid: there are so
many of them that a disc's edge now and then passes a centre within the last bits.
"""

import math

import numpy as np
import pytest
import reference

import lissajous_env

STEPS = 200

STRAIGHT = {"targets.turn_rate": 0.0}
MIXED = {"targets.drifting": 0.3, "targets.wandering": 0.2, "targets.fleeing": 0.3, **STRAIGHT}
SHORT_SIGHT = {"sensing.radius": 0.4, "targets.flee_radius": 0.6}
ALL_TERMS = {"task.reward_idleness": 0.1, "task.reward_effort": -0.01}
NO_RING = {"formation.p": 0, "formation.ring": None, "faults.schedule": ()}

CASES = {
    "experiment": ("experiment", {**SHORT_SIGHT, **ALL_TERMS, **MIXED}),
    "targets stay, messages are late, a robot is lost": (
        "experiment",
        {
            "targets.leave": False,
            "noise.message_delay": 0.3,
            "faults.removed": ((3, 12.0),),
            "faults.schedule": ((0, 4.0, 9.0), (1, 6.0, 9.5)),
            "sensing.radius": 0.8,
            **MIXED,
        },
    ),
    "intruders": ("intruders", STRAIGHT),
    "slippery": ("intruders", {"robot.lateral_acceleration_max": 1.5, "task.on_collision": "remove", **STRAIGHT}),
    "crashes stop": ("experiment", {"task.on_collision": "stop", **SHORT_SIGHT, **MIXED}),
    "failure": ("failure", {**SHORT_SIGHT, **ALL_TERMS, **MIXED}),
    "failure without a grid": ("failure", {"task.grid": None, "targets.drifting": 1.0, "targets.wandering": 0.0}),
    "points in three dimensions": ("failure", {"curve.half_depth": 0.6, "curve.c": 5, "targets.wandering": 0.0}),
    "seven points on a curve of five": (
        "failure",
        {"robot.count": 7, "formation.p": 3, "task.on_collision": "remove", "robot.radius": 0.02, **SHORT_SIGHT, **MIXED},
    ),
    "three cars on a curve of five": (
        "experiment",
        {
            "robot.count": 3,
            "formation.p": 1,
            "formation.ring": (2, 0, 1),
            "faults.schedule": (),
            "task.substeps": 3,
            **SHORT_SIGHT,
            **MIXED,
        },
    ),
    "two cars": ("experiment", {"robot.count": 2, "robot.radius": 0.3, **NO_RING, **SHORT_SIGHT, **MIXED}),
    "one car": ("experiment", {"robot.count": 1, **NO_RING, **SHORT_SIGHT, **MIXED}),
}


def run_both(case, seed=3, steps=STEPS, look=lambda simulation, world: None):
    """Both after the same actions; `look` is called after the reset and after each step."""
    name, overrides = CASES[case]
    simulation = lissajous_env.Simulation(lissajous_env.scenario(name, **overrides), seed=seed)
    world = reference.world_like(simulation)
    look(simulation, world)
    for action in reference.smooth_actions(simulation.action_shape[1:], steps, seed):
        if world.scenario.robot.kind == "car":
            action = 0.3 * action + reference.pursuit(world, ahead=0.4, speed=1.0)
        action = action.astype(np.float32)
        simulation.step(action[None])
        world.step(action)
        look(simulation, world)
    return simulation, world


@pytest.mark.parametrize("case", CASES)
def test_the_simulation_is_the_reference(case):
    # Oracle: tests/reference.py. Positions differ by less than 1e-4 m after a drive of up to 60 m.
    worst = {"place": 0.0, "observation": 0.0, "reward": 0.0}

    def look(simulation, world):
        robots = simulation.robots
        places = np.array([robot.position for robot in world.robots])
        worst["place"] = max(worst["place"], np.abs(robots.position.numpy()[0] - places).max())
        rows = simulation.observation.numpy()[0]
        worst["observation"] = max(worst["observation"], np.abs(rows - world.observation()).max())
        worst["reward"] = max(worst["reward"], np.abs(simulation.reward_terms.numpy()[0] - world.terms).max())
        working = [world.works(i) for i in range(world.n)]
        assert (robots.status.numpy()[0] == 0).tolist() == working
        there = [t.appears_at <= world.now for t in world.targets]
        targets = np.array([t.position for t in world.targets]).reshape(-1, 2)
        seen = np.array([t.in_sight for t in world.targets])
        np.testing.assert_array_equal(simulation.rogues.in_sight.numpy()[0][there], seen[there])
        stays = np.array([t.found_at is None or not world.scenario.targets.leave for t in world.targets]) & there
        np.testing.assert_allclose(simulation.rogues.position.numpy()[0][stays], targets[stays], atol=2e-4)

    simulation, world = run_both(case, look=look)
    print(worst)
    assert worst["place"] < 1e-4
    assert worst["observation"] < 2e-3
    assert worst["reward"] < 1e-3
    expected, got = world.score(), simulation.score()[0]
    assert {name: got[name] for name in ("targets", "collisions")} == {
        name: expected[name] for name in ("targets", "collisions")
    }
    for name, value in expected.items():
        assert got[name] == pytest.approx(value, rel=2e-3, abs=2e-4, nan_ok=True), name
    assert simulation.robots.phase.numpy()[0] == pytest.approx(
        [robot.phase % (2 * math.pi) for robot in world.robots], abs=1e-4
    )


def test_the_cases_are_not_idle():
    # Guard of the test above: what it compares has to happen. Oracle: counts of the reference itself.
    worlds = {case: run_both(case)[1] for case in CASES}
    assert sum(world.collisions > 0 for world in worlds.values()) >= 4
    assert sum(world.contact_steps > 0 and bool(world.touching) for world in worlds.values()) >= 1
    assert any(robot.crashed for world in worlds.values() for robot in world.robots)
    assert any(robot.stopped for world in worlds.values() for robot in world.robots)
    assert sum(math.isfinite(world.score()["coverage_time"]) for world in worlds.values()) >= 2
    assert any(t.appears_at > 0 and t.found_at for world in worlds.values() for t in world.targets)
    assert all(any(t.found_at for t in world.targets) for world in worlds.values())
