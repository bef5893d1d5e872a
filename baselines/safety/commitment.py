"""The decisions of the proved filter: each robot in its turn applies an action only if a tail remains after it.

`baselines.safety.proved` states the theorem, whose conditions this module enforces.
"""

import warp as wp

from baselines.policies.own_row import hears, own_heading, own_key, own_position, own_speed, own_works
from baselines.safety.own_motion import Bounds, chord_slack, drive, learn, tail_from, within_grip
from baselines.safety.tails import POINTS, arc_end, lay_out, roll_on, room_between
from lissajous_env.device import randomness
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import RobotStruct

wp.set_module_options(OPTIONS)

OLD, NEW = wp.constant(0), wp.constant(1)
"""Plans of a robot for a step: it continues its old tail, or it applies an action, followed by a new tail."""
PLANS = wp.constant(2)
THERE, GONE = wp.constant(1), wp.constant(2)
"""Presence of a robot: it has heard a ring neighbour; it was removed."""
_FAR = wp.constant(1.0e30)


@wp.struct
class Memory:
    """Memory of robots (W, N) and worlds (W,) from step to step; zeros before the first step of an episode."""

    tail: wp.array2d(dtype=wp.vec4)
    """Committed tail at the beginning of the step: `baselines.safety.tails`."""
    tube: wp.array2d(dtype=wp.vec4)
    """Its tube."""
    old_tail: wp.array2d(dtype=wp.vec4)
    """The rest of the previous tail, which a robot follows whose motor failed in the latest step."""
    old_tube: wp.array2d(dtype=wp.vec4)
    """Its tube."""
    steering: wp.array2d(dtype=wp.vec2)
    """Action of the steering on the tail, and on the previous tail."""
    known: wp.array2d(dtype=wp.vec4)
    """Bounds of the robot's own curvature and drive as factors of the nominal: least, most; least, most."""
    last: wp.array2d(dtype=wp.vec4)
    """Measured heading [rad], speed [m/s] and the action of the latest step."""
    presence: wp.array2d(dtype=wp.int32)
    """THERE, GONE, or 0."""
    steps: wp.array(dtype=wp.int32)
    """Steps decided in this episode."""
    holds: wp.array(dtype=wp.int32)
    """1 where all committed tails are compatible: from then on, by the theorem, no two robots collide."""


@wp.struct
class Plans:
    """Plans of the robots (W, N, PLANS) for one step."""

    points: wp.array4d(dtype=wp.vec3)
    """(W, N, PLANS, POINTS) as `baselines.safety.tails.lay_out` writes them."""
    reach: wp.array3d(dtype=wp.float32)
    """Largest distance of the plan from the position of the robot [m]."""
    decided: wp.array2d(dtype=wp.int32)
    """(W, N) 1 where the robot has selected a new action, in its turn of this step; its old tail is void."""


@wp.func
def is_off_the_wall(bounds: Bounds, car: wp.vec4, speed: float) -> bool:
    """Return whether a car that had a speed [m/s] a step before cannot have met the wall since."""
    way = (speed + car[3]) * bounds.step + bounds.place
    return wp.min(bounds.half_width - wp.abs(car[0]), bounds.half_height - wp.abs(car[1])) > way


@wp.func
def begin(
    w: int,
    i: int,
    bounds: Bounds,
    robot: RobotStruct,
    widest: wp.vec4,
    car: wp.vec4,
    memory: Memory,
    observation: wp.array3d(dtype=float),
) -> bool:
    """Advance a robot's memory to the step that begins; return whether the robot is on its tail (condition 6).

    A robot that is elsewhere, as at the beginning of an episode, begins a tail at its position.
    """
    works = own_works(w, i, observation)
    if hears(w, i, 0, observation) or hears(w, i, 1, observation):
        memory.presence[w, i] = THERE
    elif not works and (memory.presence[w, i] == THERE or memory.steps[w] == 0):
        memory.presence[w, i] = GONE
    if memory.steps[w] == 0:
        memory.known[w, i] = widest
    elif not works:
        memory.tail[w, i] = memory.old_tail[w, i]
        memory.tube[w, i] = memory.old_tube[w, i]
        memory.steering[w, i] = wp.vec2(memory.steering[w, i][1], memory.steering[w, i][1])
    elif bounds.learns == 1 and is_off_the_wall(bounds, car, memory.last[w, i][1]):
        memory.known[w, i] = learn(bounds, robot, memory.known[w, i], widest, memory.last[w, i], car[2], car[3])
    memory.last[w, i] = wp.vec4(car[2], car[3], 0.0, 0.0)
    tail = memory.tail[w, i]
    away = wp.length(wp.vec2(car[0] - tail[0], car[1] - tail[1]))
    if memory.steps[w] > 0 and away <= memory.tube[w, i][1] + bounds.place:
        return True
    errors = wp.vec3(bounds.place, bounds.heading, bounds.speed)
    tail, tube = tail_from(bounds, robot, memory.known[w, i], car, errors, memory.steering[w, i][0])
    memory.tail[w, i] = tail
    memory.tube[w, i] = tube
    return memory.presence[w, i] == GONE


