"""The proved filter after any policy of cars: each robot can always come to rest without colliding with the others.

* The **tail** of a car is its path to rest with the motor off and constant steering (`tails.py`).
* Two tails are **compatible** if the cars stay 2 r + margin apart for ever, for all errors within their bounds, and
  also if a car that can stop dead stops anywhere on its tail.
* In every step each robot in its turn applies the wanted action only if the tail after it is compatible with the
  committed tails of all others. Otherwise it applies the smallest change of the action for which this is so, and
  without one it continues its old tail.

docs/proved.md has the theorem, that then no robots collide, its six conditions with the functions that enforce them,
the proof, and the messages that it requires. `unmet_conditions` names those of the conditions 1, 2, 3 and 5 that a
scenario violates. In such scenarios the filter acts in the same way, without a guarantee.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.base import Filter
from baselines.policies.inside import Inside
from baselines.policies.memory import clear_worlds
from baselines.policies.safety.commitment import COURSES, Memory, commit
from baselines.policies.safety.own_motion import Terms
from baselines.policies.safety.tails import POINTS
from baselines.similarity import motion_scale
from lissajous_env.device.curve import curve_struct
from lissajous_env.device.structs import NoiseStruct, RobotStruct, allocate, to_struct
from lissajous_env.device.warp_abi import fields_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number, whole
from lissajous_env.theory.geometry import turning_radius
from lissajous_env.world.robots.inside import Walls, walls_of

_STEERING_CHANGES = (0.0, 0.06, 0.13, 0.22, 0.33, 0.47, 0.65, 0.9, 1.3, 2.0)
_THROTTLE_CHANGES = (0.0, 0.5, 2.0)
_THROTTLE_WEIGHT = 0.1
"""Weight of a change of the throttle's action relative to one of the steering's, in the order of the changes."""
_CHANGES = sorted(
    {(s * x, t * y) for x in _STEERING_CHANGES for y in _THROTTLE_CHANGES for s in (1, -1) for t in (1, -1)},
    key=lambda change: (change[0] ** 2 + _THROTTLE_WEIGHT * min(abs(change[1]), 1.0) ** 2, -change[0], change[1]),
)
"""Changes of the wanted steering and throttle that are tried, the smallest first; the first is none. Each result is
clipped to [-1, 1]."""
_ROUNDING = 4e-6
"""Bound on the rounding error of observed numbers, relative to their range."""
_COARSEST = 0.01
"""Largest relative error of the integration for which the bounds of the errors are valid."""
_MIXED = 5e-4
"""Relative error of the integration above which turning and slowing down at the same time matters."""
_IN_RANGE = 3.9
"""Largest coordinate of a tail [half widths], and speed of a car [top speeds], for which observations are exact."""
_FLOAT = 2.0**-24
"""Relative error of a rounded float32."""


@dataclass(frozen=True)
class ProvedParameters(Checked):
    """Parameters of the proved filter; `ProvedParameters.of` scales the defaults to another scenario."""

    margin: float = number(0.001, 0, 1e3, "m")
    """Least distance of tails besides the two radii and the error bounds [m]."""
    deviations: float = number(4.0, 0, 100)
    """Bound of the noise of a measurement, in standard deviations."""
    repeats: int = whole(3, 1, 100)
    """Number of times that a robot sends each of its tails in a step, in case a message is lost."""

    def of(self, scenario: Scenario) -> "ProvedParameters":
        """Return the same parameters scaled from the paper's experiment to another scenario."""
        scale = motion_scale(scenario)
        return self.scaled(scale.length, scale.time)


class Proved(Filter):
    """The proved filter of cars; its parameters are `ProvedParameters`.

    Raises:
        ValueError: the robots are no cars, or cars that reverse.
    """

    defaults = ProvedParameters()
    suffix = "-proved"
    about = "with a filter that is proved, under conditions, to prevent collisions"
    wall_rule = False
    communicates = "committed tails, from every robot to every other within the step"

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", parameters: Any = None):
        super().__init__(scenario, num_worlds, device, parameters)
        if self.scenario.robot.reverses:
            rule = f"must be 0 for cars behind {self.suffix}, whose tails end at rest [m/s]"
            raise ValueError(f"robot.speed_min {rule}, got {self.scenario.robot.lowest_speed:g}")
        self._terms = terms_of(self.scenario, self.parameters, self.device)
        self._curve = curve_struct(self.scenario.curve, self.device)
        worlds = (self.num_worlds,)
        shapes = {"steps": worlds, "compatible": worlds, "courses": (*self.shape, int(COURSES), int(POINTS))}
        self._memory = allocate(Memory, shapes, self.shape, self.device)

    @property
    def tails_compatible(self) -> np.ndarray:
        """Return for each world (W,) whether its committed tails were compatible at the beginning of the latest step.

        By the theorem they then remain so; if they do not, a condition is violated.
        """
        return self._memory.compatible.numpy() == 1

    def forget(self, mask: np.ndarray) -> None:
        """Forget tails, and the bounds that robots have narrowed; the large array of courses is overwritten anyway."""
        for name, array in fields_of(self._memory).items():
            if name != "courses":
                clear_worlds(array, mask)

    def __call__(self, observation: wp.array, wanted: wp.array, out: wp.array | None = None) -> wp.array:
        """Return the actions for wanted ones; a robot whose wanted action is not finite continues its old tail."""
        out = self.action if out is None else out
        self.launch(commit, self.num_worlds, [self._terms, self._curve, observation, wanted, self._memory], [out])
        return out


