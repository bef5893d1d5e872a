"""The base of a simulated robot: it takes commands in physical units, and stops without them."""

import math
from typing import Any

import numpy as np

from baselines.onboard import Command, Twist
from lissajous_env.logs.inputs import actions_of
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario


class Vehicle:
    """The latest command that a simulated robot has received; all times are of the same clock [s].

    Args:
        scenario: The scenario.
        watchdog: Time after which a command is no longer valid [s].
    """

    def __init__(self, scenario: Scenario, watchdog: float):
        self._robot, self._size, self._watchdog = scenario.resolve().robot, scenario.action_size, watchdog
        self._taken_at, self._command = -math.inf, Command(0.0, 0.0)
        self._steering = 0.0
        actions_of(self._robot, np.zeros(2, dtype=np.float32))  # compiles and loads the kernel

    def take(self, now: float, command: Command | Twist) -> None:
        """Store a command that arrived now; one that is not finite is ignored."""
        if all(map(math.isfinite, command)):
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

    def action(self, now: float) -> np.ndarray:
        """Return the action (A,) in force now; without a valid command that of rest."""
        action = np.zeros(self._size, dtype=np.float32)
        if now - self._taken_at <= self._watchdog:
            action[:2] = actions_of(self._robot, np.array(self._command, dtype=np.float32))
        else:
            action[:2] = model_of(self._robot.kind).rest_action(self._robot)
        return action
