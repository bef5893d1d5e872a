"""The simulation against the independent float64 reference, over 200 steps of the same smooth actions.

Differences are those of float32, whose last bit is 5e-7 rad of a heading and 2e-7 m of a place; how much they may
become in 200 steps is stated beside the comparison. What happens in whole steps must agree exactly.
"""

import functools
import math

import numpy as np
import pytest
import reference
import reference_driving
import reference_observation

import lissajous_env

STEPS = 200

STRAIGHT = {"targets.turn_rate": 0.0}
MIXED = {"targets.drifting": 0.3, "targets.wandering": 0.2, "targets.fleeing": 0.3, **STRAIGHT}
SHORT_SIGHT = {"sensing.radius": 0.4, "targets.flee_radius": 0.6}
ALL_TERMS = {"task.reward_idleness": 0.1, "task.reward_effort": -0.01}
NO_RING = {"formation.p": 0, "formation.ring": None, "faults.schedule": ()}

ROAMING = {**SHORT_SIGHT, **MIXED, **ALL_TERMS, "task.reward_outside": -0.7, "robot.radius": 0.06}

# A curve without a rounded form: the reference knows the Lissajous curve alone.
WALLS = {"task.boundary": "wall", "curve.a": 1, "curve.b": 4}

DRIVES = {"robot.kind": "differential", "robot.speed_max": 2.5, "task.substeps": 6}

CASES = {
    "experiment": ("experiment", {**SHORT_SIGHT, **ALL_TERMS, **MIXED}),
    "targets stay, messages are late, a robot is lost": ("experiment", {
        "targets.leave": False, "noise.message_delay": 0.3, "messages.size": 3, "faults.removed": ((3, 12.0),),
        "faults.schedule": ((0, 4.0, 9.0), (1, 6.0, 9.5)), "sensing.radius": 0.8, **STRAIGHT, "targets.drifting": 0.5,
        "targets.wandering": 0.3,
    }),
    "failed cars roll on": ("experiment", {
        "faults.schedule": ((0, 3.0, 4.2), (2, 0.0, 1.0), (3, 6.0, 14.0)), "faults.stop": "coast",
        "task.on_collision": "stop", **SHORT_SIGHT, **MIXED,
    }),
    "slippery": ("intruders", {"robot.lateral_acceleration_max": 1.5, "task.on_collision": "remove", **STRAIGHT}),
    "failure": ("failure", {**SHORT_SIGHT, **ALL_TERMS, **MIXED}),
    "points in three dimensions": ("failure", {
        "curve.half_depth": 0.6, "curve.c": 5, "task.grid": None, "targets.drifting": 1.0, "targets.wandering": 0.0,
    }),
    "seven points on a curve of five": ("failure", {
        "robot.count": 7, "formation.p": 3, "task.on_collision": "remove", "robot.radius": 0.02, "messages.size": 2,
        "sensing.robots_seen": 4, "sensing.targets_seen": 9, **ALL_TERMS, **SHORT_SIGHT, **MIXED,
    }),
    "three cars on a curve of five": ("experiment", {
        "robot.count": 3, "formation.p": 1, "formation.ring": (2, 0, 1), "faults.schedule": (), "task.substeps": 3,
        **SHORT_SIGHT, **MIXED,
    }),
    "two cars": ("experiment", {"robot.count": 2, "robot.radius": 0.3, **NO_RING, **SHORT_SIGHT, **MIXED}),
    "cars whose curve parameter is twice their phase": ("experiment", {
        "formation.p": 1, "formation.alpha": 2, "formation.start": "random", **SHORT_SIGHT, **MIXED,
    }),
    "cars that reverse": ("experiment", {"robot.speed_min": -0.8, "robot.lateral_acceleration_max": 3.0, **ROAMING}),
    "cars that reverse between walls": ("experiment", {**WALLS, "robot.speed_min": -1.5, **ROAMING}),
    "differential drives between walls": ("experiment", {
        **DRIVES, **WALLS, "robot.speed_min": -0.4, "robot.yaw_rate_max": 6.0,
        "robot.drive_factors": ((1, 0.7),), "robot.lateral_acceleration_max": 2.0, **ROAMING,
    }),
    "cars that leave or crash are removed": ("experiment", {
        "task.boundary": "remove", "task.on_collision": "remove", "formation.start": "random", **ROAMING,
    }),
    "one car": ("experiment", {"robot.count": 1, **NO_RING, **SHORT_SIGHT, **MIXED}),
}  # fmt: skip


