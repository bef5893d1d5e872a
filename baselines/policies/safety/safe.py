"""The filter `-safe`, which changes the actions of any policy of cars by the smallest amount that separates the cars.

This is Section IV-A (i) of the paper, "implement a lower level controller for collision avoidance", and it has the cost
that the paper names, "deviating from the Lissajous path or from the desired velocity": a car that swerves leaves the
curve by decimetres, and targets between two cars are detected later. Its parameters are `SafetyParameters`.

The car has no brakes: from 1.1 m/s it coasts 1.2 m, so it must steer, and in time. The filter therefore evaluates an
action u by the ways out that remain after it. The car applies u for one step and then, as its way out, one of nine
manoeuvres b (full right, straight on, full left; each coasting, at its speed, or at full throttle). Another car k goes
straight on. It is a car in sight, whose position and velocity are observed, or, where the radius of sight is too short
for the speed of the formation (`speed_in_sight`), a ring neighbour beyond it, whose messages contain its position and,
by their difference, its velocity (`steps_of_velocity`). Without robots in observations (`sensing.robots_seen` = 0) this
radius is 0. With d_k(t) their distance and D = 2 r + clearance,

    m_k(u; b) = min over t in [0, horizon) of d_k(t) - D - growth t        [m]
    V(u)      = max_b min_k m_k(u; b)

V is a control barrier function of the sampled car, by backup manoeuvres: while V >= 0 there is a way out. Where V of
the wanted action w, clipped to the limits below, is not below 0, it passes, bit for bit. Elsewhere

    minimise   (u_0 - w_0)^2 + throttle_weight (u_1 - w_1)^2
    subject to m_k(v; b) + dm_k/du(v; b) (u - v) >= 0 for every k,  u_0 in [-1, 1],  u_1 in [-1, top]

is solved exactly for the steering u_0 and the throttle u_1, with the b of `agreed_way_out`, by active sets, for v = w
and up to `passes` times, v being the last solution; if the rows contradict each other, all are relaxed by the same
smallest amount. `top` is the throttle that leads to `speed_max`.

By default `speed_max` is above the formation's speed (`HEADROOM`): otherwise a car that gave way could not catch up,
and the worst-case undetected time would be several times as long. A car gives way late and little, which preserves that
time best; cars whose motor hardly lets them catch up lose it all the same.

Two cars that avoid each other must not choose the same side, so both compute the same best pair of ways out. A
symmetric pair passes on the right.

Limits: the filter accounts for `sensing.robots_seen` robots, at most 8, and, beyond the radius of sight, only for ring
neighbours, as long as no message is lost; where they are late, their senders are assumed to have driven straight on.
Other cars that approach at 2 m/s in `intruders` are sensed too late. A car that stops abruptly less than about 0.45 m
ahead cannot be avoided. There are only nine ways out, so a car between two others may have none. Of three cars, two may
agree on ways out that do not suit the third.

A differential drive gains its yaw rate steadily. It is not observed, so the filter predicts it from step to step.
"""

import dataclasses
import math
from typing import Any

import warp as wp

from baselines.policies.base import Filter
from baselines.policies.safety.avoidance import (
    MANOEUVRES,
    NEAREST,
    Constants,
    SafetyParameters,
    SafetyStruct,
    keep_clear,
)
from lissajous_env.device.curve import curve_struct
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory.geometry import top_speed, turning_radius

HEADROOM = 1.5
"""Lower bound of the default of `speed_max` as a multiple of the formation's speed: a car that fell behind has to catch
up, or the formation, and with it the bound on the detection time, is lost."""

_VELOCITY_ERROR = 0.03
"""Standard deviation of velocities from noisy positions that is accepted, as a share of the top speed."""
_LOSSY_STEPS, _MOST_STEPS = 3, 6
"""Number of control steps between such positions: the least if messages are lost, and the most, as cars turn."""