@wp.func
def let_roll(w: int, i: int, bounds: Bounds, robot: RobotStruct, memory: Memory, plans: Plans):
    """Lay out a robot's old plan, in which it continues its tail, and commit to it until the robot decides."""
    before = memory.tail[w, i]
    curvature = memory.tube[w, i][0]
    speed = before[3] * robot.drag
    rate = speed * (robot.drag + speed * wp.abs(curvature))
    bulge = rate * (bounds.step * bounds.step / 32.0 + bounds.chord)
    middle = arc_end(before[0], before[1], before[2], (1.0 - wp.sqrt(bounds.left)) * before[3], curvature)
    tail, tube = roll_on(before, memory.tube[w, i], bounds.left)
    start = wp.vec2(before[0], before[1])
    slack = chord_slack(bounds, robot, tail, tube)
    lay_out(w, i, OLD, start, wp.vec3(middle[0], middle[1], bulge), tail, tube, slack, plans.points, plans.reach)
    memory.tail[w, i] = tail
    memory.tube[w, i] = tube
    memory.old_tail[w, i] = tail
    memory.old_tube[w, i] = tube
    memory.steering[w, i] = wp.vec2(memory.steering[w, i][0], memory.steering[w, i][0])


@wp.func
def room_inside(w: int, i: int, plan: int, bounds: Bounds, plans: Plans) -> float:
    """Return the least distance of a plan from the edge of the rectangle that tails stay in [m] (condition 1)."""
    least = float(_FAR)
    for k in range(1, POINTS):
        place = plans.points[w, i, plan, k]
        inside = wp.min(bounds.half_width - wp.abs(place[0]), bounds.half_height - wp.abs(place[1]))
        least = wp.min(least, inside - place[2])
    return least


@wp.func
def room_to(w: int, i: int, plan: int, j: int, enough: float, bounds: Bounds, plans: Plans) -> float:
    """Return the least distance of a plan from all plans of robot j in this step, or a value below `enough` [m].

    A robot that has decided continues its old tail if its motor fails in this step (condition 5).
    """
    least = float(_FAR)
    if plans.decided[w, j] == 1:
        least = room_between(w, i, plan, j, NEW, bounds.touch, enough, plans.points, plans.reach)
    if least >= enough and (plans.decided[w, j] == 0 or bounds.fails == 1):
        old = room_between(w, i, plan, j, OLD, bounds.touch, enough, plans.points, plans.reach)
        least = wp.min(least, old)
    return least


@wp.func
def room_of(
    w: int, i: int, plan: int, enough: float, first: int, bounds: Bounds, presence: wp.array2d(dtype=int), plans: Plans
) -> wp.vec2:
    """Return the least distance of a plan from the committed tails of the others [m], and the robot (condition 4).

    The search begins with robot `first` and ends at a value below `enough`.
    """
    least = wp.vec2(room_inside(w, i, plan, bounds, plans), -1.0)
    for k in range(-1, presence.shape[1]):
        if least[0] < enough:
            return least
        j = wp.where(k < 0, first, k)
        if j >= 0 and j != i and presence[w, j] != GONE:
            room = room_to(w, i, plan, j, enough, bounds, plans)
            if room < least[0]:
                least = wp.vec2(room, float(j))
    return least


@wp.func
def is_compatible(w: int, bounds: Bounds, presence: wp.array2d(dtype=int), plans: Plans) -> int:
    """Return 1 if the tails of all robots are compatible, with which the induction begins (condition 6)."""
    for i in range(presence.shape[1]):
        if presence[w, i] != GONE and room_of(w, i, OLD, 0.0, -1, bounds, presence, plans)[0] < 0.0:
            return 0
    return 1


@wp.func
def hears_all(w: int, i: int, step: int, bounds: Bounds, observation: wp.array3d(dtype=float)) -> bool:
    """Return whether a robot heard the tails of all others in this step (condition 3)."""
    if bounds.loss == 0.0:
        return True
    key = randomness.step_key(own_key(w, i, observation), step)
    for j in range(observation.shape[1]):
        if j != i and randomness.uniform(key, j, randomness.MESSAGE) < bounds.loss:
            return False
    return True


