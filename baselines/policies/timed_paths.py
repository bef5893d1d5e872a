"""Cars that follow timed paths: the shared base of policies that plan the motion of the team beforehand.

A car is a flat system: its place as a function of time determines its heading, speed, steering and throttle. The tables
(`baselines.policies.path_tables`) contain these; the kernel adds a feedback of the errors along and across the path, so
that uneven cars, noise, and a stop are made up for.

The reference of a robot is the sample of its table at the present time. Its *progress* is the sample nearest to it,
searched around the one before. With the curvature k and speed u of the path at the progress, the distance y to the
left of the path, the angle e between heading and path, the distance s that the robot is behind its reference along the
path, h the control step and d = v h,

    curvature = k - (1 - p)(3 + p) / 2d (e + atan((1 - p) 2 y / ((3 + p) d)))
    acceleration = u' + (1 - p)(3 + p) / 2h (u - v + limit((1 - p) 2 s / ((3 + p) h)))
    steering = atan(l curvature / a),  throttle = (acceleration + c v + beta - b) / alpha

These are the gains that place both poles of a double integrator with a held input at p = exp(-h / settling), per
control step. A car that is far from its path drives straight towards it, and one that is late drives a share faster
than the path, or slower where it is early (`catch_up`); neither vanishes. a and b are what the robot has learned of its
own car: the ratio of the curvature that it drives to the one it commands, and the acceleration of its motor beyond the
model's.

On flatness: M. Fliess, J. Levine, P. Martin, P. Rouchon, "Flatness and defect of non-linear systems: introductory
theory and examples", International Journal of Control 61 (1995).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.base import Policy
from baselines.policies.driving import steady_speed
from baselines.policies.own_row import own_heading, own_position, own_speed, own_works
from baselines.policies.path_tables import FINE, PathTables
from baselines.similarity import manoeuvring_length, motion_scale
from lissajous_env.device.car_input import car_action
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct, curve_struct, wrap
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.structs import to_struct
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, flag, number

wp.set_module_options(OPTIONS)

_FINE = wp.constant(FINE)
# Entries of a robot's memory.
STEPS, PROGRESS, PLAN, PUSH_BIAS, TURN_RATIO = (wp.constant(k) for k in range(5))
NEXT_SPEED, NEXT_HEADING, NEXT_TURN = (wp.constant(k) for k in range(5, 8))
MEMORY = 8


@dataclass(frozen=True)
class TrackingParameters(Checked):
    """Parameters of the following of timed paths, besides the scenario; None is derived from it."""

    settling: float | None = number(None, 1e-6, 1e6, "s")
    """Time constant of an error [s]; None is 0.12 s in the time scale of the paper's experiment, and at least 0.8
    control steps, and for differential drives the time 1 / sqrt(yaw acceleration): they weave if it is shorter."""
    approach: float = number(1.5, 0.05, 1.57, "rad")
    """Largest angle at which a car approaches its path [rad]."""
    catch_up: float = number(0.5, 0.01, 10)
    """Largest share of the path's speed by which a car that is late drives faster, or one that is early slower."""
    learning: float = number(0.1, 0, 1)
    """Share of its prediction error by which a car corrects its model of itself in each control step."""
    waits: bool = flag(False)
    """True if a car that has stopped beside its loop waits until its reference passes, instead of following it."""


@wp.struct
class Tracking:
    """Constants of the following: `step` h and `settling` [s], `room` [m], counts of control steps, parameters."""

    step: float
    pole: float
    approach: float
    catch_up: float
    learning: float
    room: float
    lead_in: int
    loop: int
    waits: int


def tracking_of(scenario: Scenario, tables: PathTables, parameters: TrackingParameters) -> Any:
    """Return the constants of the following of timed paths in a scenario."""
    step, tracking = scenario.task.step, Tracking()
    least = max(0.8 * step, (scenario.robot.yaw_acceleration_max or math.inf) ** -0.5)
    settling = parameters.settling or max(0.12 * motion_scale(scenario).time, least)
    tracking.step, tracking.pole = step, math.exp(-step / settling)
    tracking.approach, tracking.catch_up = parameters.approach, parameters.catch_up
    tracking.learning, tracking.room = parameters.learning, manoeuvring_length(scenario.robot)
    tracking.lead_in, tracking.loop, tracking.waits = tables.lead_in, tables.loop, int(parameters.waits)
    return tracking


