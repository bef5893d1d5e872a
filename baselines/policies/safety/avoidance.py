"""The collision filter's parameters, and its arithmetic for one robot: manoeuvres, margins, the agreed way out."""

import dataclasses
import math
from dataclasses import dataclass

import warp as wp

from baselines.policies.own_row import (
    Actions,
    Observation,
    hears,
    message_age,
    offset_heard,
    offset_seen,
    own_heading,
    own_position,
    own_speed,
    own_works,
    sees,
    velocity_seen,
)
from baselines.policies.safety.own_motion import curvature_of
from baselines.policies.safety.quadratic_program import TOLERANCE, HalfPlanes, into_box, solve_quadratic_program
from baselines.similarity import EXPERIMENT, motion_scale
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.structs import RobotStruct, struct_of
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number, whole
from lissajous_env.world.robots.car import car_action, lowest_speed, motor_acceleration, throttle
from lissajous_env.world.robots.contacts import closest_approach
from lissajous_env.world.robots.differential import integral_of_ramp, ramp

wp.set_module_options(OPTIONS)

MANOEUVRES = wp.constant(9)
"""Manoeuvres that can be ways out: full right, straight on, full left; coasting, at this speed, or at full throttle."""
NEAREST = wp.constant(8)
"""Largest number of robots that are avoided, the nearest first."""
_LONGEST = 40
"""Longest horizon to which `SafetyParameters.of` scales [control steps]."""
_DIFFERENCE = wp.constant(0.05)
"""Change of an action by which the margins are differentiated."""

Car = wp.types.vector(length=5, dtype=wp.float32)
"""x, y [m], heading [rad], speed [m/s] and yaw rate [rad/s] of a car."""
Others = wp.array(dtype=wp.vec4)
"""Relative x, y [m] and velocity over ground [m/s] of the other robots (NEAREST,)."""
Paths = wp.array2d(dtype=wp.vec2)
"""Places [m] on the manoeuvres of this car, then on those of another, at each step of the horizon."""

Scores = wp.types.vector(length=int(MANOEUVRES), dtype=wp.float32)
"""A number for each manoeuvre."""


@dataclass(frozen=True)
class SafetyParameters(Checked):
    """Parameters of the collision filter, besides the scenario.

    The defaults are those of the paper's experiment; `SafetyParameters.of` scales them to another scenario.
    """

    clearance: float = number(0.02, 0, 1e3, "m")
    """Least distance of two cars besides the two radii [m]."""
    growth: float = number(0.05, 0, 1e3, "m/s")
    """Growth of the required distance with the prediction time, because predictions get less accurate [m/s]."""
    horizon: int = whole(8, 1, 100)
    """Horizon of the prediction [control steps]."""
    ample: float = number(0.1, 0, 1e3, "m")
    """Margin above which all manoeuvres are equally good [m]."""
    effort: float = number(0.1, 0, 1e3, "m")
    """Margin that full steering must add to be chosen; coasting and full throttle must add half of it [m]."""
    right: float = number(0.01, -1e3, 1e3, "m")
    """Margin that is added to a manoeuvre to the right, to break the symmetry of a meeting [m]."""
    throttle_weight: float = number(0.5, 1e-6, 1e6)
    """Weight of a change of the throttle's action relative to one of the steering's."""
    passes: int = whole(3, 1, 20)
    """Largest number of linearisations of the margins, each of which is a quadratic program."""
    resting: float = number(0.05, 0, 1e3, "m/s")
    """Speed below which another robot is assumed to have stopped [m/s]."""
    unit: float = number(1.0, 1e-9, 1e6, "m")
    """Unit of the margins in the quadratic program [m]."""
    speed_max: float | None = number(None, 1e-9, 1e5, "m/s")
    """Largest speed to which the throttle may lead [m/s]; None is `baselines.policies.safety.safe.speed_in_sight`, at
    least `HEADROOM` times the formation's speed and at most the top speed of a car."""

    def of(self, scenario: Scenario) -> "SafetyParameters":
        """Return the same parameters scaled from the paper's experiment to another scenario.

        The horizon of slow cars has more control steps, so that their ways out still differ.
        """
        scale = motion_scale(scenario)
        seconds = self.horizon * EXPERIMENT.task.step * scale.time
        horizon = min(max(math.ceil(seconds / scenario.task.step - 1e-6), self.horizon), _LONGEST)
        return dataclasses.replace(self.scaled(scale.length, scale.time), horizon=horizon)


SafetyStruct = struct_of(SafetyParameters)


