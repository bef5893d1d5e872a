"""Simple policies: patrol a loop in single file, drive to random places, do not move."""

import dataclasses
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.base import Policy
from baselines.policies.driving import drive_towards, steady_speed
from baselines.policies.loops import (
    SweepParameters,
    cruising_speed,
    fastest_speed,
    length_of,
    lookahead,
    patrol_loop,
    slots_by_phase,
    speed_to_turn,
)
from baselines.policies.own_row import Actions, Observation, X, Y, own_key, own_phase, own_position
from baselines.similarity import motion_scale
from lissajous_env.device import randomness
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct, curve_struct, point2
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.robots.inside import SPEED_GAIN, scaled_gain

wp.set_module_options(OPTIONS)


@wp.func
def nearest_among(loop: wp.array(dtype=wp.vec2), first: int, count: int, place: wp.vec2) -> int:
    """Return the index of the nearest point to a position, of `count` points of the loop from the first."""
    nearest = int(0)
    least = float(wp.inf)
    for k in range(first, first + count):
        at = wp.where(k < 0, k + loop.shape[0], wp.where(k < loop.shape[0], k, k - loop.shape[0]))
        square = wp.length_sq(loop[at] - place)
        if square < least:
            least = square
            nearest = at
    return nearest


@wp.func
def slot_of(
    i: int,
    phase: float,
    curve: CurveStruct,
    alpha: float,
    equilibrium: wp.array(dtype=float),
    loop: wp.array(dtype=wp.vec2),
) -> float:
    """Return the index on the loop where robot i's slot, its place among the cars in single file, begins.

    The slots have the order of the formation's places along the loop, which a robot computes from its own phase.
    """
    n = equilibrium.shape[0]
    size = loop.shape[0]
    own = nearest_among(loop, 0, size, point2(curve, alpha * phase))
    rank = int(0)
    total = int(0)
    for j in range(n):
        other = nearest_among(loop, 0, size, point2(curve, alpha * (phase + equilibrium[j] - equilibrium[i])))
        total += other
        if other < own or (other == own and j < i):
            rank += 1
    middle = float(total) / float(n) - 0.5 * float(size) * float(n - 1) / float(n)
    return middle + float(rank * size) / float(n)


@wp.kernel
def follow_loop(
    curve: CurveStruct,
    robot: RobotStruct,
    speed_gain: float,
    alpha: float,
    equilibrium: wp.array(dtype=float),
    displaced: wp.array(dtype=float),
    loop: wp.array(dtype=wp.vec2),
    cruise: float,
    spacing: float,
    lookahead: float,
    step: float,
    gather: float,
    slowest: float,
    winding: float,
    origin: float,
    memory: wp.array2d(dtype=wp.vec2),
    observation: Observation,
    action_out: Actions,
):
    """Drive to robot i's slot, which moves around the loop at cruising speed [m/s].

    With a time constant `gather` [s], the slots start from rest: their speed is the share 1 - exp(-t / gather) of that.
    If `slowest` [m/s] is not negative, a car drives there along the loop, at least at that speed. If `winding` is not
    0, the slot of a robot follows from its phase by `slots_by_phase`, else from the order of all (`slot_of`). The
    angle `displaced` of the start [rad] is subtracted from the phase.

    The memory of a robot is the index on the loop where its slot began, and one more than the number of steps since
    then.
    """
    w, i = wp.tid()
    size = loop.shape[0]
    known = memory[w, i]
    if known[1] == 0.0:
        phase = own_phase(w, i, observation) - displaced[i]
        slot = winding * phase / 6.283185307179586 * float(size) + origin
        if winding == 0.0:
            slot = slot_of(i, phase, curve, alpha, equilibrium, loop)
        known = wp.vec2(slot, 1.0)
    place = known[0] + (cruise * step * (known[1] - 1.0) + lookahead) / spacing
    if gather > 0.0:
        place -= cruise * gather * (1.0 - wp.exp(-step * (known[1] - 1.0) / gather)) / spacing
    memory[w, i] = wp.vec2(known[0], known[1] + 1.0)
    goal = loop[((int(wp.floor(place)) % size) + size) % size]
    position = own_position(w, i, curve, observation)
    # At cruising speed the distance of the goal stays `lookahead`; a car that is farther from it drives faster.
    wanted = cruise * wp.length(goal - position) / lookahead
    if slowest >= 0.0:
        here = nearest_among(loop, 0, size, position)
        turns = (place - float(here)) / float(size)
        ahead = (turns - wp.floor(turns + 0.5)) * float(size) * spacing
        wanted = wp.max(cruise * ahead / lookahead, slowest)
        goal = loop[(here + wp.max(int(lookahead / spacing), 1)) % size]
    drive_towards(w, i, curve, robot, speed_gain, goal, wanted, observation, action_out)


