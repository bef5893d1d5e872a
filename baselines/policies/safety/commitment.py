"""The decisions of the proved filter: each robot in its turn applies an action only if a tail remains after it.

`baselines.policies.safety.proved` states the theorem, whose conditions this module enforces. Each robot has two courses
for a step, and a tail remains if its course stays away from those of all others, over the times that matter.
"""

import warp as wp

from baselines.policies.own_row import (
    Actions,
    Observation,
    has_ever_heard,
    own_heading,
    own_key,
    own_position,
    own_speed,
    own_works,
)
from baselines.policies.safety.own_motion import (
    Terms,
    acceleration_on,
    add_step,
    bounds_from_sums,
    bulge_of,
    learn,
    step_from,
    tail_from,
    within_limits,
)
from baselines.policies.safety.tails import POINTS, Course, Tail, gap_between, lay_out, place_on, roll_on
from lissajous_env.device import randomness
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.world.robots.contacts import distance_inside
from lissajous_env.world.robots.inside import is_safe

wp.set_module_options(OPTIONS)

OLD, NEW = wp.constant(0), wp.constant(1)
"""Courses of a robot for a step: it continues its old tail, or it applies an action and a new tail follows."""
COURSES = wp.constant(2)
UNHEARD, HEARD, REMOVED = wp.constant(0), wp.constant(1), wp.constant(2)
"""Presence of a robot, from its row: it has heard no ring neighbour yet; it has heard one; it was removed. All robots
but the removed ones occupy their places."""


@wp.struct
class Memory:
    """Memory of robots (W, N) and worlds (W,) from step to step; zeros before the first step of an episode."""

    tail: wp.array2d(dtype=Tail)
    """Committed tail: that at the beginning of a step, and from `commit_to_old_course` on that at its end."""
    old_tail: wp.array2d(dtype=Tail)
    """Tail of the robot if it failed in the latest step: the rest of the previous one, or the place where it stands."""
    factors: wp.array2d(dtype=wp.vec4)
    """Bounds of the robot's own curvature, then drive, as factors of the nominal: least, most; least, most."""
    sums: wp.array2d(dtype=wp.vec4)
    """Sums from which these bounds follow where commands are noisy: `baselines.policies.safety.own_motion.add_step`."""
    last: wp.array2d(dtype=wp.vec4)
    """Measured heading [rad], speed [m/s] and the action of the latest step."""
    presence: wp.array2d(dtype=wp.int32)
    """UNHEARD, HEARD or REMOVED."""
    steps: wp.array(dtype=wp.int32)
    """Steps decided in this episode."""
    compatible: wp.array(dtype=wp.int32)
    """1 where all committed tails are compatible: from then on, by the theorem, no two robots collide."""
    decided: wp.array2d(dtype=wp.int32)
    """1 where the robot has applied a new action in its turn of this step."""
    courses: wp.array4d(dtype=wp.vec3)
    """(W, N, COURSES, POINTS) courses for this step, as `baselines.policies.safety.tails.lay_out` writes them."""


@wp.func
def gap_to_edge(course: Course, terms: Terms) -> float:
    """Return the least distance of a course from the edge of the rectangle that tails stay in [m] (condition 1).

    At the share x of a piece, a car is at most 4 bound x (1 - x) beside the chord. Where this leads in by `rise`, the
    car is at most (4 bound - rise)^2 / (16 bound) nearer to the edge than at the beginning of the piece.
    """
    least = float(wp.inf)
    before = distance_inside(terms.half_width, terms.half_height, course[0][0], course[0][1])
    for k in range(1, POINTS):
        place = course[k]
        inside = distance_inside(terms.half_width, terms.half_height, place[0], place[1])
        rise = wp.max(inside - before, 0.0)
        beyond = wp.max(4.0 * place[2] - rise, 0.0)
        least = wp.min(least, inside - rise - beyond * beyond / wp.max(16.0 * place[2], 1.0e-30))
        before = inside
    return least


