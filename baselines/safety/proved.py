"""The proved filter."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.base import Policy
from baselines.policies.memory import clear_worlds
from baselines.safety.commitment import PLANS, Memory, Plans, commit
from baselines.safety.own_motion import Bounds
from baselines.safety.tails import POINTS
from baselines.similarity import motion_scale
from lissajous_env.device.curve import curve_struct
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.structs import to_struct
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number
from lissajous_env.world.state import allocate


@dataclass(frozen=True)
class ProvedParameters(Checked):
    margin: float = number(0.001, 0, 1e3, "m")
    """Distance that tails keep besides the two radii [m]."""
    deviations: float = number(4.0, 0, 100)
    """Bound of a measurement's noise, in standard deviations of the scenario's."""
    throttle_weight: float = number(0.1, 1e-6, 1e6)
    """Weight of a change of the throttle's action against one of the steering's."""

    def of(self, scenario: Scenario) -> "ProvedParameters":
        scale = motion_scale(scenario)
        return self.scaled(scale.length, scale.time)


_ROUNDING = 4e-6


class Proved(Policy):
    kind = "car"
    arrays = "warp"
    communicates = "committed tails, from every robot to every other"

    def __init__(self, policy: Policy, parameters: ProvedParameters | None = None):
        super().__init__(policy.scenario, policy.num_worlds, policy.device)
        if self.scenario.robot.kind != "car":
            raise ValueError(f"policy of a filter must drive robots of kind car, got {self.scenario.robot.kind}")
        self.policy = policy
        self.name = f"{policy.name}-proved"
        self.parameters = parameters or ProvedParameters().of(self.scenario)
        self._robot = to_struct(RobotStruct, self.scenario.robot)
        self._curve = curve_struct(self.scenario.curve, self.device)
        self._bounds = bounds_of(self.scenario, self.parameters)
        self._widest = wp.array(widest_of(self.scenario), dtype=wp.vec4, device=self.device)
        w, n = self.shape
        self._memory = allocate(Memory, {"steps": (w,), "holds": (w,)}, (w, n), self.device)
        shapes = {"points": (w, n, int(PLANS), int(POINTS)), "reach": (w, n, int(PLANS))}
        self._plans = allocate(Plans, shapes, (w, n), self.device)
        self._changes = wp.array(changes_of(self.parameters), dtype=wp.vec2, device=self.device)

    @property
    def holds(self):
        return self._memory.holds.numpy() == 1

    def filter(self, observation: wp.array, wanted: wp.array) -> wp.array:
        inputs = [self._bounds, self._robot, self._curve, self._widest, self._changes, observation, wanted, self._memory]
        outputs = [self._plans, self.action]
        self.launch(commit, self.num_worlds, inputs, outputs)
        return self.action

    def decide(self, observation: wp.array) -> None:
        self.filter(observation, self.policy.act(observation))

    def forget(self, mask: np.ndarray) -> None:
        self.policy.reset(mask)
        for name in self._memory._cls.vars:
            clear_worlds(getattr(self._memory, name), mask)


def bounds_of(scenario: Scenario, parameters: ProvedParameters) -> Any:
    bounds: Any = Bounds()
    curve, robot, noise, step = scenario.curve, scenario.robot, scenario.noise, scenario.task.step
    size = curve.half_width + curve.half_height
    bounds.step, bounds.left = step, math.exp(-robot.drag * step)
    bounds.touch = 2 * robot.radius + parameters.margin
    bounds.place = math.sqrt(2) * parameters.deviations * noise.position + _ROUNDING * size
    bounds.heading = parameters.deviations * noise.heading + _ROUNDING
    bounds.speed = parameters.deviations * noise.speed + _ROUNDING * robot.top_speed
    bounds.speed_unit = robot.top_speed
    room = 1.0 if scenario.task.boundary == "wall" else 3.9
    bounds.half_width, bounds.half_height = room * curve.half_width, room * curve.half_height
    bounds.loss = noise.message_loss
    bounds.fails = 0
    bounds.learns = int(noise.actuator == 0)
    return bounds


def widest_of(scenario: Scenario) -> np.ndarray:
    noise = scenario.noise
    wheel, drive = 3 * noise.wheelbase_spread, 3 * noise.drive_spread
    rows = [(1 / (1 + wheel), 1 / (1 - wheel), f * (1 - drive), f * (1 + drive)) for f in scenario.drive_factors]
    return np.array(rows, dtype=np.float32)


STEERING_CHANGES = (0.0, 0.06, 0.13, 0.22, 0.33, 0.47, 0.65, 0.9, 1.3, 2.0)
THROTTLE_CHANGES = (0.0, 0.5, 2.0)


def changes_of(parameters: ProvedParameters) -> np.ndarray:
    pairs = [(s * x, t * y) for x in STEERING_CHANGES for y in THROTTLE_CHANGES for s in (1, -1) for t in (-1, 1)]
    pairs = sorted(set(pairs), key=lambda pair: (pair[0] ** 2 + parameters.throttle_weight * min(abs(pair[1]), 1.0) ** 2, -pair[0], pair[1]))
    return np.array(pairs, dtype=np.float32)