def terms_of(scenario: Scenario, parameters: ProvedParameters, device: Any = "cpu") -> Any:
    """Return the terms of the theorem for a scenario (conditions 1 to 3 and 5)."""
    curve, robot, noise, task = scenario.curve, scenario.robot, scenario.noise, scenario.task
    terms: Any = Terms()
    terms.step, terms.decay = task.step, math.exp(-robot.drag * task.step)
    terms.required = 2 * robot.radius + parameters.margin
    rounding = _ROUNDING * (curve.half_width + curve.half_height)  # of rows; a slow car that float32 stops adds more
    rounding = max(rounding, min(rounding_error(scenario), rounding + 0.5 * parameters.margin))
    terms.position_error = math.sqrt(2) * parameters.deviations * noise.position + rounding
    terms.heading_error = parameters.deviations * noise.heading + _ROUNDING
    decay_error = (robot.drag * task.step / task.substeps) ** 4 / 120
    error = max((_ROUNDING + decay_error) * robot.top_speed, 2 * decay_error * largest_speed_change(scenario))
    terms.speed_error = parameters.deviations * noise.speed + error
    room = _IN_RANGE if task.boundary == "open" else 1.0
    body = {"open": 0.0, "wall": robot.radius, "remove": -math.sqrt(0.5) * robot.radius}[task.boundary]
    terms.half_width, terms.half_height = room * curve.half_width - body, room * curve.half_height - body
    terms.message_loss = noise.message_loss**parameters.repeats
    terms.chord = (task.step / task.substeps) ** 2 / 8
    terms.coarseness = integration_error(scenario)
    terms.coasts = int(scenario.faults.stop == "coast" and any(may_fail(scenario)))
    if terms.coasts:
        terms.num_tails = 1  # a robot that coasts continues with the steering of its action
    elif noise.actuator > 0:
        terms.num_tails = 4  # a straight tail is the narrowest, because it does not depend on the wheelbase
    else:  # tails that turn cross a smaller area, and end farther from the wall ahead
        terms.num_tails = 3 if any(stops_of(scenario)) or task.boundary != "open" else 1
    terms.robot, terms.noise = to_struct(RobotStruct, robot), to_struct(NoiseStruct, noise)
    terms.walls = walls_of(scenario) if Inside.suits(scenario) else Walls()
    terms.widest = wp.array(widest_of(scenario), dtype=wp.vec4, device=device)
    terms.changes = wp.array(_CHANGES, dtype=wp.vec2, device=device)
    terms.stops = wp.array(stops_of(scenario), dtype=wp.int32, device=device)
    return terms


def may_fail(scenario: Scenario) -> np.ndarray:
    """Return for each robot (N,) whether it can fail: at random, or by the schedule, whose times are not used."""
    scheduled = {robot for robot, *_ in scenario.faults.schedule}
    return np.array([scenario.faults.rate > 0 or i in scheduled for i in range(scenario.num_robots)])


def stops_of(scenario: Scenario) -> np.ndarray:
    """Return for each robot (N,) whether it can stop dead, as 0 or 1."""
    return (may_fail(scenario) & (scenario.faults.stop == "dead")).astype(np.int32)


def widest_of(scenario: Scenario) -> np.ndarray:
    """Return the bounds (N, 4) of each car's curvature and drive over the nominal ones: least, most; least, most."""
    (shortest, longest), (weakest, strongest) = scenario.noise.wheelbase_range, scenario.noise.drive_range
    turning = (1 / longest - _ROUNDING, 1 / shortest + _ROUNDING)
    rows = [(*turning, f * (weakest - _ROUNDING), f * (strongest + _ROUNDING)) for f in scenario.drive_factors]
    return np.array(rows, dtype=np.float32)


def fastest_of(scenario: Scenario) -> float:
    """Return the largest speed that a car can reach under the filter [m/s], at least a thousandth of the top speed."""
    return max(scenario.top_speed_bound, 1e-3 * scenario.robot.top_speed)


