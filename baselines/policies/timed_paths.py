"""Cars that follow timed paths: the shared base of policies that plan the motion of the team beforehand.

A car is a flat system: its place as a function of time determines its heading, speed, steering and throttle. The tables
(`baselines.policies.path_tables`) contain these. The kernel adds a feedback of the errors along and across the path,
which corrects for uneven cars, noise, and stops.

The reference of a robot is the sample of its table at the present time. Its *progress* is the sample nearest to it,
searched around the one before. With the curvature k and speed u of the path at the progress, the distance y to the
left of the path, the angle e between heading and path, the distance s that the robot is behind its reference along the
path, h the control step and d = v h,

    curvature = k - (1 - p)(3 + p) / 2d (e + atan((1 - p) 2 y / ((3 + p) d)))
    acceleration = u' + (1 - p)(3 + p) / 2h (u - v + limit((1 - p) 2 s / ((3 + p) h)))
    steering = atan(l curvature / a),  throttle = (acceleration + c v + beta - b) / alpha

These are the gains that place both poles of a double integrator with a held input at p = exp(-h / settling), per
control step. `limit` changes the speed by at most a share of u: a car that is late drives somewhat faster than the
path, and one that is early slower. A car that is far from its path drives straight towards it. a and b are estimates of
the robot's own car: the ratio of the driven curvature to the commanded one, and the acceleration of the motor beyond
the model's.

On flatness: M. Fliess, J. Levine, P. Martin, P. Rouchon, "Flatness and defect of non-linear systems: introductory
theory and examples", International Journal of Control 61 (1995).
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.base import Policy, both_contents
from baselines.policies.driving import steady_speed
from baselines.policies.inside import Inside
from baselines.policies.own_row import Actions, Observation, own_heading, own_position, own_speed, own_works
from baselines.policies.path_tables import FINE, PathTables
from baselines.policies.safety.safe import Safe, SafetyParameters
from baselines.similarity import manoeuvring_length, motion_scale
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct, curve_struct, wrap
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.parts import Faults
from lissajous_env.world.robots.car import car_action

wp.set_module_options(OPTIONS)

STEPS, PROGRESS, VARIANT, PUSH_BIAS, TURN_RATIO = (wp.constant(k) for k in range(5))
SPEED, HEADING, CURVATURE, PUSH = (wp.constant(k) for k in range(5, 9))
MEMORY = 9
"""Memory of a robot: the steps since the reset, the sample of its progress, one more than its variant, the bias of its
motor [m/s^2], the relative error of its curvature, and of the latest step the speed at its beginning [m/s], the heading
there, and the curvature [1/m] and acceleration without drag [m/s^2] of the model; speed 0 where it does not apply."""

_SETTLING, _SETTLING_STEPS = 0.12, 0.8
"""Time constant of an error [s] in the time scale of the paper's experiment, and the least one [control step]; that of
differential drives is at least 1 / sqrt(yaw acceleration), for they weave if it is shorter."""
_APPROACH = wp.constant(1.5)
"""Largest angle at which a car approaches its path [rad]."""
_CATCH_UP = wp.constant(0.5)
"""Largest share of the path's speed by which a car that is late drives faster, or one that is early slower."""
_LEARNING = wp.constant(0.1)
"""Share of the error of its model by which a car corrects it in each control step."""
ARRIVING = SafetyParameters(clearance=0.07, growth=0.2)
"""Parameters of the collision filter of cars on the way to their loops, which give way earlier than those on loops."""


@wp.struct
class Tracking:
    """Constants of the feedback, and lengths of the tables."""

    step: float
    """Control step h [s]."""
    pole: float
    """Pole p of an error, exp(-h / settling)."""
    manoeuvring: float
    """Length in which a car manoeuvres [m]."""
    lead_in_steps: int
    """Length of the lead-in [control steps]."""
    loop_steps: int
    """Length of the loop [control steps]."""
    early_samples: int
    """Samples by which a curvature is commanded early: half of the time in which a drive gains the largest yaw rate."""
    waits: int
    """1 if a car that has stopped beside its loop waits until its reference passes."""


