"""Compatible plans: the distance of a robot's plan from the plans of the others, over the times that matter.

`baselines.policies.safety.proved` states the theorem, whose conditions this module enforces.
"""

import warp as wp

from baselines.policies.safety.own_motion import Bounds
from baselines.policies.safety.swept import swept_room
from baselines.policies.safety.tails import POINTS, room_between
from lissajous_env.device.compilation import OPTIONS

wp.set_module_options(OPTIONS)

OLD, NEW = wp.constant(0), wp.constant(1)
"""Plans of a robot for a step: it continues its old tail, or it takes an action and a new tail follows."""
PLANS = wp.constant(2)
UNHEARD, THERE, FAILED, GONE = wp.constant(0), wp.constant(1), wp.constant(2), wp.constant(3)
"""Presence of a robot: it has heard no ring neighbour yet; it works; it has failed; it was removed. All but the last
are in their places."""
FAR = wp.constant(1.0e30)
"""Distance beyond any other [m]."""


@wp.struct
class Memory:
    """Memory of robots (W, N) and worlds (W,) from step to step; zeros before the first step of an episode."""

    tail: wp.array2d(dtype=wp.vec4)
    """Committed tail at the beginning of the step: `baselines.policies.safety.tails`."""
    tube: wp.array2d(dtype=wp.vec4)
    """Its tube."""
    old_tail: wp.array2d(dtype=wp.vec4)
    """The rest of the previous tail, or the place at which a robot stands, if it failed in the latest step."""
    old_tube: wp.array2d(dtype=wp.vec4)
    """Its tube."""
    steering: wp.array2d(dtype=wp.vec2)
    """Action of the steering on the tail, and on the previous tail."""
    known: wp.array2d(dtype=wp.vec4)
    """Bounds of the robot's own curvature and drive as factors of the nominal: least, most; least, most."""
    sums: wp.array2d(dtype=wp.vec4)
    """Sums from which these bounds follow where commands are noisy: `baselines.policies.safety.own_motion.average`."""
    last: wp.array2d(dtype=wp.vec4)
    """Measured heading [rad], speed [m/s] and the action of the latest step."""
    presence: wp.array2d(dtype=wp.int32)
    """UNHEARD, THERE, FAILED or GONE."""
    steps: wp.array(dtype=wp.int32)
    """Steps decided in this episode."""
    holds: wp.array(dtype=wp.int32)
    """1 where all committed tails are compatible: from then on, by the theorem, no two robots collide."""
    decided: wp.array2d(dtype=wp.int32)
    """1 where the robot has taken a new action, in its turn of this step; its old tail is void."""
    plans: wp.array4d(dtype=wp.vec3)
    """(W, N, PLANS, POINTS) plans for this step, as `baselines.policies.safety.tails.lay_out` writes them."""


@wp.func
def room_inside(plan: wp.array(dtype=wp.vec3), bounds: Bounds) -> float:
    """Return the least distance of a plan from the edge of the rectangle that tails stay in [m] (condition 1)."""
    least = float(FAR)
    for k in range(1, POINTS):
        place = plan[k]
        inside = wp.min(bounds.half_width - wp.abs(place[0]), bounds.half_height - wp.abs(place[1]))
        least = wp.min(least, inside - place[2])
    return least


@wp.func
def room_to(w: int, i: int, plan: int, j: int, enough: float, bounds: Bounds, memory: Memory) -> float:
    """Return the least distance of a plan from all plans of robot j in this step, at the times that matter [m].

    A value below `enough` is only a bound. These are equal times, unless a robot of the two can stop dead (condition
    5). A robot that has decided continues its old tail if its motor fails in this step and it coasts (condition 5).
    """
    one = memory.plans[w, i, plan]
    has_decided = memory.decided[w, j] == 1
    if bounds.stops[i] == 1 or bounds.stops[j] == 1:
        other = memory.plans[w, j, wp.where(has_decided, NEW, OLD)]
        return swept_room(one, other, bounds.stops[i] == 1, bounds.stops[j] == 1, bounds.touch, enough)
    least = float(FAR)
    if has_decided:
        least = room_between(one, memory.plans[w, j, NEW], bounds.touch, enough)
    if least >= enough and (not has_decided or bounds.coasts == 1):
        least = wp.min(least, room_between(one, memory.plans[w, j, OLD], bounds.touch, enough))
    return least


@wp.func
def room_of(w: int, i: int, plan: int, enough: float, first: int, bounds: Bounds, memory: Memory) -> wp.vec2:
    """Return the least distance of a plan from the committed tails of the others [m], and the robot (condition 4).

    The search begins with robot `first` and ends at a value below `enough`.
    """
    least = wp.vec2(room_inside(memory.plans[w, i, plan], bounds), -1.0)
    for k in range(-1, memory.presence.shape[1]):
        if least[0] < enough:
            return least
        j = wp.where(k < 0, first, k)
        if j >= 0 and j != i and memory.presence[w, j] != GONE:
            room = room_to(w, i, plan, j, enough, bounds, memory)
            if room < least[0]:
                least = wp.vec2(room, float(j))
    return least


@wp.func
def is_compatible(w: int, bounds: Bounds, memory: Memory) -> int:
    """Return 1 if the tails of all robots are compatible, with which the induction begins (condition 6)."""
    for i in range(memory.presence.shape[1]):
        if memory.presence[w, i] != GONE and room_of(w, i, OLD, 0.0, -1, bounds, memory)[0] < 0.0:
            return 0
    return 1