@wp.func
def on_table(sample: int, tracking: Tracking) -> int:
    """Return the sample of a table for one beyond its end, where the table continues at the start of the loop."""
    begin = tracking.lead_in * _FINE
    return wp.where(sample < begin, wp.max(sample, 0), begin + (sample - begin) % (tracking.loop * _FINE))


@wp.func
def lateness(sample: float, steps: float, tracking: Tracking) -> float:
    """Return how far a sample is behind the reference after some control steps [control steps].

    On the loop a robot that is more than half a round late is early.
    """
    late = steps - sample / float(_FINE)
    if steps >= float(tracking.lead_in) and sample >= float(tracking.lead_in * _FINE):
        around = float(tracking.loop)
        late -= around * wp.floor(late / around + 0.5)
    return late


@wp.func
def nearest_sample(path: wp.array(dtype=wp.vec4), first: int, count: int, place: wp.vec2, tracking: Tracking) -> int:
    """Return the sample of a table nearest to a place [m], of `count` from the first."""
    nearest = int(0)
    least = float(wp.inf)
    for k in range(first, first + count):
        sample = on_table(k, tracking)
        away = wp.vec2(path[sample][0], path[sample][1]) - place
        square = wp.dot(away, away)
        if square < least:
            least = square
            nearest = sample
    return nearest


@wp.func
def joining_sample(
    path: wp.array(dtype=wp.vec4), steps: float, place: wp.vec2, heading: float, tracking: Tracking
) -> int:
    """Return the sample of a table at which a robot joins its path: near, of like heading, and in time."""
    nearest = int(0)
    least = float(wp.inf)
    for sample in range(path.shape[0]):
        away = wp.vec2(path[sample][0], path[sample][1]) - place
        late = 0.5 * lateness(float(sample), steps, tracking) * path[sample][3] * tracking.step
        turned = 4.0 * tracking.room * tracking.room * (1.0 - wp.cos(path[sample][2] - heading))
        cost = wp.dot(away, away) + late * late + turned
        if cost < least:
            least = cost
            nearest = sample
    return nearest


@wp.func
def integrator_gains(pole: float) -> wp.vec2:
    """Return the gains of place and rate that put both poles of a double integrator, with steps of 1, at `pole`."""
    return wp.vec2((1.0 - pole) * (1.0 - pole), 0.5 * (1.0 - pole) * (3.0 + pole))


@wp.func
def learned(memory: wp.array(dtype=float), heading: float, speed: float, tracking: Tracking):
    """Learn from the prediction of the control step before: the motor's bias [m/s^2], and the ratio of curvatures."""
    turn = memory[NEXT_TURN]
    if memory[NEXT_SPEED] > 0.0:
        share = tracking.learning
        memory[PUSH_BIAS] += share * (speed - memory[NEXT_SPEED]) / tracking.step
        # Least mean squares, normalised: a turn of less than 0.1 rad contains little information.
        missed = wrap(heading - memory[NEXT_HEADING])
        ratio = memory[TURN_RATIO] + share * missed * turn / (turn * turn + 0.01)
        memory[TURN_RATIO] = wp.clamp(ratio, -0.3, 0.3)