def largest_speed_change(scenario: Scenario) -> float:
    """Return a bound of the change of a car's speed until it is steady [m/s].

    The weakest motor brakes just above the dead zone where its drive is less than the offset.
    """
    robot, noise = scenario.robot, scenario.noise
    weakest = robot.drive * noise.drive_range[0] * float(scenario.drive_factors.min())
    return fastest_of(scenario) + max(robot.offset - weakest * robot.dead_zone, 0.0) / robot.drag


def rounding_error(scenario: Scenario) -> float:
    """Return a bound of the distance by which float32 moves a simulated car off its path until it is at rest [m].

    A car stands still once its way in an integration step h is below the rounding error of its place, at a distance of
    1 / (c h) times this error from the end of its path.
    """
    task, curve = scenario.task, scenario.curve
    farthest = _IN_RANGE * math.hypot(curve.half_width, curve.half_height)
    return _FLOAT * farthest * task.substeps / (scenario.robot.drag * task.step)


def integration_error(scenario: Scenario) -> float:
    """Return a bound of the relative error of the simulated path, compared with the exact one, at the highest speed.

    The Runge-Kutta method is Simpson's rule for x' = v cos(heading): turn^4 / 2880 of the path, and (c h)^4 / 120. If
    the speed changes by a share s in an integration step while the car turns, their products matter as well:
    (turn / 7.33 + s / 3)^4 bounds the sum. Up to 5e-4, this exceeds the two terms by less than the margin covers.
    """
    robot, noise = scenario.robot, scenario.noise
    h = scenario.task.step / scenario.task.substeps
    shortest = robot.wheelbase * noise.wheelbase_range[0]
    turn = fastest_of(scenario) * h / turning_radius(shortest, robot.steering_max)
    change = robot.drag * h * largest_speed_change(scenario) / fastest_of(scenario)
    mixed = (turn / 7.33 + change / 3) ** 4
    return mixed if mixed > _MIXED else turn**4 / 2880 + (robot.drag * h) ** 4 / 120


def unmet_conditions(scenario: Scenario) -> tuple[str, ...]:
    """Return the conditions of the theorem that a scenario violates, each as a sentence; none where it applies.

    Condition 6, on the start of an episode, is `Proved.tails_compatible`.
    """
    scenario = scenario.resolve()
    robot, noise, task = scenario.robot, scenario.noise, scenario.task
    coarse, rounded = integration_error(scenario), rounding_error(scenario)
    margin = ProvedParameters().of(scenario).margin
    most = _ROUNDING * (scenario.curve.half_width + scenario.curve.half_height) + margin / 2
    off = f"must be at most dead_zone, {robot.dead_zone:g}, for the motor to be off"
    short = f"must be short enough for a relative error of {_COARSEST:g} at top speed [s]"
    long = f"must be long enough for a rounding error of {most:.2g} m with {task.substeps} sub-steps [s]"
    normal, fastest = "must be 0, since normal noise has no bound", scenario.top_speed_bound
    seen = f"must be at least 1 / {_IN_RANGE:g} of the speed of the strongest car, {fastest:.3g} m/s"
    shows = "must be count or remove, since the row of a robot that a collision stops still shows its speed"
    prompt = f"must be below half a step of {task.step:g} s"
    rules = (
        (scenario.actuation == "car", "1: kind of the robots", "must be car", scenario.actuation),
        (not robot.reverses, "1: robot.speed_min", "must be 0, since tails end at rest", f"{robot.lowest_speed:g}"),
        (robot.throttle_min <= robot.dead_zone, "1: robot.throttle_min", off, f"{robot.throttle_min:g}"),
        (noise.actuator == 0, "1: noise.actuator", "must be 0", f"{noise.actuator:g}"),
        (coarse <= _COARSEST, "1: task.step", short, f"{task.step:g} with {coarse:.2g}"),
        (rounded <= most, "1: task.step", long, f"{task.step:g} with {rounded:.2g}"),
        (noise.position == 0, "2: noise.position", normal, f"{noise.position:g}"),
        (noise.heading == 0, "2: noise.heading", normal, f"{noise.heading:g}"),
        (noise.speed == 0, "2: noise.speed", normal, f"{noise.speed:g}"),
        (fastest <= _IN_RANGE * robot.top_speed, "2: robot.speed_max", seen, f"{robot.top_speed:.3g}"),
        (scenario.delay_steps == 0, "3: noise.message_delay", prompt, f"{noise.message_delay:g}"),
        (task.on_collision != "stop", "5: task.on_collision", shows, task.on_collision),
    )
    return tuple(f"{field} {rule}, got {value}" for holds, field, rule, value in rules if not holds)
