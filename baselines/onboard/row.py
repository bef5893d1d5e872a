"""The observation row of one robot outside the simulation, filled by the stages that fill the rows of a simulation."""

import math
from collections.abc import Sequence

import numpy as np
import warp as wp

from baselines.onboard.signals import Message, Odometry
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.program import Program, Stage
from lissajous_env.device.stage import ROBOT
from lissajous_env.device.structs import NoiseStruct, allocate
from lissajous_env.device.warp_abi import fields_of
from lissajous_env.parameters.extensions import ObservationEntry
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory.geometry import locate
from lissajous_env.wording import require
from lissajous_env.world.observation import layout
from lissajous_env.world.observing import observe
from lissajous_env.world.robots.nearby import Bins
from lissajous_env.world.robots.signals import follow_curve, measure
from lissajous_env.world.state import FAILED, NOWHERE, REMOVED, WORKING, Robots, Targets
from lissajous_env.world.values import constants_of, state_of

_TICKS = 1024
"""Ticks in a control step, by which the ages of messages are measured."""
_NOW = 1 << 24
"""Present tick: later than the age of any message that counts."""


class Row:
    """The observation row of robot `robot` of a scenario, in a world of the robot and what it has in sight.

    Raises:
        ValueError: the scenario has observation entries that require a simulation, or actions that are no commands.
    """

    def __init__(self, scenario: Scenario, robot: int):
        _check(scenario)
        device, sensing = as_device("cpu"), scenario.sensing
        shape, size = (1, 1 + sensing.robots_seen), layout(scenario).size
        state = state_of(scenario, 1, size, 1, device)
        state["robots"] = allocate(Robots, {"path": (*shape, 1)}, shape, device)
        state["targets"] = allocate(Targets, {}, (1, sensing.targets_seen), device)
        state["clock"].active.fill_(1)
        state["clock"].step.fill_(_NOW)
        nearest = wp.zeros((1, 1, sensing.most_seen), dtype=wp.vec2, device=device)
        row = wp.zeros((1, 1, size), dtype=wp.float32, device=device)
        values = constants_of(scenario, device) | state | {"nearest": nearest, "observation": row}
        values |= {"noise": NoiseStruct(), "bins": Bins(), "age_per_step": values["age_per_step"] / _TICKS}
        with compile_quietly():
            self._follow, self._measure, self._observe = (
                Program([Stage(stage.key, stage)], values, {ROBOT: 1}, 1, device)
                for stage in (follow_curve, measure, observe)
            )
        self._state, self._row = state, row  # of which the arrays below are views
        self._robots, self._targets, self._links = (
            {name: array.numpy()[0] for name, array in fields_of(state[part]).items()}
            for part in ("robots", "targets", "links")
        )
        self._numbers, self._targets_in_sight = state["messages"].heard.numpy()[0, 0], state["latest"].in_sight.numpy()
        self._scenario = scenario
        self._robot, self._start = robot, scenario.equilibrium + scenario.displacements  # phases at the start [rad]
        self.values = row.numpy()[0, 0]
        """(D,) the row."""
        self.forget()

    def forget(self) -> None:
        """Forget the phase, which is computed from the next pose, because the robot may have been moved."""
        self.pose: Odometry | None = None
        """The latest pose; None if the phase is not known."""

    @property
    def sent(self) -> tuple[float, float, float, float]:
        """Cosine and sine of the phase, and x, y [m], as the robot sends them to its ring neighbours."""
        turn, measured = self._robots["measured_turn"][0], self._robots["measured"][0]
        return float(turn[0]), float(turn[1]), float(measured[0]), float(measured[1])

    def place_detections(self, robots: np.ndarray, targets: np.ndarray) -> None:
        """Place what the sensor detects, relative to the robot: robots (K, 4) in [m] and [m/s], and targets (K, 2)."""
        robots = _nearest(robots, len(self._robots["status"]) - 1)
        there = slice(1, 1 + len(robots))
        self._robots["status"][1:] = REMOVED
        self._robots["status"][there] = WORKING
        self._robots["position"][there, :2] = robots[:, :2]
        self._robots["speed"][there] = np.hypot(robots[:, 2], robots[:, 3])
        self._robots["heading"][there] = np.arctan2(robots[:, 3], robots[:, 2])
        targets = _nearest(targets, len(self._targets["in_sight"]))
        self._targets["position"][: len(targets)] = targets
        self._targets["in_sight"][:] = np.arange(len(self._targets["in_sight"])) < len(targets)
        self._targets_in_sight[0] = len(targets)

    def fill(
        self, pose: Odometry, heard: Sequence[Message | None], works: bool, phase: tuple[float, float] | None
    ) -> np.ndarray:
        """Fill the row, and return it: the same array each time.

        Args:
            pose: Measured pose and speed.
            heard: Latest message of each ring neighbour; None for none yet.
            works: False for a robot that has failed.
            phase: Cosine and sine of the measured phase; None lets the phase of the pose before follow the curve to
                this pose, unless it is the same object as the pose before.
        """
        robots, curve, alpha = self._robots, self._scenario.driven, self._scenario.alpha
        heading = pose.heading if abs(pose.heading) < 7 else math.remainder(pose.heading, math.tau)  # for float32
        robots["position"][0, :2], robots["heading"][0], robots["speed"][0] = (pose.x, pose.y), heading, pose.speed
        robots["status"][0] = WORKING if works else FAILED
        if phase is not None:
            robots["phase"][0], self._is_open = math.atan2(phase[1], phase[0]) % (2 * math.pi), False
        elif self.pose is None:
            self._is_open = alpha > 1  # until a message tells which of the phases of a place it is
            robots["phase"][0] = locate(curve, alpha, pose.x, pose.y, pose.heading, self._expected(heard))
        if phase is None and pose is not self.pose:
            self._follow()
        if self._is_open and any(heard):
            self._is_open, own, turn = False, robots["phase"][0], 2 * math.pi / alpha
            robots["phase"][0] = own + turn * round((self._expected(heard) - own) / turn)
        self._measure()
        if phase is not None:
            robots["measured_turn"][0, :2] = phase
        for side, message in enumerate(heard):
            self._hear(side, message, pose.stamp)
        # What is in sight is placed relative to the robot.
        robots["position"][0], robots["speed"][0], robots["sensor"][0] = 0, 0, 0 if works else NOWHERE
        self._observe()
        self.pose = pose
        return self.values

    def _expected(self, heard: Sequence[Message | None]) -> float:
        """Return the phase in a formation with the neighbours that were heard; without any, that at the start [rad]."""
        turns = (complex(*message[2:4]) / np.exp(1j * self._start[int(message.sender)]) for message in heard if message)
        return float(self._start[self._robot] + np.angle(sum(turns)))

    def _hear(self, side: int, message: Message | None, now: float) -> None:
        """Store the latest message of a ring neighbour, at the time of a pose: phases of two poses are compared."""
        if message is None:
            self._links["heard_at"][0, side], self._numbers[side] = -1, 0
            return
        age = max(now - message.sent_at, 0.0) / self._scenario.task.step
        self._links["heard_at"][0, side] = _NOW - round(min(age * _TICKS, _NOW))
        self._links["heard"][0, side], self._numbers[side] = message[2:6], message.numbers


def _nearest(detected: np.ndarray, count: int) -> np.ndarray:
    """Return the nearest of what the sensor detects, as many as the row lists at most, in their order."""
    return detected[np.sort(np.argsort(np.hypot(detected[:, 0], detected[:, 1]), kind="stable")[:count])]


def _check(scenario: Scenario) -> None:
    """Refuse a scenario whose rows or actions require a simulation."""
    names = [name for entry in scenario.extensions if isinstance(entry, ObservationEntry) for name in entry.entries]
    sensing, rule = scenario.sensing, "for a robot outside the simulation"
    require(not names, "scenario", f"must have no observation entries of extensions {rule}", names)
    require(not sensing.has_tracks, "sensing.tracks_seen and sensing.teammates_seen", f"must be 0 {rule}", "tracks")
    require(sensing.cells_seen is None, "sensing.cells_seen", f"must be None {rule}", sensing.cells_seen)
    require(scenario.task.action == "control", "task.action", f"must be control {rule}", scenario.task.action)
