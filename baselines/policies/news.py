"""News of robots that have failed, which travel along the ring in the messages that policies define.

A message has a component for each robot k (`messages.size` of at least N): the last control step in which robot k is
known to have worked, or, negative, the one in which its failure was noticed. Each robot sends the present step for
itself, so a neighbour whose messages still arrive with an old step, as those of a failed robot do, or arrive no more,
has failed. Of two steps for the same robot the later one counts. So the news pass a robot that has itself failed by the
other way around the ring: of any two failures all working robots learn. If three failures cut the ring into three
parts, each part learns of the two failures at its ends.
"""

import warp as wp

from baselines.policies.neighbour_watch import AGE, HEARD_X, HEARD_Y
from baselines.policies.own_row import hears, message_age, message_heard, own_works
from baselines.policies.timed_paths import STEPS
from lissajous_env.device.compilation import OPTIONS

wp.set_module_options(OPTIONS)

_RANGE = wp.constant(1048576.0)
"""Number of control steps that messages in [-1, 1] can distinguish, in exact float32: 29 hours of 0.1 s."""


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
                    told = _RANGE * message_heard(w, i, side, k, start, size, observation)
                    if wp.abs(told) > wp.abs(known[k]):
                        known[k] = told
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


@wp.kernel
def share_line(
    reach: float,
    along: wp.vec2,
    lines: wp.array2d(dtype=int),
    centres: wp.array(dtype=wp.vec2),
    news: wp.array3d(dtype=float),
    cases: wp.array2d(dtype=int),
    home: wp.array2d(dtype=wp.vec2),
):
    """Divide each line of cells evenly among its working robots: count the others, and place each robot.

    `reach` is half of the rectangle's extent along the lines [m], `along` their direction, `lines` (N, L) the robots
    of each robot's line in order, -1 for none, `home` how far the middle of its share is from that of its cell [m].
    """
    w, i = wp.tid()
    failed = int(0)
    shares = int(0)
    rank = int(0)
    for k in range(lines.shape[1]):
        j = lines[i, k]
        if j == i:
            rank = shares
        if j >= 0:
            if j != i and news[w, i, j] < 0.0:
                failed += 1
            else:
                shares += 1
    cases[w, i] = failed
    home[w, i] = wp.vec2(0.0, 0.0)
    if failed > 0:
        middle = reach * (float(2 * rank + 1) / float(shares) - 1.0)
        home[w, i] = (middle - wp.dot(centres[i], along)) * along