@wp.kernel
def follow_paths(
    curve: CurveStruct,
    robot: RobotStruct,
    tracking: Tracking,
    pose: wp.array3d(dtype=wp.vec4),
    feedforward: wp.array3d(dtype=wp.vec2),
    plan: wp.array2d(dtype=int),
    shift: wp.array2d(dtype=wp.vec2),
    memory: wp.array3d(dtype=float),
    observation: wp.array3d(dtype=float),
    action_out: wp.array3d(dtype=float),
):
    """Follow the timed path of each robot in the table of its plan, shifted by some distance [m]."""
    w, i = wp.tid()
    path = pose[plan[w, i], i]
    known = memory[w, i]
    top_speed = steady_speed(robot)
    heading = own_heading(w, i, observation)
    # An observation may be absurd, an action must not be.
    speed = wp.clamp(own_speed(w, i, top_speed, observation), 0.0, 4.0 * top_speed)
    position = own_position(w, i, curve, observation)
    far = 4.0 * (curve.half_width + curve.half_height)
    position = wp.vec2(wp.clamp(position[0], -far, far), wp.clamp(position[1], -far, far)) - shift[w, i]
    steps = known[STEPS]
    sample = int(known[PROGRESS])
    if known[PLAN] != float(plan[w, i] + 1):
        sample = joining_sample(path, steps, position, heading, tracking)
    sample = nearest_sample(path, sample - _FINE, 4 * _FINE, position, tracking)
    learned(known, heading, speed, tracking)

    at = path[sample]
    ahead = feedforward[plan[w, i], i, sample]
    along = cos_sin(at[2])
    off = position - wp.vec2(at[0], at[1])
    beyond = wp.clamp(wp.dot(off, along), -at[3] * tracking.step, at[3] * tracking.step)
    left = along[0] * off[1] - along[1] * off[0] - 0.5 * ahead[0] * beyond * beyond
    turned = wrap(heading - at[2] - ahead[0] * beyond)
    least_speed = 0.02 * top_speed
    behind = lateness(float(sample), steps, tracking) * at[3] * tracking.step - beyond

    gains = integrator_gains(tracking.pole)
    way = wp.max(speed, wp.max(0.25 * at[3], least_speed)) * tracking.step
    aside = wp.clamp(wp.atan(gains[0] / gains[1] * left / way), -tracking.approach, tracking.approach)
    curvature = ahead[0] - gains[1] / way * (turned + aside)

    grip = wp.sqrt(robot.lateral_acceleration_max / wp.max(wp.abs(curvature), 1.0e-3 / tracking.room))
    more = wp.max(wp.min(tracking.catch_up * at[3], grip - at[3]), 0.0)
    late = wp.clamp(gains[0] / gains[1] * behind / tracking.step, -tracking.catch_up * at[3], more)
    if wp.abs(left) > 2.0 * tracking.room:  # there is no use in being in time far from the path
        late = more
    acceleration = ahead[1] + gains[1] / tracking.step * (at[3] - speed + late)
    # The mean drag of the step is that at half of it.
    push = acceleration + robot.drag * (speed + 0.5 * acceleration * tracking.step)
    if tracking.waits == 1 and speed < least_speed and steps >= float(tracking.lead_in):
        # A car loses half of the time in which it reaches the speed of its path: it starts early by half of this, and
        # is late by as much in the end.
        pull = wp.max(robot.drive * robot.throttle_max - robot.model_offset, least_speed / tracking.step)
        early = -behind / wp.max(at[3] * tracking.step, least_speed * tracking.step)
        start = 0.25 * at[3] / (pull * tracking.step)
        if early > start + 0.5 or early < -1.0:
            push = -robot.model_offset
    steering = wp.atan(robot.wheelbase * curvature / (1.0 + known[TURN_RATIO]))
    throttle = (push + robot.model_offset - known[PUSH_BIAS]) / robot.drive
    action = car_action(robot, steering, throttle)
    action_out[w, i, 0] = action[0]
    action_out[w, i, 1] = action[1]

    steering = wp.clamp(steering, -robot.steering_max, robot.steering_max)
    throttle = wp.clamp(throttle, robot.throttle_min, robot.throttle_max)
    decay = wp.exp(-robot.drag * tracking.step)
    push = robot.drive * throttle - robot.model_offset + known[PUSH_BIAS]
    next_speed = wp.max(decay * speed + (1.0 - decay) * push / robot.drag, 0.0)
    turn = wp.tan(steering) / robot.wheelbase * 0.5 * (speed + next_speed) * tracking.step
    slides = speed * speed * wp.abs(wp.tan(steering)) > 0.9 * robot.wheelbase * robot.lateral_acceleration_max
    coasts = throttle <= robot.dead_zone
    predicts = own_works(w, i, observation) and speed > least_speed and not slides and not coasts
    known[NEXT_SPEED] = wp.where(predicts, next_speed, 0.0)
    known[NEXT_HEADING] = heading + (1.0 + known[TURN_RATIO]) * turn
    known[NEXT_TURN] = turn
    known[PLAN] = float(plan[w, i] + 1)
    known[PROGRESS] = float(sample)
    known[STEPS] = steps + 1.0


