"""What a person would try first: patrol a loop in file, drive to random places, stand still."""

from typing import Any

import numpy as np
import warp as wp

from baselines.observed import own_heading, own_position
from baselines.policy import Policy
from lissajous_env import draws
from lissajous_env.curve import CurveStruct, wrap
from lissajous_env.robot import RobotStruct
from lissajous_env.scenario import Scenario
from lissajous_env.structs import to_struct

wp.set_module_options({"enable_backward": False, "max_unroll": 1})

_CRUISE = 0.85
"""Share of the top speed at which a patrol goes, so that a car which fell behind can catch up."""


@wp.func
def drive_towards(
    robot: RobotStruct, position: wp.vec2, heading: float, speed: float, goal: wp.vec2, wanted_speed: float
) -> wp.vec2:
    """Action of a car towards a goal [m]: pure pursuit, delta = atan(2 l sin(e) / d), and a proportional speed law."""
    away = goal - position
    distance = wp.max(wp.length(away), 2.0 * robot.wheelbase)
    bearing = wrap(wp.atan2(away[1], away[0]) - heading)
    steering = wp.atan(2.0 * robot.wheelbase * wp.sin(bearing) / distance)
    if wp.abs(bearing) > 1.5707963:
        steering = wp.sign(bearing) * robot.steering_max
    throttle = (robot.drag * wanted_speed + robot.model_offset + 4.0 * (wanted_speed - speed)) / robot.drive
    span = robot.throttle_max - robot.throttle_min
    return wp.vec2(
        wp.clamp(steering / robot.steering_max, -1.0, 1.0),
        wp.clamp(2.0 * (throttle - robot.throttle_min) / span - 1.0, -1.0, 1.0),
    )


@wp.kernel
def follow_loop(
    curve: CurveStruct, robot: RobotStruct, loop: wp.array(dtype=wp.vec2), cruise: float, spacing: float,
    lookahead: float, step: float, steps: wp.array(dtype=int), observation: wp.array3d(dtype=float),
    action_out: wp.array3d(dtype=float),
):
    """Chase robot i's place in the file, which goes around the loop at cruising speed [m/s]."""
    w, i = wp.tid()
    n = observation.shape[1]
    place = cruise * step * float(steps[w]) / spacing + float(i * loop.shape[0]) / float(n)
    goal = loop[int(place + lookahead / spacing) % loop.shape[0]]
    position = own_position(w, i, curve, observation)
    speed = observation[w, i, 4] * robot_speed_max(robot)
    # At cruising speed the goal stays `lookahead` away: further, and the car speeds up.
    wanted = cruise * wp.length(goal - position) / lookahead
    action = drive_towards(robot, position, own_heading(w, i, observation), speed, goal, wanted)
    action_out[w, i, 0] = action[0]
    action_out[w, i, 1] = action[1]


@wp.func
def robot_speed_max(robot: RobotStruct) -> float:
    """Steady speed of a car at full throttle [m/s]."""
    return (robot.drive * robot.throttle_max - robot.offset) / robot.drag


@wp.kernel
def count_steps(steps: wp.array(dtype=int)):
    """Let each world's own clock go on."""
    w = wp.tid()
    steps[w] = steps[w] + 1


@wp.func
def row_key(w: int, i: int, observation: wp.array3d(dtype=float)) -> int:
    """Key of a robot's random draws, made of where it is: the same in any batch, at any place in it."""
    x = int(observation[w, i, 0] * 1.0e6)
    y = int(observation[w, i, 1] * 1.0e6)
    return draws.step_key(x, y)


@wp.kernel
def wander(
    curve: CurveStruct, robot: RobotStruct, phase_rate: int, goals: wp.array2d(dtype=wp.vec3),
    observation: wp.array3d(dtype=float), action_out: wp.array3d(dtype=float),
):
    """Drive to a random place in the rectangle and, there, choose the next; points take random phase rates."""
    w, i = wp.tid()
    position = own_position(w, i, curve, observation)
    goal = goals[w, i]
    away = wp.vec2(goal[0], goal[1]) - position
    if phase_rate == 1 or goal[2] == 0.0 or wp.length(away) < 4.0 * robot.wheelbase:
        draw = draws.stream(row_key(w, i, observation), i, draws.WANDER)
        goal = wp.vec3((2.0 * wp.randf(draw) - 1.0) * curve.half_width, (2.0 * wp.randf(draw) - 1.0) * curve.half_height, 1.0)
        goals[w, i] = goal
    if phase_rate == 1:
        action_out[w, i, 0] = goal[0] / curve.half_width
        return
    speed_max = robot_speed_max(robot)
    speed = observation[w, i, 4] * speed_max
    to = wp.vec2(goal[0], goal[1])
    # A car that would circle around a near goal slows down.
    wanted = speed_max * wp.min(1.0, wp.length(to - position))
    action = drive_towards(robot, position, own_heading(w, i, observation), speed, to, wanted)
    action_out[w, i, 0] = action[0]
    action_out[w, i, 1] = action[1]