@wp.func
def sample_on_table(sample: int, tracking: Tracking) -> int:
    """Return a sample of a table for a number that may be beyond its end: there the loop begins again."""
    begin = tracking.lead_in_steps * FINE
    return wp.where(sample < begin, wp.max(sample, 0), begin + (sample - begin) % (tracking.loop_steps * FINE))


@wp.func
def lateness(sample: float, steps: float, tracking: Tracking) -> float:
    """Return how far a sample is behind the reference after some control steps [control steps].

    On the loop a robot that is more than half a round late is early.
    """
    late = steps - sample / float(FINE)
    if steps >= float(tracking.lead_in_steps) and sample >= float(tracking.lead_in_steps * FINE):
        around = float(tracking.loop_steps)
        late -= around * wp.floor(late / around + 0.5)
    return late


@wp.func
def nearest_sample(path: wp.array(dtype=wp.vec4), first: int, count: int, place: wp.vec2, tracking: Tracking) -> int:
    """Return the sample of a table nearest to a place [m], of `count` from the first."""
    nearest = int(0)
    least = float(wp.inf)
    for k in range(first, first + count):
        sample = sample_on_table(k, tracking)
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
        turned = 4.0 * tracking.manoeuvring * tracking.manoeuvring * (1.0 - wp.cos(path[sample][2] - heading))
        cost = wp.dot(away, away) + late * late + turned
        if cost < least:
            least = cost
            nearest = sample
    return nearest


@wp.func
def learn(memory: wp.array(dtype=float), robot: RobotStruct, heading: float, speed: float, tracking: Tracking):
    """Correct the motor's bias and the ratio of curvatures by the error of the model in the latest step."""
    decay = wp.exp(-robot.drag * tracking.step)
    push = memory[PUSH] + memory[PUSH_BIAS]
    expected = wp.max(decay * memory[SPEED] + (1.0 - decay) * push / robot.drag, 0.0)
    if memory[SPEED] > 0.0 and expected > 0.0:
        memory[PUSH_BIAS] += _LEARNING * (speed - expected) / tracking.step
        turn = memory[CURVATURE] * 0.5 * (memory[SPEED] + expected) * tracking.step
        missed = wrap(heading - (memory[HEADING] + (1.0 + memory[TURN_RATIO]) * turn))
        # Least mean squares, normalised: a turn of less than 0.1 rad contains little information.
        ratio = memory[TURN_RATIO] + _LEARNING * missed * turn / (turn * turn + 0.01)
        memory[TURN_RATIO] = wp.clamp(ratio, -0.3, 0.3)