@wp.kernel
def go_around(
    curve: CurveStruct,
    robot: RobotStruct,
    speed_gain: float,
    loop: wp.array(dtype=wp.vec2),
    cruise: float,
    ahead: int,
    memory: wp.array2d(dtype=int),
    observation: Observation,
    action_out: Actions,
):
    """Drive to the point of the loop that is `ahead` points beyond the nearest one, at cruising speed [m/s].

    The memory of a robot is one more than the index of the nearest point, around which the next one is searched.
    """
    w, i = wp.tid()
    size = loop.shape[0]
    position = own_position(w, i, curve, observation)
    here = memory[w, i] - 1
    if here < 0:
        here = nearest_among(loop, 0, size, position)
    else:
        here = nearest_among(loop, here - wp.min(ahead, size / 2), wp.min(2 * ahead + 1, size), position)
    memory[w, i] = here + 1
    goal = loop[(here + ahead) % size]
    drive_towards(w, i, curve, robot, speed_gain, goal, cruise, observation, action_out)


@wp.kernel
def wander(
    curve: CurveStruct,
    robot: RobotStruct,
    speed_gain: float,
    near: float,
    goals: wp.array2d(dtype=wp.vec3),
    observation: Observation,
    action_out: Actions,
):
    """Drive to a random place in the rectangle, slower within `near` [m] of it, and choose the next one on arrival."""
    w, i = wp.tid()
    position = own_position(w, i, curve, observation)
    goal = goals[w, i]
    away = wp.vec2(goal[0], goal[1]) - position
    if goal[2] == 0.0 or wp.length(away) < 4.0 * robot.wheelbase:
        draw = randomness.stream(own_key(w, i, observation), i, randomness.WANDER)
        goal = wp.vec3(
            (2.0 * wp.randf(draw) - 1.0) * curve.half_width, (2.0 * wp.randf(draw) - 1.0) * curve.half_height, 1.0
        )
        goals[w, i] = goal
    to = wp.vec2(goal[0], goal[1])
    # Slow down where the car would otherwise circle around a near goal.
    wanted = steady_speed(robot) * wp.min(1.0, wp.length(to - position) / near)
    drive_towards(w, i, curve, robot, speed_gain, to, wanted, observation, action_out)


@wp.kernel
def wander_on_curve(robot: RobotStruct, rate: float, observation: Observation, action_out: Actions):
    """Move along the curve at a phase rate that is drawn in each step from [0, 2 rate) [rad/s]."""
    w, i = wp.tid()
    draw = randomness.uniform(own_key(w, i, observation), i, randomness.WANDER)
    action_out[w, i, 0] = wp.min(2.0 * rate * draw / robot.phase_rate_max, 1.0)


@wp.kernel
def act_at_random(memory: wp.array2d(dtype=wp.vec3), observation: Observation, action_out: Actions):
    """Draw each component of the action in each step, also while a robot does not move.

    The memory of a robot is its observed place, and the number of steps for which that has not changed.
    """
    w, i = wp.tid()
    x, y, known = observation[w, i, X], observation[w, i, Y], memory[w, i]
    still = wp.where(known[0] == x and known[1] == y, known[2] + 1.0, 0.0)
    memory[w, i] = wp.vec3(x, y, still)
    key = own_key(w, i, observation) + int(still)
    for k in range(action_out.shape[2]):
        draw = randomness.uniform(key, i * action_out.shape[2] + k, randomness.WANDER)
        action_out[w, i, k] = 2.0 * draw - 1.0


