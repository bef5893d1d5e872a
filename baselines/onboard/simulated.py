"""A simulated robot for `Onboard`: its measurements, messages and detections, and a base that takes commands."""

import math
from typing import Any, NamedTuple

import numpy as np

from baselines.onboard.signals import Command, Message, Odometry, Twist
from lissajous_env.logs.commands import actions_of_commands
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import whole_number
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import REMOVED, WORKING


class Inputs(NamedTuple):
    """Arguments of `Onboard.act`, in their order."""

    now: float
    odometry: Odometry
    heard: tuple[Message, ...]
    robots: np.ndarray
    targets: np.ndarray
    phase: tuple[float, float]
    works: bool


def inputs_of(simulation: Simulation, robot: int) -> Inputs:
    """Return the present measurements, messages and detections of a robot in world 0, with times since the reset.

    `Onboard.act(*inputs_of(simulation, robot))` computes the policy's action in the simulation.

    Raises:
        ValueError: there is no such robot, or it has been removed.
    """
    n, scenario, state = simulation.num_robots, simulation.scenario, simulation.robots
    whole_number("robot", robot, 0, n - 1)
    status = state.status.numpy()[0]
    if status[robot] == REMOVED:
        raise ValueError(f"robot must not have been removed, got {robot}")
    faces, speeds = state.heading.numpy()[0], state.speed.numpy()[0]
    moves = np.column_stack([state.position.numpy()[0, :, :2], speeds * np.cos(faces), speeds * np.sin(faces)])
    others = moves - moves[robot]
    cos_phase, sin_phase = state.measured_turn.numpy()[0, robot, :2].tolist()
    x, y, heading, speed = state.measured.numpy()[0, robot].tolist()
    now = int(simulation.clock.step.numpy()[0]) * scenario.task.step
    near = scenario.sight * (1 + 1e-5)  # because of rounding; the row leaves out what is just outside
    there = (np.arange(n) != robot) & (status != REMOVED) & (np.hypot(*others[:, :2].T) < near)
    sighted = simulation.targets.in_sight.numpy()[0] == 1
    targets = simulation.targets.position.numpy()[0][sighted] - state.sensor.numpy()[0, robot]
    targets = targets[np.hypot(*targets.T) < near]
    return Inputs(
        now,
        Odometry(x, y, heading, speed, now),
        _heard(simulation, robot),
        others[there],
        targets,
        (cos_phase, sin_phase),
        bool(status[robot] == WORKING),
    )


def _heard(simulation: Simulation, robot: int) -> tuple[Message, ...]:
    """Return the latest message of each ring neighbour that the robot has heard."""
    links, step, senders = simulation.links, simulation.scenario.task.step, simulation.scenario.neighbours[robot]
    arrays = links.heard, links.heard_at, simulation.messages.heard
    heard, heard_at, numbers = (array.numpy()[0, robot].tolist() for array in arrays)
    return tuple(
        Message(sender, heard_at[side] * step, *heard[side], numbers=tuple(numbers[side]))
        for side, sender in enumerate(senders.tolist())
        if sender >= 0 and heard_at[side] >= 0
    )


class Vehicle:
    """The base of a simulated robot: it takes commands in physical units, and stops without them.

    It stores the latest command that it has received; all times are of the same clock [s].

    Args:
        scenario: The scenario.
        watchdog: Time after which a command is no longer valid [s].
    """

    def __init__(self, scenario: Scenario, watchdog: float):
        self._robot, self._watchdog, self._steering = scenario.resolve().robot, watchdog, 0.0
        self._rest = np.zeros(scenario.action_size, dtype=np.float32)
        self._rest[:2] = scenario.model.rest_action(self._robot)
        self.take(-math.inf, Command(0.0, 0.0))  # compiles and loads the kernel

    def take(self, now: float, command: Command | Twist) -> None:
        """Store a command that arrived now; one that is not finite is ignored."""
        if all(map(math.isfinite, command)):
            self._taken_at, self._action = now, self._rest.copy()
            self._action[:2] = actions_of_commands(self._robot, np.array(command, dtype=np.float32))

    def receive(self, now: float, topic: str, message: Any) -> None:
        """Store the command in a message that arrived now; of two topics, when that of the throttle arrives."""
        if topic == "cmd_vel":
            twist = getattr(message, "twist", message)
            self.take(now, Twist(twist.linear.x, twist.angular.z))
        elif topic == "command":
            parts = dict(zip(message.name, message.position, strict=False))
            if {"steering", "throttle"} <= parts.keys():
                self.take(now, Command(parts["steering"], parts["throttle"]))
        elif topic == "steering":
            self._steering = message.data * self._robot.steering_max
        else:
            self.take(now, Command(self._steering, message.data))

    def action(self, now: float) -> np.ndarray:
        """Return the action (A,) in force now; without a valid command that of rest."""
        return self._action if now - self._taken_at <= self._watchdog else self._rest
