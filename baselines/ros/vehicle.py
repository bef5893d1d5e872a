"""The base of a simulated robot: it receives commands from the network, and stops without them."""

import math
from collections import deque
from typing import Any

import numpy as np

from baselines.onboard import Command, Twist
from lissajous_env.logs.car_input import actions_of
from lissajous_env.logs.drive_input import actions_of_twists
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.robot import Robot


def of_twist(robot: Robot, step: float, speed: float, twist: Twist) -> Command:
    """Return the command by which a car of `speed` reaches the speed of a twist by the end of a step, and its yaw rate.

    The motor of (12), v' = push - drag v, is integrated by the classical Runge-Kutta method, as in the simulation. A
    yaw rate at rest has no effect: a car cannot turn on the spot.
    """
    decay = robot.drag * step
    kept = 1 - decay + decay**2 / 2 - decay**3 / 6 + decay**4 / 24
    gain = step * (1 - decay / 2 + decay**2 / 6 - decay**3 / 24)
    push = (twist.speed - kept * speed) / gain
    steering = math.atan(robot.wheelbase * twist.yaw_rate / twist.speed) if twist.speed else 0.0
    offset = math.copysign(robot.offset, push) if robot.reverses else robot.offset
    return Command(steering, (push + offset) / robot.drive)


class Vehicle:
    """Commands that a simulated robot has received; all times are of the same clock [s].

    Args:
        scenario: The scenario.
        watchdog: Time after which a command is no longer valid [s].
    """

    def __init__(self, scenario: Scenario, watchdog: float):
        self._robot, self._step, self._watchdog = scenario.resolve().robot, scenario.task.step, watchdog
        self._size = scenario.action_size
        self._commands: deque[tuple[float, Any]] = deque(maxlen=1000)
        self._parts: dict[str, float] = {}

    def warm_up(self) -> None:
        """Compile and load the kernel by which commands are converted."""
        if self._robot.kind == "car":
            actions_of(self._robot, np.zeros(2, dtype=np.float32))

    def take(self, now: float, command: Any) -> None:
        """Store a command that arrived now; one that is not finite is ignored."""
        if command is not None and all(map(math.isfinite, command)):
            self._commands.append((now, command))

    def receive(self, now: float, topic: str, message: Any) -> None:
        """Store the command in a message that arrived now; of two topics, when that of the throttle arrives."""
        if topic == "cmd_vel":
            twist = getattr(message, "twist", message)
            self.take(now, Twist(twist.linear.x, twist.angular.z))
            return
        if topic == "command":
            parts = dict(zip(message.name, message.position, strict=False))
        else:
            self._parts[topic] = message.data * (self._robot.steering_max if topic == "steering" else 1.0)
            parts = self._parts if topic == "throttle" else {}
        if {"steering", "throttle"} <= parts.keys():
            self.take(now, Command(parts["steering"], parts["throttle"]))

    def action(self, time: float, speed: float) -> np.ndarray:
        """Return the action (A,) in force at a time, of a robot of a speed [m/s]; without a command that of rest."""
        while len(self._commands) > 1 and self._commands[1][0] <= time:
            self._commands.popleft()
        given = None
        if self._commands and self._commands[0][0] <= time <= self._commands[0][0] + self._watchdog:
            given = self._commands[0][1]
        action = np.zeros(self._size, dtype=np.float32)
        if self._robot.kind == "differential":
            action[:2] = actions_of_twists(self._robot, np.array(given or Twist(0.0, 0.0)))
            return action
        if isinstance(given, Twist):
            drives = given.speed > 0 or (given.speed < 0 and self._robot.reverses)
            given = of_twist(self._robot, self._step, speed, given) if drives else None
        if given is None:
            action[:2] = model_of(self._robot.kind).rest_action(self._robot)
            return action
        inputs = np.array(given, dtype=np.float32)
        action[:2] = actions_of(self._robot, inputs)
        return action