@wp.kernel
def follow_paths(
    curve: CurveStruct,
    robot: RobotStruct,
    tracking: Tracking,
    pose: wp.array3d(dtype=wp.vec4),
    feedforward: wp.array3d(dtype=wp.vec2),
    variant: wp.array2d(dtype=int),
    shift: wp.array2d(dtype=wp.vec2),
    memory: wp.array3d(dtype=float),
    observation: Observation,
    action_out: Actions,
):
    """Follow the timed path of each robot in its variant of the tables, shifted by some distance [m]."""
    w, i = wp.tid()
    path = pose[variant[w, i], i]
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
    if known[VARIANT] != float(variant[w, i] + 1):
        sample = joining_sample(path, steps, position, heading, tracking)
    sample = nearest_sample(path, sample - FINE, 4 * FINE, position, tracking)
    learn(known, robot, heading, speed, tracking)

    nearest = path[sample]
    path_speed = nearest[3]
    planned = feedforward[variant[w, i], i, sample]
    direction = cos_sin(nearest[2])
    offset = position - wp.vec2(nearest[0], nearest[1])
    past = wp.clamp(wp.dot(offset, direction), -path_speed * tracking.step, path_speed * tracking.step)
    left = direction[0] * offset[1] - direction[1] * offset[0] - 0.5 * planned[0] * past * past
    heading_error = wrap(heading - nearest[2] - planned[0] * past)
    least_speed = 0.02 * top_speed
    behind = lateness(float(sample), steps, tracking) * path_speed * tracking.step - past

    # of place and rate, for steps of 1
    gains = wp.vec2((1.0 - tracking.pole) * (1.0 - tracking.pole), 0.5 * (1.0 - tracking.pole) * (3.0 + tracking.pole))
    step_length = wp.max(speed, wp.max(0.25 * path_speed, least_speed)) * tracking.step
    approach = wp.clamp(wp.atan(gains[0] / gains[1] * left / step_length), -_APPROACH, _APPROACH)
    path_curvature = feedforward[variant[w, i], i, sample_on_table(sample + tracking.early_samples, tracking)][0]
    curvature = path_curvature - gains[1] / step_length * (heading_error + approach)

    grip_speed = wp.sqrt(robot.lateral_acceleration_max / wp.max(wp.abs(curvature), 1.0e-3 / tracking.manoeuvring))
    faster_max = wp.max(wp.min(_CATCH_UP * path_speed, grip_speed - path_speed), 0.0)
    catch_up = wp.clamp(gains[0] / gains[1] * behind / tracking.step, -_CATCH_UP * path_speed, faster_max)
    if wp.abs(left) > 2.0 * tracking.manoeuvring:  # there is no use in being in time far from the path
        catch_up = faster_max
    acceleration = planned[1] + gains[1] / tracking.step * (path_speed - speed + catch_up)
    # The mean drag of the step is that at half of it.
    push = acceleration + robot.drag * (speed + 0.5 * acceleration * tracking.step)
    if tracking.waits == 1 and speed < least_speed and steps >= float(tracking.lead_in_steps):
        # While it accelerates, a car loses half of the time in which it reaches the speed of its path. It starts early
        # by half of this loss, and is late by as much afterwards.
        push_max = wp.max(robot.drive * robot.throttle_max - robot.model_offset, least_speed / tracking.step)
        early = -behind / wp.max(path_speed * tracking.step, least_speed * tracking.step)
        start = 0.25 * path_speed / (push_max * tracking.step)
        if early > start + 0.5 or early < -1.0:
            push = -robot.model_offset
    steering = wp.atan(robot.wheelbase * curvature / (1.0 + known[TURN_RATIO]))
    throttle = (push + robot.model_offset - known[PUSH_BIAS]) / robot.drive
    action = car_action(robot, steering, throttle)
    action_out[w, i, 0] = action[0]
    action_out[w, i, 1] = action[1]

    steering = wp.clamp(steering, -robot.steering_max, robot.steering_max)
    throttle = wp.clamp(throttle, robot.throttle_min, robot.throttle_max)
    slides = speed * speed * wp.abs(wp.tan(steering)) > 0.9 * robot.wheelbase * robot.lateral_acceleration_max
    moves = own_works(w, i, observation) and speed > least_speed
    known[SPEED] = wp.where(moves and not slides and throttle > robot.dead_zone, speed, 0.0)
    known[HEADING] = heading
    known[CURVATURE] = wp.tan(steering) / robot.wheelbase
    known[PUSH] = robot.drive * throttle - robot.model_offset
    known[VARIANT] = float(variant[w, i] + 1)
    known[PROGRESS] = float(sample)
    known[STEPS] = steps + 1.0


@wp.kernel
def take_filtered(
    until: float,
    tolerance: float,
    tracking: Tracking,
    curve: CurveStruct,
    pose: wp.array3d(dtype=wp.vec4),
    variant: wp.array2d(dtype=int),
    shift: wp.array2d(dtype=wp.vec2),
    memory: wp.array3d(dtype=float),
    observation: Observation,
    filtered: Actions,
    action_out: Actions,
):
    """Use the actions of the collision filter up to control step `until`.

    Later on, use them for a robot that is farther from its reference than `tolerance` [m], where others do not expect
    it.
    """
    w, i = wp.tid()
    steps = memory[w, i, STEPS]  # already those after this control step
    path = pose[variant[w, i], i]
    reference = path[sample_on_table(FINE * (int(steps) - 1), tracking)]
    offset = own_position(w, i, curve, observation) - shift[w, i] - wp.vec2(reference[0], reference[1])
    if steps <= until or wp.length(offset) > tolerance:
        action_out[w, i, 0] = filtered[w, i, 0]
        action_out[w, i, 1] = filtered[w, i, 1]