@wp.struct
class Constants:
    """Constants of the filter, and scales of the entries of an observation."""

    safety: SafetyStruct
    robot: RobotStruct
    robots_seen: wp.int32
    """Number of robots in sight in an observation."""
    sight: wp.float32
    """Distance within which they are observed [m]."""
    step: wp.float32
    """Control step [s]."""
    age_unit: wp.float32
    """Unit of a message's age [s]."""
    delay: wp.float32
    """Delay of messages [s]."""
    listens: wp.int32
    """1 if ring neighbours beyond the sight are avoided, too."""


@wp.func
def car_after(c: Constants, car: Car, action: wp.vec2) -> Car:
    """Return the car a step later: (12) by the midpoint rule, with v up to speed_max.

    A dead zone of the motor is left out, except for cars that reverse. A car that stands for a differential drive gains
    its yaw rate steadily.
    """
    robot = c.robot
    h = c.step
    tau = throttle(robot, action[1])
    push = wp.max(robot.drive * tau - robot.offset, 0.0)
    if robot.speed_min < 0.0:
        push = motor_acceleration(robot, robot.drive, tau)
    before = car[3]
    after = before + h * (push - robot.drag * (before + 0.5 * h * (push - robot.drag * before)))
    after = wp.clamp(after, lowest_speed(robot), wp.max(before, c.safety.speed_max))
    way = 0.5 * h * (before + after)
    grip = robot.lateral_acceleration_max / wp.max(before * before, 1.0e-20)
    curvature = wp.clamp(curvature_of(robot, action[0]), -grip, grip)
    turn = way * curvature
    middle = car[2] + 0.5 * turn
    heading = car[2] + turn
    yaw_rate = float(0.0)
    if wp.isfinite(robot.yaw_acceleration_max):
        missing = after * curvature - car[4]
        middle -= 0.5 * missing * h - integral_of_ramp(0.0, missing, robot.yaw_acceleration_max, 0.5 * h)
        heading -= missing * h - integral_of_ramp(0.0, missing, robot.yaw_acceleration_max, h)
        yaw_rate = ramp(car[4], after * curvature, robot.yaw_acceleration_max * h)
    ahead = cos_sin(middle)
    return Car(car[0] + way * ahead[0], car[1] + way * ahead[1], heading, after, yaw_rate)


@wp.func
def throttle_action(robot: RobotStruct, push: float) -> float:
    """Return the action of the throttle, in [-1, 1], that accelerates the car by `push` [m/s^2]."""
    return car_action(robot, 0.0, (push + robot.offset) / robot.drive)[1]


@wp.func
def manoeuvre(robot: RobotStruct, b: int, speed: float) -> wp.vec2:
    """Return the action of manoeuvre b of a car with some speed [m/s] at its beginning."""
    throttling = float(1.0)
    if b // 3 == 0:
        throttling = car_action(robot, 0.0, robot.throttle_min)[1]
    elif b // 3 == 1:
        throttling = throttle_action(robot, robot.drag * speed)
    return wp.vec2(float(b % 3) - 1.0, throttling)