class _Patrol(Policy):
    """Base class of patrols, which have a memory for each robot and drive cars by `baselines.policies.driving`."""

    arrays = "warp"
    remembers = ("_memory",)

    def __init__(self, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu", parameters: Any = None):
        super().__init__(scenario, num_worlds, device, parameters)
        self._robot = to_struct(RobotStruct, self.scenario.robot)
        curve = curve_struct(self.scenario.curve, self.device)
        self._inputs = [curve, self._robot, scaled_gain(self.scenario, SPEED_GAIN)]


class Sweep(_Patrol):
    """Cars in single file, evenly spaced, on a loop: along the boundary if targets enter there, else along lanes."""

    kind = "car"
    Parameters = SweepParameters

    def __init__(self, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu", parameters: Any = None):
        super().__init__(scenario, num_worlds, device, parameters)
        scenario, parameters = self.scenario, self.parameters
        loop, cruise = patrol_loop(scenario, parameters=parameters), parameters.cruise or cruising_speed(scenario)
        slowest = -1.0 if parameters.slowest is None else parameters.slowest
        equilibrium = wp.array(scenario.equilibrium, dtype=wp.float32, device=self.device)
        displaced = wp.array(scenario.displacements, dtype=wp.float32, device=self.device)
        self._loop = wp.array(loop, dtype=wp.vec2, device=self.device)
        self._memory = wp.zeros(self.shape, dtype=wp.vec2, device=self.device)
        self._inputs += [float(scenario.alpha), equilibrium, displaced, self._loop, cruise, length_of(loop) / len(loop)]
        self._inputs += [lookahead(scenario, cruise, parameters), scenario.task.step, parameters.gather, slowest]
        self._inputs += slots_by_phase(scenario, loop) if parameters.by_phase else (0.0, 0.0)

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        self.launch(follow_loop, self.shape, [*self._inputs, self._memory, observation], [self.action])


class Laps(_Patrol):
    """Cars that drive around the loop of `Sweep` from their positions, each on its own, at the formation's top speed.

    They do not control the distance between them, so cars that reach the loop together stay together.
    """

    kind = "car"
    Parameters = SweepParameters

    def __init__(self, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu", parameters: Any = None):
        super().__init__(scenario, num_worlds, device, parameters)
        cruise = self.parameters.cruise or min(fastest_speed(self.scenario), speed_to_turn(self.scenario))
        loop = patrol_loop(self.scenario, parameters=dataclasses.replace(self.parameters, cruise=cruise))
        ahead = max(round(lookahead(self.scenario, cruise, self.parameters) / (length_of(loop) / len(loop))), 1)
        self._memory = wp.zeros(self.shape, dtype=wp.int32, device=self.device)
        self._inputs += [wp.array(loop, dtype=wp.vec2, device=self.device), cruise, ahead]

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        self.launch(go_around, self.shape, [*self._inputs, self._memory, observation], [self.action])


class RandomWaypoint(_Patrol):
    """Cars that drive to one random place after another; points move at a random phase rate in each step.

    The mean rate of points is omega / alpha, so that the policy has no advantage in speed. Robots of any other model
    apply a random action in each step.
    """

    def __init__(self, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu", parameters: Any = None):
        super().__init__(scenario, num_worlds, device, parameters)
        self._rate = self.scenario.formation.phase_rate / self.scenario.alpha
        self._near = motion_scale(self.scenario).length
        self._memory = wp.zeros(self.shape, dtype=wp.vec3, device=self.device)

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        kernel, inputs = {
            "car": (wander, [*self._inputs, self._near, self._memory, observation]),
            "curve": (wander_on_curve, [self._robot, self._rate, observation]),
        }.get(self.scenario.actuation, (act_at_random, [self._memory, observation]))
        self.launch(kernel, self.shape, inputs, [self.action])


class Still(Policy):
    """Robots that do not move; cars coast to rest at the least throttle."""

    arrays = "warp"

    def __init__(self, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu", parameters: Any = None):
        super().__init__(scenario, num_worlds, device, parameters)
        action = np.zeros(self.action.shape, dtype=np.float32)
        rest = self.scenario.model.rest_action(self.scenario.robot)
        action[..., : len(rest)] = rest
        self._rest = wp.array(action, dtype=wp.float32, device=self.device)

    def decide(self, observation: wp.array) -> wp.array:
        """Return the actions of robots that rest."""
        return self._rest