@wp.func
def decide(
    w: int,
    i: int,
    bounds: Bounds,
    robot: RobotStruct,
    car: wp.vec4,
    want: wp.vec2,
    changes: wp.array(dtype=wp.vec2),
    memory: Memory,
    plans: Plans,
) -> wp.vec2:
    """Take the first of the changed actions after which a tail has room, or continue the old tail.

    If the old tail has no room either, which can happen if conditions are violated, the plan with most room is used.
    """
    known = memory.known[w, i]
    chosen = wp.vec2(memory.steering[w, i][1], -1.0)
    enough = float(0.0)
    if memory.holds[w] == 0:
        enough = wp.min(room_of(w, i, OLD, -_FAR, -1, bounds, memory.presence, plans)[0], 0.0)
    here = wp.vec2(car[0], car[1])
    room = wp.vec2(-_FAR, -1.0)
    for k in range(changes.shape[0]):
        action = within_grip(bounds, robot, known, car[3], want + changes[k])
        if (changes[k][0] != 0.0 and action[0] == want[0]) or (changes[k][1] != 0.0 and action[1] == want[1]):
            continue  # the box or grip undoes the change
        after, errors, middle = drive(bounds, robot, known, car, action)
        tail, tube = tail_from(bounds, robot, known, after, errors, action[0])
        slack = chord_slack(bounds, robot, tail, tube)
        lay_out(w, i, NEW, here, middle, tail, tube, slack, plans.points, plans.reach)
        room = room_of(w, i, NEW, enough, int(room[1]), bounds, memory.presence, plans)
        if room[0] >= enough:
            plans.decided[w, i] = 1
            memory.tail[w, i] = tail
            memory.tube[w, i] = tube
            chosen = action
            enough = room[0]
            if enough >= 0.0:
                break
    if room[0] < enough and plans.decided[w, i] == 1:
        # The plan that was laid out last is not the chosen one.
        after, errors, middle = drive(bounds, robot, known, car, chosen)
        tail, tube = tail_from(bounds, robot, known, after, errors, chosen[0])
        slack = chord_slack(bounds, robot, tail, tube)
        lay_out(w, i, NEW, here, middle, tail, tube, slack, plans.points, plans.reach)
    return chosen


@wp.kernel
def commit(
    bounds: Bounds,
    robot: RobotStruct,
    curve: CurveStruct,
    widest: wp.array(dtype=wp.vec4),
    changes: wp.array(dtype=wp.vec2),
    observation: wp.array3d(dtype=float),
    wanted: wp.array3d(dtype=float),
    memory: Memory,
    plans: Plans,
    action_out: wp.array3d(dtype=float),
):
    """Decide on the actions of a world's robots, one after another, in an order that shifts by one in each step."""
    w = wp.tid()
    n = observation.shape[1]
    step = memory.steps[w]
    for i in range(n):
        here = own_position(w, i, curve, observation)
        speed = wp.max(own_speed(w, i, bounds.speed_unit, observation), 0.0)
        car = wp.vec4(here[0], here[1], own_heading(w, i, observation), speed)
        plans.decided[w, i] = 0
        if not begin(w, i, bounds, robot, widest[i], car, memory, observation):
            memory.holds[w] = 0
        let_roll(w, i, bounds, robot, memory, plans)
    if memory.holds[w] == 0:
        memory.holds[w] = is_compatible(w, bounds, memory.presence, plans)
    for turn in range(n):
        i = (turn + step) % n
        chosen = wp.vec2(memory.steering[w, i][0], -1.0)
        want = wp.vec2(wanted[w, i, 0], wanted[w, i, 1])
        able = own_works(w, i, observation) and wp.isfinite(want[0]) and wp.isfinite(want[1])
        if able and hears_all(w, i, step, bounds, observation):
            here = own_position(w, i, curve, observation)
            car = wp.vec4(here[0], here[1], memory.last[w, i][0], memory.last[w, i][1])
            chosen = decide(w, i, bounds, robot, car, want, changes, memory, plans)
        memory.steering[w, i] = wp.vec2(chosen[0], memory.steering[w, i][1])
        action_out[w, i, 0] = chosen[0]
        action_out[w, i, 1] = chosen[1]
        for k in range(2, action_out.shape[2]):
            action_out[w, i, k] = wanted[w, i, k]  # a message
        memory.last[w, i] = wp.vec4(memory.last[w, i][0], memory.last[w, i][1], chosen[0], chosen[1])
    memory.steps[w] = step + 1