class TimedPaths(Policy):
    """Cars that follow timed paths: tables of where each robot is to be at each control step.

    Worlds may follow different plans of one set of tables, which all have the same lengths of lead-in and loop. A
    subclass may write `plan` (W, N) and `shift` (W, N, 2) [m], of each robot, in `decide` before it calls `follow`: a
    robot whose plan changes joins the other path where it is near, of like heading and in time; `shift` moves a robot's
    paths. Time counts from the reset of a world.

    A robot that has failed and resumes makes up for the time: on the lead-in it drives after its reference, on the
    loop it catches up or waits, whichever is less.

    Args:
        scenario: The scenario, of cars.
        num_worlds: W.
        device: Warp device.
        tables: The timed paths, of `baselines.policies.path_tables.path_tables`.
        plan: (W,) plan of each world; by default plan 0, or plan w in world w where there are W plans.
        parameters: Gains and limits.

    Raises:
        ValueError: tables of another number of robots, or a plan that is not among them.
    """

    kind = "car"
    arrays = "warp"
    remembers = "_memory", "shift"

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        *,
        tables: PathTables,
        plan: Sequence[int] | np.ndarray | None = None,
        parameters: TrackingParameters | None = None,
    ):
        super().__init__(scenario, num_worlds, device)
        plans, robots = tables.pose.shape[:2]
        if robots != self.num_robots:
            raise ValueError(f"tables must be of {self.num_robots} robots, got {robots}")
        if plan is None:
            plan = np.arange(self.num_worlds) if plans == self.num_worlds else np.zeros(self.num_worlds, int)
        chosen = np.asarray(plan)
        if chosen.shape != (self.num_worlds,) or not ((chosen >= 0) & (chosen < plans)).all():
            rule = f"must be {self.num_worlds} whole numbers from 0 to {plans - 1}, one per world"
            raise ValueError(f"plan {rule}, got {plan!r}")
        self.tables = tables
        self.tracking = parameters or TrackingParameters()
        self._curve = curve_struct(self.scenario.curve, self.device)
        self._robot = to_struct(RobotStruct, self.scenario.robot)
        self._tracking = tracking_of(self.scenario, tables, self.tracking)
        self._pose = wp.array(tables.pose, dtype=wp.vec4, device=self.device)
        self._feedforward = wp.array(tables.feedforward, dtype=wp.vec2, device=self.device)
        self._first_plan = np.repeat(chosen.astype(np.int32)[:, None], robots, axis=1)
        self.plan = wp.array(self._first_plan, dtype=wp.int32, device=self.device)
        self.shift = wp.zeros(self.shape, dtype=wp.vec2, device=self.device)
        self._memory = wp.zeros((*self.shape, MEMORY), dtype=wp.float32, device=self.device)

    def forget(self, mask: np.ndarray) -> None:
        """Reset the time, the progress and the cars' models of themselves; restore the plan."""
        super().forget(mask)
        plan = self.plan.numpy().copy()
        plan[mask] = self._first_plan[mask]
        self.plan.assign(plan)

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        self.follow(observation)

    def follow(self, observation: wp.array) -> None:
        """Write the `action` that follows the paths of `plan`."""
        inputs = [self._curve, self._robot, self._tracking, self._pose, self._feedforward, self.plan, self.shift,
                  self._memory, observation]  # fmt: skip
        self.launch(follow_paths, self.shape, inputs, [self.action])
