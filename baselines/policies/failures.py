"""Knowledge of a robot about failed robots, from the messages of its ring neighbours and from its sensing disc.

A robot that has failed still sends its place, which does not move; a robot that has been removed sends nothing, so the
age of its last message grows. A robot receives nothing else: without news it has no information about robots that are
not its ring neighbours unless they are in its disc.

News of failures travel along the ring in the messages that policies define. A message has a component for each robot k
(`messages.size` of at least N): the last control step in which robot k is known to have worked, or, negative, the one
in which its failure was noticed. Each robot sends the present step for itself, so a neighbour whose messages still
arrive with an old step, as those of a failed robot do, or arrive no more, has failed. Of two steps for the same robot
the later one counts. So the news pass a robot that has itself failed by the other way around the ring: of any two
failures all working robots learn. If three failures cut the ring into three parts, each part learns of the two
failures at its ends.
"""

import warp as wp

from baselines.policies.own_row import (
    hears,
    message_age,
    message_heard,
    offset_heard,
    offset_seen,
    own_heading,
    own_position,
    own_speed,
    own_works,
    sees,
    velocity_seen,
)
from baselines.policies.timed_paths import STEPS
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.trig import cos_sin

wp.set_module_options(OPTIONS)

WORKS, STANDS, SILENT = (wp.constant(k) for k in range(3))
"""States of a ring neighbour, as a robot believes."""
# Entries of the memory of a ring neighbour.
STATE, HEARD_X, HEARD_Y, AGE, STILL = (wp.constant(k) for k in range(5))
WATCH = 5
PLACES = wp.constant(4)
"""Places of robots that have stopped: of the two ring neighbours, then of two that were sensed."""
_RANGE = wp.constant(1048576.0)
"""Number of control steps that messages in [-1, 1] can distinguish, in exact float32: 29 hours of 0.1 s."""


@wp.struct
class Watch:
    """Constants: displacement in a step below which a robot counts as stopped [m], number of such steps, and scales."""

    still: float
    patience: int
    step: float
    time_unit: float
    speed_unit: float
    radius: float
    robots_seen: int


@wp.func
def note_message(known: wp.array(dtype=float), place: wp.vec2, age: float, still: float, step: float):
    """Store the place in a ring neighbour's message, and count the consecutive ones that are nearly equal.

    A message that was heard before is older by a step [s] and does not count. Places that differ by less than `still`
    [m] are nearly equal.
    """
    if age < known[AGE] + 0.5 * step:
        moved = wp.length(place - wp.vec2(known[HEARD_X], known[HEARD_Y]))
        known[STILL] = wp.where(moved < still, known[STILL] + 1.0, 0.0)
        known[HEARD_X] = place[0]
        known[HEARD_Y] = place[1]
    known[AGE] = age


@wp.kernel
def watch_neighbours(
    curve: CurveStruct,
    watch: Watch,
    observation: wp.array3d(dtype=float),
    memory: wp.array4d(dtype=float),
    standing: wp.array3d(dtype=wp.vec3),
):
    """Update robot i's estimates of its ring neighbours, and of stopped robots: x, y and 1 if the place is in use."""
    w, i = wp.tid()
    position = own_position(w, i, curve, observation)
    for side in range(2):
        known = memory[w, i, side]
        if not hears(w, i, side, observation):
            if known[AGE] > 0.0:
                known[STATE] = float(SILENT)
        else:
            place = position + offset_heard(w, i, side, curve, observation)
            # One step more than the age, so that 0 means that nothing was heard yet.
            age = message_age(w, i, side, watch.time_unit, observation) + watch.step
            if known[AGE] == 0.0:
                known[HEARD_X] = place[0]
                known[HEARD_Y] = place[1]
                known[AGE] = age
            else:
                note_message(known, place, age, watch.still, watch.step)
                if known[STILL] == 0.0:
                    known[STATE] = float(WORKS)
                if known[STILL] >= float(watch.patience):
                    known[STATE] = float(STANDS)
        stands = wp.where(known[STATE] == float(STANDS), 1.0, 0.0)
        standing[w, i, side] = wp.vec3(known[HEARD_X], known[HEARD_Y], stands)
    watch_disc(w, i, position, watch, observation, standing)


@wp.func
def watch_disc(
    w: int,
    i: int,
    position: wp.vec2,
    watch: Watch,
    observation: wp.array3d(dtype=float),
    standing: wp.array3d(dtype=wp.vec3),
):
    """Update the places of stopped robots that are, or were, in the disc."""
    # If a stopped robot should be in the disc but is not sensed, it is not there any more.
    for k in range(2, PLACES):
        known = standing[w, i, k]
        if known[2] > 0.0 and wp.length(wp.vec2(known[0], known[1]) - position) < 0.9 * watch.radius:
            standing[w, i, k] = wp.vec3(0.0, 0.0, 0.0)
    own = own_speed(w, i, watch.speed_unit, observation) * cos_sin(own_heading(w, i, observation))
    for seen in range(watch.robots_seen):
        if sees(w, i, seen, observation):
            velocity = own + velocity_seen(w, i, seen, watch.speed_unit, observation)
            place = position + offset_seen(w, i, seen, watch.radius, observation)
            is_known = bool(False)
            room = int(0)
            for k in range(PLACES):
                known = standing[w, i, k]
                if known[2] > 0.0:
                    if wp.length(wp.vec2(known[0], known[1]) - place) < 2.0 * watch.still + 0.1 * watch.radius:
                        is_known = True
                elif k >= 2:
                    room = k
            if wp.length(velocity) * watch.step < watch.still and not is_known and room > 0:
                standing[w, i, room] = wp.vec3(place[0], place[1], 1.0)


@wp.kernel
def exchange_news(
    start: int,
    step: float,
    time_unit: float,
    neighbours: wp.array2d(dtype=int),
    memory: wp.array3d(dtype=float),
    observation: wp.array3d(dtype=float),
    watched: wp.array4d(dtype=float),
    news: wp.array3d(dtype=float),
    standing: wp.array3d(dtype=wp.vec3),
    action_out: wp.array3d(dtype=float),
):
    """Update robot i's news of all robots, the places of its ring neighbours, and its message.

    `start` is `lissajous_env.world.observation.message_start` of the scenario.
    """
    w, i = wp.tid()
    known = news[w, i]
    now = memory[w, i, STEPS] + 1.0
    size = action_out.shape[2] - 2
    for side in range(2):
        j = neighbours[i, side]
        if j >= 0:
            seen = watched[w, i, side]
            stands = float(0.0)
            if hears(w, i, side, observation):
                for k in range(known.shape[0]):
                    farther = _RANGE * message_heard(w, i, side, k, start, size, observation)
                    if wp.abs(farther) > wp.abs(known[k]):
                        known[k] = farther
                sent = _RANGE * message_heard(w, i, side, j, start, size, observation)
                due = now - 1.0 - message_age(w, i, side, time_unit, observation) / step
                if sent < due - 0.5:
                    stands = 1.0
                    if known[j] >= 0.0:
                        known[j] = -now
            elif seen[AGE] > 0.0 and known[j] >= 0.0:
                known[j] = -now
            standing[w, i, side] = wp.vec3(seen[HEARD_X], seen[HEARD_Y], stands)
    if own_works(w, i, observation):
        known[i] = now
    for k in range(known.shape[0]):
        action_out[w, i, 2 + k] = known[k] / _RANGE