class TimedPaths(Policy):
    """Cars that follow timed paths: tables of where each robot is to be at each control step.

    A subclass returns its tables from `timed`. It may write `variant` (W, N), the variant of the tables that a robot
    follows, and `shift` (W, N, 2) [m] before `decide` of this class: a robot whose variant changes joins the other path
    where it is near, of like heading and in time; `shift` moves a robot's paths. Time counts from the reset of a world.

    A robot that resumes after a failure is behind its reference: on the lead-in it follows the reference, on the loop
    it catches up or waits, whichever takes less time.

    Raises:
        ValueError: tables of another number of robots.
    """

    kind = "car"
    arrays = "warp"
    remembers = "_memory", "variant", "shift"
    waits: bool = False
    """True if a car that has stopped beside its loop waits until its reference passes, instead of following it."""

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", parameters: Any = None):
        super().__init__(scenario, num_worlds, device, parameters)
        self.tables = tables = self.timed(plain_of(self.scenario))
        if tables.pose.shape[1] != self.num_robots:
            raise ValueError(f"tables must be of {self.num_robots} robots, got {tables.pose.shape[1]}")
        self._curve = curve_struct(self.scenario.curve, self.device)
        self._robot = to_struct(RobotStruct, self.scenario.robot)
        step, robot, self._tracking = self.scenario.task.step, self.scenario.robot, Tracking()
        settling = max(_SETTLING * motion_scale(self.scenario).time, _SETTLING_STEPS * step)
        settling = max(settling, robot.top_yaw_acceleration**-0.5)
        self._tracking.step, self._tracking.pole = step, math.exp(-step / settling)
        self._tracking.manoeuvring, self._tracking.waits = manoeuvring_length(robot), int(self.waits)
        self._tracking.lead_in_steps, self._tracking.loop_steps = tables.lead_in_steps, tables.loop_steps
        yaw_rate = float(np.abs(tables.feedforward[..., 0] * tables.pose[..., 3]).max())
        gained_in = yaw_rate / robot.top_yaw_acceleration
        self._tracking.early_samples = round(FINE * min(gained_in / (2 * step), 1.0))
        self._pose = wp.array(tables.pose, dtype=wp.vec4, device=self.device)
        self._feedforward = wp.array(tables.feedforward, dtype=wp.vec2, device=self.device)
        self.variant = wp.zeros(self.shape, dtype=wp.int32, device=self.device)
        self.shift = wp.zeros(self.shape, dtype=wp.vec2, device=self.device)
        self._memory = wp.zeros((*self.shape, MEMORY), dtype=wp.float32, device=self.device)
        if self._stay_inside is not None and tables.filtered_until == 0:
            # Paths that are planned from the start turn early.
            self._stay_inside = Inside(self.scenario, self.num_worlds, self.device, turns_early=True)
        self._tolerance, self._filter = math.inf, None
        if tables.filtered_until > 0:
            self._avoid_others()

    def timed(self, scenario: Scenario) -> PathTables:
        """Return the timed paths for a scenario, which is resolved and without what plans do not depend on."""
        raise NotImplementedError(f"{type(self).__name__} must have a method timed(scenario)")

    def _avoid_others(self, tolerance: float = math.inf) -> None:
        """Use the collision filter as `take_filtered` does; `tolerance` [m] is its argument."""
        self._tolerance = tolerance
        self._filter = Safe(self.scenario, self.num_worlds, self.device, ARRIVING.of(self.scenario))
        self.communicates = both_contents(self.communicates, self._filter.communicates)

    def decide(self, observation: wp.array) -> None:
        """Write the `action` that follows the paths of `variant`, or that of the collision filter."""
        inputs = [self._curve, self._robot, self._tracking, self._pose, self._feedforward, self.variant, self.shift,
                  self._memory, observation]  # fmt: skip
        self.launch(follow_paths, self.shape, inputs, [self.action])
        if self._filter is not None:
            inputs = [self.tables.filtered_until, self._tolerance, self._tracking, self._curve, self._pose]
            inputs += [self.variant, self.shift, self._memory, observation, self._filter(observation, self.action)]
            self.launch(take_filtered, self.shape, inputs, [self.action])


def plain_of(scenario: Scenario) -> Scenario:
    """Return a resolved scenario without what timed paths do not depend on, so that like scenarios share them."""
    return replace(scenario.without_extensions(), name="", description="", faults=Faults())