class Safe(Filter):
    """The collision filter, which stores the positions of ring neighbours; its parameters are `SafetyParameters`."""

    defaults = SafetyParameters()
    suffix = "-safe"
    about = "with a collision filter that intervenes late and gently"
    as_car = True
    communicates = "positions of ring neighbours"
    remembers = ("_memory", "_yaw_rate")

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", parameters: Any = None):
        super().__init__(scenario, num_worlds, device, parameters)
        scenario, constants = self.scenario, Constants()
        formation_speed = top_speed(scenario.driven, scenario.formation.phase_rate)
        sight_speed = speed_in_sight(scenario, self.parameters)
        if self.parameters.speed_max is None:
            limit = min(max(sight_speed, HEADROOM * formation_speed), scenario.robot.top_speed)
            self.parameters = dataclasses.replace(self.parameters, speed_max=float(limit))
        constants.safety = to_struct(SafetyStruct, self.parameters)
        constants.robot = to_struct(RobotStruct, scenario.robot)
        constants.robots_seen, constants.sight = scenario.sensing.robots_seen, sight_of_cars(scenario)
        constants.step, constants.age_unit = scenario.task.step, scenario.time_unit
        constants.delay = scenario.delay_steps * scenario.task.step
        constants.listens = int(sight_speed < formation_speed)
        self._constants = constants
        self._curve = curve_struct(self.scenario.curve, self.device)
        self._memory = wp.zeros((*self.shape, 2, steps_of_velocity(scenario)), dtype=wp.vec3, device=self.device)
        self._yaw_rate = wp.zeros(self.shape, dtype=wp.float32, device=self.device)
        others, places = (*self.shape, int(NEAREST)), (2 * int(MANOEUVRES), self.parameters.horizon + 1)
        self._others = wp.zeros(others, dtype=wp.vec4, device=self.device)
        self._paths = wp.zeros((*self.shape, *places), dtype=wp.vec2, device=self.device)
        self._rows = wp.zeros(others, dtype=wp.vec3, device=self.device)

    def __call__(self, observation: wp.array, wanted: wp.array, out: wp.array | None = None) -> wp.array:
        """Return the actions for wanted ones, from observations."""
        out = self.action if out is None else out
        memory = [self._memory, self._yaw_rate]
        inputs = [self._constants, self._curve, *memory, observation, wanted, self._others, self._paths, self._rows]
        self.launch(keep_clear, self.shape, inputs, [out])
        return out


def steps_of_velocity(scenario: Scenario) -> int:
    """Return the number of control steps between the two positions in messages from which a velocity follows.

    It is 1, and more where positions are noisy or messages are lost.
    """
    error = math.sqrt(2) * scenario.noise.position / scenario.task.step
    least = _LOSSY_STEPS if scenario.noise.message_loss > 0 else 1
    return min(max(math.ceil(error / (_VELOCITY_ERROR * scenario.robot.top_speed)), least), _MOST_STEPS)


def sight_of_cars(scenario: Scenario) -> float:
    """Return the distance within which cars observe others [m]; 0 if their rows have no robots in sight."""
    return scenario.sight if scenario.sensing.robots_seen > 0 else 0.0


def speed_in_sight(scenario: Scenario, parameters: SafetyParameters) -> float:
    """Return the speed up to which two cars that drive towards each other can still pass once they are in sight [m/s].

    On its tightest circle, of radius R = l / tan(delta_max), a car moves aside by half of D = 2 r + clearance within s
    = sqrt(R^2 - (R - D / 2)^2), whatever its speed. A step may pass before either senses the other, so, with the
    radius of sight S, S - 2 s = 2 v step.
    """
    robot = scenario.robot
    tightest = turning_radius(robot.wheelbase, robot.steering_max)
    aside = min(robot.radius + 0.5 * parameters.clearance, tightest)
    reach = math.sqrt(tightest**2 - (tightest - aside) ** 2)
    return (sight_of_cars(scenario) - 2 * reach) / (2 * scenario.task.step)