@wp.func
def price(safety: SafetyStruct, b: int) -> float:
    """Return the margin that manoeuvre b must add to be chosen [m]."""
    cost = 0.5 * safety.effort * wp.abs(float(b // 3) - 1.0)
    if b % 3 != 1:
        cost += safety.effort
    if b % 3 == 0:
        cost -= safety.right
    return cost


@wp.func
def barrier(c: Constants, car: Car, first: int, after: int, others: Others, action: wp.vec2, way_out: wp.vec2) -> float:
    """Return min m_k(action; way_out) over the robots k from `first` on and before `after` [m].

    The margin m_k is the least distance to robot k less 2 r + clearance + growth t, over the horizon. The car applies
    the action for one step and then follows the way out; the others (x, y, x', y') go straight on.
    """
    least = float(wp.inf)
    now = car
    required = 2.0 * c.robot.radius + c.safety.clearance
    for t in range(c.safety.horizon):
        then = car_after(c, now, wp.where(t == 0, action, way_out))
        early = float(t) * c.step
        late = early + c.step
        for k in range(first, after):
            other = others[k]
            square = closest_approach(
                wp.vec2(now[0] - other[0] - early * other[2], now[1] - other[1] - early * other[3]),
                wp.vec2(then[0] - other[0] - late * other[2], then[1] - other[1] - late * other[3]),
            )
            least = wp.min(least, wp.sqrt(square) - required - c.safety.growth * early)
        now = then
    return least


@wp.func
def lay_out_manoeuvres(c: Constants, car: Car, first: int, count: int, moves: bool, path_out: Paths):
    """Write the places [m] of a car, which stands unless it `moves`, on `count` manoeuvres to rows from `first` on."""
    for b in range(count):
        now = car
        action = manoeuvre(c.robot, b, car[3])
        for t in range(c.safety.horizon + 1):
            path_out[first + b, t] = wp.vec2(now[0], now[1])
            if moves:
                now = car_after(c, now, action)


@wp.func
def margin_of_paths(c: Constants, one: int, other: int, path: Paths) -> float:
    """Return the margin of two cars on rows `one` and `other` of the paths, as `barrier` computes it [m]."""
    required = 2.0 * c.robot.radius + c.safety.clearance
    least = float(wp.inf)
    before = path[one, 0] - path[other, 0]
    for t in range(c.safety.horizon):
        after = path[one, t + 1] - path[other, t + 1]
        apart = wp.sqrt(closest_approach(before, after)) - required - c.safety.growth * float(t) * c.step
        least = wp.min(least, apart)
        before = after
    return least


@wp.func
def agreed_way_out(c: Constants, car: Car, n: int, others: Others, path: Paths) -> int:
    """Return the manoeuvre b that two cars agree on, because both compute the best pair of manoeuvres.

    b = argmax min_k max_{b'} min(m_k(b, b'), ample) - price(b) - price(b'), where m_k(b, b') is the margin if this car
    follows b and the other b' from now on. Both cars of a pair observe the same two states, so they compute the same
    pair; yaw rates are not observed, and 0 here. `path` is working memory: places on the manoeuvres of this car, then
    on those of another.
    """
    lay_out_manoeuvres(c, Car(car[0], car[1], car[2], car[3], 0.0), 0, MANOEUVRES, True, path)
    score = Scores(wp.inf)
    for k in range(n):
        other = others[k]
        speed = wp.sqrt(other[2] * other[2] + other[3] * other[3])
        moves = speed >= c.safety.resting
        answers = wp.where(moves, MANOEUVRES, 1)
        heading = wp.atan2(other[3], other[2])
        lay_out_manoeuvres(c, Car(other[0], other[1], heading, speed, 0.0), MANOEUVRES, answers, moves, path)
        for b in range(MANOEUVRES):
            best = float(-wp.inf)
            for answer in range(answers):
                worth = wp.min(margin_of_paths(c, b, MANOEUVRES + answer, path), c.safety.ample)
                if moves:
                    worth -= price(c.safety, answer)
                best = wp.max(best, worth)
            score[b] = wp.min(score[b], best)
    chosen = int(0)
    best = float(-wp.inf)
    for b in range(MANOEUVRES):
        worth = score[b] - price(c.safety, b)
        if worth > best:
            best = worth
            chosen = b
    return chosen


@wp.func
def linearise(c: Constants, car: Car, n: int, others: Others, at: wp.vec2, way_out: wp.vec2, rows_out: HalfPlanes):
    """Write row k, g.u >= c: m_k(at) + g.(u - at) >= 0, with g by differences towards the middle of the box.

    The margins are divided by `safety.unit`.
    """
    steering = wp.where(at[0] > 0.0, -_DIFFERENCE, _DIFFERENCE)
    throttling = wp.where(at[1] > 0.0, -_DIFFERENCE, _DIFFERENCE)
    for k in range(n):
        here = barrier(c, car, k, k + 1, others, at, way_out) / c.safety.unit
        steered = barrier(c, car, k, k + 1, others, at + wp.vec2(steering, 0.0), way_out) / c.safety.unit
        driven = barrier(c, car, k, k + 1, others, at + wp.vec2(0.0, throttling), way_out) / c.safety.unit
        g = wp.vec2((steered - here) / steering, (driven - here) / throttling)
        rows_out[k] = wp.vec3(g[0], g[1], wp.dot(g, at) - here)


@wp.func
def list_seen(w: int, i: int, c: Constants, own: wp.vec2, observation: Observation, others_out: Others) -> int:
    """Write the `Others` in sight of a robot with the velocity `own` [m/s]; return their number."""
    n = int(0)
    for k in range(wp.min(c.robots_seen, NEAREST)):
        if sees(w, i, k, observation):
            away = offset_seen(w, i, k, c.sight, observation)
            velocity = velocity_seen(w, i, k, c.robot.speed_max, observation) + own
            others_out[n] = wp.vec4(away[0], away[1], velocity[0], velocity[1])
            n += 1
    return n


@wp.func
def list_heard(
    w: int,
    i: int,
    n: int,
    c: Constants,
    curve: CurveStruct,
    memory: wp.array4d(dtype=wp.vec3),
    observation: Observation,
    others_out: Others,
) -> int:
    """Add ring neighbours beyond the radius of sight that sent a new and an earlier message; return the number of all.

    Their velocity follows from the two positions, and with it their place now. The memory is the positions in the
    messages of the latest steps (W, N, 2, M), and 1 where there is one.
    """
    own = own_position(w, i, curve, observation)
    count = int(n)
    for side in range(2):
        before = wp.vec3()
        steps = int(0)
        for k in range(memory.shape[3]):
            if memory[w, i, side, k][2] > 0.0:
                before = memory[w, i, side, k]
                steps = k + 1
        for k in range(memory.shape[3] - 1, 0, -1):
            memory[w, i, side, k] = memory[w, i, side, k - 1]
        memory[w, i, side, 0] = wp.vec3()
        if hears(w, i, side, observation) and message_age(w, i, side, c.age_unit, observation) < c.delay + 0.5 * c.step:
            away = offset_heard(w, i, side, curve, observation)
            place = own + away
            memory[w, i, side, 0] = wp.vec3(place[0], place[1], 1.0)
            if steps > 0 and count < NEAREST:
                velocity = (place - wp.vec2(before[0], before[1])) / (float(steps) * c.step)
                away += c.delay * velocity
                if wp.length(away) >= c.sight:
                    others_out[count] = wp.vec4(away[0], away[1], velocity[0], velocity[1])
                    count += 1
    return count


@wp.func
def avoid(
    c: Constants, car: Car, n: int, others: Others, wanted: wp.vec2, top: float, path: Paths, rows: HalfPlanes
) -> wp.vec2:
    """Return the wanted action in the box if a way out remains after it, or else the nearest one that leaves one."""
    u = into_box(wanted, top)
    for b in range(MANOEUVRES):
        if n == 0 or barrier(c, car, 0, n, others, u, manoeuvre(c.robot, b, car[3])) >= 0.0:
            return u
    way_out = manoeuvre(c.robot, agreed_way_out(c, car, n, others, path), car[3])
    way_out[1] = wp.min(way_out[1], top)
    at = u
    for k in range(c.safety.passes):
        linearise(c, car, n, others, at, way_out, rows)
        solution = solve_quadratic_program(n, rows, c.safety.throttle_weight, top, wanted)
        u = wp.vec2(solution[0], solution[1])
        at = u
        if k == 0 and solution[2] > 0.0:
            # The linearised rows contradict one another there: begin again at the way out itself.
            at = way_out
        elif barrier(c, car, 0, n, others, u, way_out) >= -TOLERANCE * c.safety.unit:
            break
    return u


@wp.kernel
def keep_clear(
    c: Constants,
    curve: CurveStruct,
    memory: wp.array4d(dtype=wp.vec3),
    yaw_rate: wp.array2d(dtype=float),
    observation: Observation,
    wanted: Actions,
    others: wp.array3d(dtype=wp.vec4),
    path: wp.array4d(dtype=wp.vec2),
    rows: wp.array3d(dtype=wp.vec3),
    action_out: Actions,
):
    """Write the wanted action, or the nearest one that avoids the other robots; the last arrays are working memory."""
    w, i = wp.tid()
    u = wp.vec2(wanted[w, i, 0], wanted[w, i, 1])
    for k in range(action_out.shape[2]):
        action_out[w, i, k] = wanted[w, i, k]  # beyond the first two, a message
    speed = wp.max(own_speed(w, i, c.robot.speed_max, observation), lowest_speed(c.robot))
    heading = own_heading(w, i, observation)
    n = list_seen(w, i, c, speed * cos_sin(heading), observation, others[w, i])
    if c.listens == 1:
        n = list_heard(w, i, n, c, curve, memory, observation, others[w, i])
    car = Car(0.0, 0.0, heading, speed, yaw_rate[w, i])
    yaw_rate[w, i] = 0.0
    if not own_works(w, i, observation) or not wp.isfinite(u[0]) or not wp.isfinite(u[1]):
        return
    top = throttle_action(c.robot, (c.safety.speed_max - speed) / c.step + c.robot.drag * speed)
    u = avoid(c, car, n, others[w, i], u, top, path[w, i], rows[w, i])
    action_out[w, i, 0] = u[0]
    action_out[w, i, 1] = u[1]
    yaw_rate[w, i] = car_after(c, car, u)[4]