@wp.func
def gap_to(w: int, i: int, which: int, j: int, enough: float, terms: Terms, memory: Memory) -> float:
    """Return the least distance of a course from those that robot j may follow in this step, less `required` [m].

    `which` is OLD or NEW. A value below `enough` is only a bound. A robot that has decided follows its old tail if its
    motor fails in this step (condition 5); one that stops dead is on its new course then.
    """
    one = memory.courses[w, i, which]
    stops = terms.stops[i] == 1
    other_stops = terms.stops[j] == 1
    has_decided = memory.decided[w, j] == 1
    least = float(wp.inf)
    if has_decided:
        least = gap_between(one, memory.courses[w, j, NEW], stops, other_stops, terms.required, enough)
    if least >= enough and (not has_decided or terms.coasts == 1):
        least = wp.min(least, gap_between(one, memory.courses[w, j, OLD], stops, other_stops, terms.required, enough))
    return least


@wp.func
def smallest_gap(w: int, i: int, which: int, enough: float, first: int, terms: Terms, memory: Memory) -> wp.vec2:
    """Return the least gap of a course, OLD or NEW, to the edge and to all others [m], and the robot, -1 for the edge.

    The search begins with robot `first` and ends at a value below `enough` (condition 4).
    """
    least = wp.vec2(gap_to_edge(memory.courses[w, i, which], terms), -1.0)
    for k in range(-1, memory.presence.shape[1]):
        if least[0] < enough:
            return least
        j = wp.where(k < 0, first, k)
        if j >= 0 and j != i and memory.presence[w, j] != REMOVED:
            gap = gap_to(w, i, which, j, enough, terms, memory)
            if gap < least[0]:
                least = wp.vec2(gap, float(j))
    return least


@wp.func
def is_compatible(w: int, terms: Terms, memory: Memory) -> int:
    """Return 1 if the tails of all robots are compatible, which begins the induction (condition 6)."""
    for i in range(memory.presence.shape[1]):
        if memory.presence[w, i] != REMOVED and smallest_gap(w, i, OLD, 0.0, -1, terms, memory)[0] < 0.0:
            return 0
    return 1


@wp.func
def is_clear_of_walls(terms: Terms, car: wp.vec4, speed: float) -> bool:
    """Return whether a car that had a speed [m/s] a step before cannot have met the wall since."""
    distance = (speed + car[3]) * terms.step + terms.position_error
    return distance_inside(terms.half_width, terms.half_height, car[0], car[1]) > distance


@wp.func
def presence_of(before: int, works: bool, heard: bool, is_first: bool) -> int:
    """Return the presence of a robot, from its presence before and its row (condition 5).

    The messages of its neighbours disappear from a row only if the robot is removed. A robot that does not work in the
    first row of an episode, and has heard nothing, is removed as well. Otherwise one that never heard a neighbour is in
    its place.
    """
    if heard:
        return HEARD
    if works or (before == UNHEARD and not is_first):
        return UNHEARD
    return REMOVED


@wp.func
def learn_from_step(w: int, i: int, terms: Terms, car: wp.vec4, memory: Memory):
    """Narrow the bounds of a robot's own curvature and drive by its latest step."""
    widest = terms.widest[i]
    if terms.noise.actuator == 0.0:
        memory.factors[w, i] = learn(terms, memory.factors[w, i], widest, memory.last[w, i], car[2], car[3])
    else:
        sums = add_step(terms, memory.sums[w, i], memory.last[w, i], car[2], car[3])
        curvature = bounds_from_sums(sums[0], sums[1], wp.vec2(widest[0], widest[1]))
        motor = bounds_from_sums(sums[2], sums[3], wp.vec2(widest[2], widest[3]))
        memory.sums[w, i] = sums
        memory.factors[w, i] = wp.vec4(curvature[0], curvature[1], motor[0], motor[1])