class Sweep(Policy):
    """Cars in file, evenly spaced, around a loop: along the boundary if targets enter there, else up and down lanes."""

    kind = "car"

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu"):
        super().__init__(scenario, num_worlds, device)
        robot = self.scenario.robot
        loop = patrol_loop(self.scenario)
        length = float(np.linalg.norm(np.diff(loop, axis=0, append=loop[:1]), axis=1).sum())
        self._curve, self._robot = to_struct(CurveStruct, self.scenario.curve), to_struct(RobotStruct, robot)
        self._loop = wp.array(loop, dtype=wp.vec2, device=self.device)
        self._cruise = cruising_speed(self.scenario)
        self._spacing = length / len(loop)
        self._lookahead = max(4 * robot.wheelbase, 0.3 * self._cruise)
        self._steps = wp.zeros(num_worlds, dtype=wp.int32, device=self.device)

    def _forget(self, mask: np.ndarray) -> None:
        self._steps.assign(np.where(mask, 0, self._steps.numpy()).astype(np.int32))

    def _decide(self, observation: wp.array) -> None:
        inputs = [self._curve, self._robot, self._loop, self._cruise, self._spacing, self._lookahead,
                  self.scenario.task.step, self._steps, observation]  # fmt: skip
        wp.launch(follow_loop, self.shape, inputs, outputs=[self.action], device=self.device)
        wp.launch(count_steps, self.num_worlds, [self._steps], device=self.device)


class RandomWaypoint(Policy):
    """Cars that drive to one random place after another; points that take a random phase rate in each step."""

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu"):
        super().__init__(scenario, num_worlds, device)
        self._curve = to_struct(CurveStruct, self.scenario.curve)
        self._robot = to_struct(RobotStruct, self.scenario.robot)
        self._goals = wp.zeros(self.shape, dtype=wp.vec3, device=self.device)

    def _forget(self, mask: np.ndarray) -> None:
        self._goals.assign(np.where(mask[:, None, None], 0.0, self._goals.numpy()).astype(np.float32))

    def _decide(self, observation: wp.array) -> None:
        inputs = [self._curve, self._robot, int(self.scenario.robot.kind == "curve"), self._goals, observation]
        wp.launch(wander, self.shape, inputs, outputs=[self.action], device=self.device)


class Still(Policy):
    """Robots that stand still; cars coast to rest at the least throttle."""

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu"):
        super().__init__(scenario, num_worlds, device)
        rest = [0.0] if self.scenario.robot.kind == "curve" else [0.0, -1.0]
        self.action.assign(np.tile(np.float32(rest), (*self.shape, 1)))

    def _decide(self, observation: wp.array) -> None:
        """Leave the action as it is."""


def cruising_speed(scenario: Scenario) -> float:
    """Speed of a patrol [m/s]: below the top speed, and no faster than the formation's mean on the same task."""
    return _CRUISE * min(scenario.robot.speed_max, 2.0)


def patrol_loop(scenario: Scenario, points: int = 2048) -> np.ndarray:
    """(points, 2) evenly spaced points of the loop that `Sweep` goes around [m], corners rounded by the lookahead.

    Along the boundary, so far inside that the disc still reaches it, where targets enter at the boundary or two lanes
    would already cover the rectangle; else lanes two sensing radii apart, with the way back along one side.
    """
    curve, radius = scenario.curve, scenario.resolve().sensing.radius
    A, B = curve.half_width, curve.half_height
    inset = min(0.7 * radius, 0.45 * min(A, B))
    lanes = 2 * int(np.ceil((B - inset) / (2 * radius)) + 1)
    if scenario.targets.entry == "boundary" or B <= 2 * inset:
        corners = [(-A + inset, -B + inset), (A - inset, -B + inset), (A - inset, B - inset), (-A + inset, B - inset)]
    else:
        corners = []
        near, far = -A + 3 * inset, A - inset
        for k, y in enumerate(np.linspace(-B + inset, B - inset, lanes)):
            corners += [(near, y), (far, y)] if k % 2 == 0 else [(far, y), (near, y)]
        corners += [(-A + inset, B - inset), (-A + inset, -B + inset)]
    return _resampled(np.array(corners), points)


def _resampled(corners: np.ndarray, points: int) -> np.ndarray:
    closed = np.vstack([corners, corners[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], points, endpoint=False)
    return np.column_stack([np.interp(at, along, closed[:, 0]), np.interp(at, along, closed[:, 1])])