class Both:
    """Simulation and reference after the same actions, and by how much they ever differed."""

    def __init__(self, case: str, seed: int = 3, steps: int = STEPS):
        name, overrides = CASES[case]
        self.simulation = lissajous_env.Simulation(lissajous_env.scenario(name, **overrides), seed=seed)
        self.world = reference.world_like(self.simulation)
        self.differences = dict.fromkeys(("position", "observation", "reward", "idleness", "target"), 0.0)
        self.disagreements: list[str] = []
        self._compare()
        for action in reference_driving.smooth_actions(self.simulation.action_shape[1:], steps, seed):
            if self.world.scenario.robot.kind == "car" and not CASES[case][1].get("task.reward_outside"):
                pursued = reference_driving.pursuit(self.world)
                action = np.concatenate([0.3 * action[:, :2] + pursued, action[:, 2:]], axis=1)
            action = action.astype(np.float32)
            self.simulation.step(action[None])
            self.world.step(action)
            self._compare()

    def _compare(self) -> None:
        simulation, world = self.simulation, self.world
        self._differ("position", simulation.robots.position, [robot.position for robot in world.robots])
        self._differ("observation", simulation.observation, reference_observation.rows(world))
        terms = simulation.reward_terms.numpy()
        self._differ("reward", terms[..., [0, 1, 2, 4, 6]], world.terms[:, [0, 1, 2, 4, 6]])
        self._differ("idleness", terms[..., 3], world.terms[:, 3])
        self._agree("works", simulation.robots.status.numpy()[0] == 0, [world.works(i) for i in range(world.n)])
        here = [k for k, target in enumerate(world.targets) if target.appears_at <= world.now]
        self._agree("in sight", simulation.targets.in_sight.numpy()[0, here], [world.targets[k].in_sight for k in here])
        here = [k for k in here if world.targets[k].found_at is None or not world.scenario.targets.leave]
        if here:
            self._differ(
                "target", simulation.targets.position.numpy()[:, here], [world.targets[k].position for k in here]
            )

    def _differ(self, what: str, array, expected) -> None:
        array = array if isinstance(array, np.ndarray) else array.numpy()
        self.differences[what] = max(self.differences[what], np.abs(array[0] - expected).max())

    def _agree(self, what: str, got, expected) -> None:
        if list(got) != list(expected):
            self.disagreements.append(f"{what} at step {self.world.now}: {list(got)}, not {list(expected)}")


both = functools.cache(Both)


@pytest.mark.parametrize("case", CASES)
def test_the_simulation_is_the_reference(case):
    # Oracle: tests/reference.py. 50 um for places; four times as much where they are divided by a small sensor or a
    # phase is taken from them; more for who flees from a robot, as the direction multiplies the difference, and along a
    # wall, where the moment of a contact decides what remains of the speed.
    run = both(case)
    fleeing = run.world.scenario.targets.fleeing > 0
    assert run.disagreements == []
    place = 2e-4 if run.world.scenario.task.boundary == "wall" else 5e-5
    assert run.differences["position"] < place
    assert run.differences["target"] < (2e-3 if fleeing else place)
    assert run.differences["observation"] < (5e-3 if fleeing else 2e-4)
    assert run.differences["reward"] < 1e-6
    assert run.differences["idleness"] < 1e-3  # a cell or two, whose centre the edge of a disc just meets
    phases = [robot.phase % (2 * math.pi) for robot in run.world.robots]
    assert run.simulation.robots.phase.numpy()[0] == pytest.approx(phases, abs=2e-4)


@pytest.mark.parametrize("case", CASES)
def test_the_score_is_that_of_the_reference(case):
    # Oracle: tests/reference.py. Counts and times of events are exact, as multiples of the step; means over cells to
    # one cell in a thousand; a running maximum, a mean or a time inside a step as its terms.
    run = both(case)
    expected, got = run.world.score(), run.simulation.score()[0]
    exact = {
        "targets", "collisions", "contact_time", "outside_time", "partly_outside_time", "wall_contacts",
        "blocked_time", "coverage_time", "coverage_time_each", "recovery_time", "detected_fraction",
        "detected_within_bound",
    }  # fmt: skip
    for name, value in expected.items():
        tolerance = 1e-9 if name in exact else 2e-4 + 1e-3 * abs(value)
        assert got[name] == pytest.approx(value, abs=tolerance, nan_ok=True), name


def test_the_cases_are_not_idle():
    # Guard of the tests above: what they compare has to happen. Oracle: counts of the reference itself.
    worlds = [both(case).world for case in CASES]
    assert sum(world.collisions > 0 for world in worlds) >= 6
    assert sum(math.isfinite(world.score()["coverage_time"]) for world in worlds) >= 4
    assert any(robot.crashed for world in worlds for robot in world.robots)
    assert any(robot.left for world in worlds for robot in world.robots)
    assert any(world.outside_steps > 5 and not any(robot.left for robot in world.robots) for world in worlds)
    assert any(world.wall_contacts > 5 and world.blocked_steps > 5 for world in worlds)
    assert any(robot.speed < -0.1 for world in worlds for robot in world.robots)
    assert any(robot.stopped for world in worlds for robot in world.robots)
    assert any(world.resumed_at is not None for world in worlds)
    assert any(target.appears_at > 0 and target.found_at for world in worlds for target in world.targets)
    assert sum(any(target.found_at for target in world.targets) for world in worlds) >= 8
    assert any(target.found_at is None for world in worlds for target in world.targets)
    assert {target.motion for world in worlds for target in world.targets} == {0, 1, 2, 3}
