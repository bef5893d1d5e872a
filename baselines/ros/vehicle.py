"""The base of a simulated robot: it receives commands from the network, and stops without them."""

import math
from typing import Any

import numpy as np

from baselines.onboard import Command, Twist
from lissajous_env.logs.inputs import actions_of
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.parts import Robot


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
    """The latest command that a simulated robot has received; all times are of the same clock [s].

    Args:
        scenario: The scenario.
        watchdog: Time after which a command is no longer valid [s].
    """

    def __init__(self, scenario: Scenario, watchdog: float):
        self._robot, self._step, self._watchdog = scenario.resolve().robot, scenario.task.step, watchdog
        self._size = scenario.action_size
        self._taken_at, self._command = -math.inf, None
        self._steering = 0.0
        self.action(0.0, 0.0)  # compiles and loads the kernel by which commands are converted

    def take(self, now: float, command: Any) -> None:
        """Store a command that arrived now; one that is not finite is ignored."""
        if command is not None and all(map(math.isfinite, command)):
            self._taken_at, self._command = now, command

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

    def action(self, now: float, speed: float) -> np.ndarray:
        """Return the action (A,) in force now, of a robot of a speed [m/s]; without a valid command that of rest."""
        given = self._command if now - self._taken_at <= self._watchdog else None
        action = np.zeros(self._size, dtype=np.float32)
        if isinstance(given, Twist) and self._robot.kind == "car":
            drives = given.speed > 0 or (given.speed < 0 and self._robot.reverses)
            given = of_twist(self._robot, self._step, speed, given) if drives else None
        if given is None:
            action[:2] = model_of(self._robot.kind).rest_action(self._robot)
        else:
            action[:2] = actions_of(self._robot, np.array(given, dtype=np.float32))
        return action