@wp.func
def begin(w: int, i: int, terms: Terms, car: wp.vec4, memory: Memory, observation: Observation) -> bool:
    """Advance a robot's memory to the step that begins; return whether the robot is on its tail (condition 6).

    A robot that is elsewhere, as at the beginning of an episode, begins a tail at its position. So does one that comes
    back after its removal.
    """
    works = own_works(w, i, observation)
    before = memory.presence[w, i]
    now = presence_of(before, works, has_ever_heard(w, i, observation), memory.steps[w] == 0)
    memory.presence[w, i] = now
    is_known = memory.steps[w] > 0 and (before != REMOVED or now == REMOVED)
    if memory.steps[w] == 0:
        memory.factors[w, i] = terms.widest[i]
    elif not works:
        memory.tail[w, i] = memory.old_tail[w, i]
    elif is_clear_of_walls(terms, car, memory.last[w, i][1]):
        learn_from_step(w, i, terms, car, memory)
    memory.last[w, i] = wp.vec4(car[2], car[3], 0.0, 0.0)
    tail = memory.tail[w, i]
    away = wp.length(wp.vec2(car[0] - tail.begin[0], car[1] - tail.begin[1]))
    if is_known and away <= tail.w[0] + terms.position_error:
        return True
    errors = wp.vec3(terms.position_error, terms.heading_error, terms.speed_error)
    memory.tail[w, i] = tail_from(terms, memory.factors[w, i], car, errors, tail.steering)
    return now == REMOVED


@wp.func
def stand(w: int, i: int, place: wp.vec3, steering: float, error: float, memory: Memory):
    """Store that a robot stands at a place, within an error [m], if it stops dead in this step."""
    memory.old_tail[w, i] = Tail(place, 0.0, 0.0, steering, wp.vec3(error, 0.0, 0.0))


@wp.func
def commit_to_old_course(w: int, i: int, terms: Terms, memory: Memory):
    """Lay out a robot's old course, the continuation of its tail, to which it is committed until it decides.

    A robot that can stop dead in this step then stands where the step begins.
    """
    before = memory.tail[w, i]
    middle = place_on(before, 1.0 - wp.sqrt(terms.decay))
    tail = roll_on(before, terms.decay)
    middle[2] = bulge_of(terms, acceleration_on(terms, before))
    slack = terms.chord * acceleration_on(terms, tail)
    lay_out(memory.courses[w, i, OLD], wp.vec2(before.begin[0], before.begin[1]), middle, tail, slack)
    memory.tail[w, i] = tail
    memory.old_tail[w, i] = tail
    if terms.stops[i] == 1:
        stand(w, i, before.begin, before.steering, before.w[0], memory)


@wp.func
def hears_all(w: int, i: int, step: int, terms: Terms, observation: Observation) -> bool:
    """Return whether a robot heard the tails of all others in this step (condition 3)."""
    if terms.message_loss == 0.0:
        return True
    key = randomness.step_key(own_key(w, i, observation), step)
    for j in range(observation.shape[1]):
        if j != i and randomness.uniform(key, j, randomness.MESSAGE) < terms.message_loss:
            return False
    return True


@wp.func
def propose(w: int, i: int, terms: Terms, car: wp.vec4, action: wp.vec2, steering: float, memory: Memory) -> Tail:
    """Lay out the new course of a robot, an action and a tail with a steering; return the tail."""
    factors = memory.factors[w, i]
    after, errors, middle = step_from(terms, factors, car, action)
    tail = tail_from(terms, factors, after, errors, steering)
    slack = terms.chord * acceleration_on(terms, tail)
    lay_out(memory.courses[w, i, NEW], wp.vec2(car[0], car[1]), middle, tail, slack)
    return tail


@wp.func
def steering_after(k: int, terms: Terms, factors: wp.vec4, speed: float, action: wp.vec2) -> float:
    """Return the steering of the k-th tail after an action: the action's, the largest to either side, or none.

    The largest is what grip allows at `speed` [m/s], that before the action, and within the step.
    """
    if k == 0:
        return action[0]
    if k == 3:
        return 0.0
    return within_limits(terms, factors, speed, wp.vec2(wp.where(k == 1, 1.0, -1.0), action[1]))[0]


@wp.func
def leads_out(terms: Terms, tail: Tail) -> bool:
    """Return whether a car at the end of its tail has a way out of the walls; always without walls."""
    if terms.walls.turning == 0.0:
        return True
    end = place_on(tail, 1.0)
    return is_safe(terms.walls, terms.robot, wp.vec4(end[0], end[1], end[2], 0.0))


