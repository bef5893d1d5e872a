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
class Plans:
    """Plans of the robots (W, N, PLANS) for one step."""

    points: wp.array4d(dtype=wp.vec3)
    """(W, N, PLANS, POINTS) as `baselines.policies.safety.tails.lay_out` writes them."""
    reach: wp.array3d(dtype=wp.float32)
    """Largest distance of the plan from the position of the robot [m]."""
    decided: wp.array2d(dtype=wp.int32)
    """(W, N) 1 where the robot has taken a new action, in its turn of this step; its old tail is void."""


@wp.func
def room_inside(w: int, i: int, plan: int, bounds: Bounds, plans: Plans) -> float:
    """Return the least distance of a plan from the edge of the rectangle that tails stay in [m] (condition 1)."""
    least = float(FAR)
    for k in range(1, POINTS):
        place = plans.points[w, i, plan, k]
        inside = wp.min(bounds.half_width - wp.abs(place[0]), bounds.half_height - wp.abs(place[1]))
        least = wp.min(least, inside - place[2])
    return least


@wp.func
def room_rolling(w: int, i: int, plan: int, j: int, enough: float, bounds: Bounds, plans: Plans) -> float:
    """Return the least distance at equal times of a plan from all plans of robot j in this step [m].

    A value below `enough` is only a bound. A robot that has decided continues its old tail if its motor fails in this
    step and it coasts (condition 5).
    """
    least = float(FAR)
    if plans.decided[w, j] == 1:
        least = room_between(w, i, plan, j, NEW, bounds.touch, enough, plans.points, plans.reach)
    if least >= enough and (plans.decided[w, j] == 0 or bounds.coasts == 1):
        old = room_between(w, i, plan, j, OLD, bounds.touch, enough, plans.points, plans.reach)
        least = wp.min(least, old)
    return least


@wp.func
def room_to(
    w: int, i: int, plan: int, j: int, enough: float, bounds: Bounds, stops: wp.array(dtype=int), plans: Plans
) -> float:
    """Return `room_rolling`, or the same at all times that matter if a robot of the two can stop dead (condition 5)."""
    if stops[i] == 0 and stops[j] == 0:
        return room_rolling(w, i, plan, j, enough, bounds, plans)
    other = wp.where(plans.decided[w, j] == 1, NEW, OLD)
    return swept_room(
        w, i, plan, j, other, stops[i] == 1, stops[j] == 1, bounds.touch, enough, plans.points, plans.reach
    )


@wp.func
def room_of(
    w: int,
    i: int,
    plan: int,
    enough: float,
    first: int,
    bounds: Bounds,
    stops: wp.array(dtype=int),
    presence: wp.array2d(dtype=int),
    plans: Plans,
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
            room = room_to(w, i, plan, j, enough, bounds, stops, plans)
            if room < least[0]:
                least = wp.vec2(room, float(j))
    return least


@wp.func
def is_compatible(
    w: int, bounds: Bounds, stops: wp.array(dtype=int), presence: wp.array2d(dtype=int), plans: Plans
) -> int:
    """Return 1 if the tails of all robots are compatible, with which the induction begins (condition 6)."""
    for i in range(presence.shape[1]):
        if presence[w, i] != GONE and room_of(w, i, OLD, 0.0, -1, bounds, stops, presence, plans)[0] < 0.0:
            return 0
    return 1