@wp.func
def decide(w: int, i: int, terms: Terms, car: wp.vec4, want: wp.vec2, memory: Memory) -> wp.vec2:
    """Return the first of the changed actions after which the gap of a tail is not negative, or continue the old tail.

    A tail that ends without a way out of the walls is skipped, unless the old tail ends without one, too. The gap of
    the old tail is negative only if conditions are violated; the course with the largest gap is then followed.
    """
    factors = memory.factors[w, i]
    old = memory.tail[w, i]
    chosen = wp.vec2(old.steering, -1.0)
    enough = float(0.0)
    if memory.compatible[w] == 0:
        enough = wp.min(smallest_gap(w, i, OLD, -wp.inf, -1, terms, memory)[0], 0.0)
    gap = wp.vec2(-wp.inf, -1.0)
    ends_well = leads_out(terms, old)
    for k in range(terms.changes.shape[0] * terms.num_tails):
        change = terms.changes[k // terms.num_tails]
        action = within_limits(terms, factors, car[3], want + change)
        if k % terms.num_tails > 0 and change[0] != 0.0:
            continue  # before a tail with another steering, only actions with the wanted steering are tried
        if (change[0] != 0.0 and action[0] == want[0]) or (change[1] != 0.0 and action[1] == want[1]):
            continue  # the box or grip undoes the change
        steering = steering_after(k % terms.num_tails, terms, factors, car[3], action)
        tail = propose(w, i, terms, car, action, steering, memory)
        if ends_well and not leads_out(terms, tail):
            gap = wp.vec2(-wp.inf, -1.0)  # the course that was laid out is not chosen
            continue
        gap = smallest_gap(w, i, NEW, enough, int(gap[1]), terms, memory)
        if gap[0] >= enough:
            memory.decided[w, i] = 1
            memory.tail[w, i] = tail
            chosen = action
            if terms.stops[i] == 1:
                stand(w, i, wp.vec3(car[0], car[1], car[2]), old.steering, terms.position_error, memory)
            enough = gap[0]
            if enough >= 0.0:
                break
    if gap[0] < enough and memory.decided[w, i] == 1:
        # The course that was laid out last is not the chosen one.
        propose(w, i, terms, car, chosen, memory.tail[w, i].steering, memory)
    return chosen


@wp.kernel
def commit(
    terms: Terms, curve: CurveStruct, observation: Observation, wanted: Actions, memory: Memory, action_out: Actions
):
    """Decide on the actions of a world's robots, one after another, in an order that shifts by one in each step."""
    w = wp.tid()
    n = observation.shape[1]
    step = memory.steps[w]
    for i in range(n):
        here = own_position(w, i, curve, observation)
        speed = wp.max(own_speed(w, i, terms.robot.speed_max, observation), 0.0)
        car = wp.vec4(here[0], here[1], own_heading(w, i, observation), speed)
        memory.decided[w, i] = 0
        if not begin(w, i, terms, car, memory, observation):
            memory.compatible[w] = 0
        commit_to_old_course(w, i, terms, memory)
    if memory.compatible[w] == 0:
        memory.compatible[w] = is_compatible(w, terms, memory)
    for turn in range(n):
        i = (turn + step) % n
        chosen = wp.vec2(memory.tail[w, i].steering, -1.0)
        want = wp.vec2(wanted[w, i, 0], wanted[w, i, 1])
        able = own_works(w, i, observation) and wp.isfinite(want[0]) and wp.isfinite(want[1])
        if able and hears_all(w, i, step, terms, observation):
            here = own_position(w, i, curve, observation)
            car = wp.vec4(here[0], here[1], memory.last[w, i][0], memory.last[w, i][1])
            chosen = decide(w, i, terms, car, want, memory)
        action_out[w, i, 0] = chosen[0]
        action_out[w, i, 1] = chosen[1]
        for k in range(2, action_out.shape[2]):
            message = wanted[w, i, k]  # one that is not finite would void the whole action
            action_out[w, i, k] = wp.where(wp.isfinite(message), message, 0.0)
        memory.last[w, i] = wp.vec4(memory.last[w, i][0], memory.last[w, i][1], chosen[0], chosen[1])
    memory.steps[w] = step + 1
