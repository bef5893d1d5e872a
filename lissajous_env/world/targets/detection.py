"""Detection of targets: they appear, move, and are detected by the first working robot that has them in its disc.

They are in sight of the robots that have them within `sensing.sight` at the end of a step.

Targets of a world are processed side by side. With many robots or targets, bins are used to select the robots near a
target, with the same result to the last bit.
"""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.abreast import ABREAST, Floats, Ints, width
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.stage import OPTIONAL, TARGET, part, stage
from lissajous_env.device.structs import code_of
from lissajous_env.settings.task import Targets as TargetSettings
from lissajous_env.world.robots.nearby import Bins, bin_of, first_sight, max_displacement, nearest_sensors
from lissajous_env.world.state import FOUND, GONE, HIDDEN, PRESENT
from lissajous_env.world.targets.motion import CUSTOM, FLEEING, STILL, away_from_all, flee, is_moved, wander

wp.set_module_options(MOTION)

PLACES = wp.constant(64)
"""Number of places that are tried for a target that appears outside all discs."""
_FROM_ALL = wp.constant(code_of(TargetSettings, "flight", "all"))


@wp.func
def list_in_sight(w: int, t: int, place: wp.vec2, bins: Bins):
    """List a target that is in sight, for the robots that observe it."""
    here = wp.atomic_add(bins.seen_used, w, 1)
    after = wp.atomic_exch(bins.first_seen, w, bin_of(place, bins), here)
    bins.seen[w, here] = wp.vec4(place[0], place[1], float(t), float(after))


@stage(TARGET, writes="targets: position")
def place_unseen(w, lane, lanes, curve, sensing, clock, robots, targets, bins=OPTIONAL):
    """Put targets that appear now at the first of `PLACES` random places outside all sensing discs, or at the last."""
    now = clock.step[w]
    key = randomness.step_key(clock.seed[w], now)
    for t in range(lane, targets.status.shape[1], lanes):
        if targets.appears_at[w, t] > now:
            break  # the slots are in the order of their times
        if targets.status[w, t] == HIDDEN:
            draw = randomness.stream(key, t, randomness.UNSEEN)
            for _ in range(PLACES):
                x = (2.0 * wp.randf(draw) - 1.0) * curve.half_width
                y = (2.0 * wp.randf(draw) - 1.0) * curve.half_height
                targets.position[w, t] = wp.vec2(x, y)
                _nearest, square = nearest_sensors(w, 1, Floats(x), Floats(y), robots, bins)
                if square[0] >= sensing.radius * sensing.radius:
                    break


@wp.struct
class Flock:
    """Some targets of a world, side by side."""

    count: wp.int32
    number: Ints
    status: Ints
    motion: Ints
    """STILL for one that is hidden."""
    before_x: Floats
    before_y: Floats
    """Position at the beginning of the step [m]."""
    x: Floats
    y: Floats
    heading: Floats
    speed: Floats
    """Speed while it does not flee [m/s]."""
    flight: Floats
    """Distance to a robot below which it flees [m]; 0 for one that never flees."""


@part
def gather(w, count: int, number: Ints, target, targets) -> Flock:
    """Load the targets of these numbers; one that an extension moves has already moved."""
    flock = Flock()
    flock.count = count
    flock.number = number
    for k in range(count):
        t = number[k]
        place = targets.position[w, t]
        flock.status[k] = targets.status[w, t]
        flock.motion[k] = targets.motion[w, t]
        flock.x[k] = place[0]
        flock.y[k] = place[1]
        flock.heading[k] = targets.heading[w, t]
        flock.speed[k] = target.speed
        if target.speed_min < target.speed:
            flock.speed[k] = targets.speed[w, t]
        before = place
        if targets.motion[w, t] == CUSTOM:
            before = targets.before[w, t]
            targets.before[w, t] = place
        flock.before_x[k] = before[0]
        flock.before_y[k] = before[1]
        if targets.status[w, t] == HIDDEN:
            flock.motion[k] = STILL
        if flock.motion[k] == FLEEING:
            flock.flight[k] = target.flee_radius
    return flock


@part
def move_together(
    w, key, flock: Flock, nearest: Ints, square: Floats, step: float, curve, target, robots, targets
) -> tuple[Floats, Floats]:
    """Move targets over a step [s]; returns their new places [m]. `nearest` and `square` are of `nearest_sensors`."""
    # Copies: a loop over the fields of a struct does not become SIMD.
    number = flock.number
    motion = flock.motion
    x = flock.x
    y = flock.y
    heading = flock.heading
    speed = flock.speed
    for k in range(ABREAST):
        if k < width():
            moved = wander(number[k], key, motion[k], x[k], y[k], heading[k], speed[k], step, curve, target)
            x[k] = wp.where(is_moved(motion[k]), moved[0], x[k])
            y[k] = wp.where(is_moved(motion[k]), moved[1], y[k])
            heading[k] = moved[2]
    for k in range(flock.count):
        if square[k] < flock.flight[k] * flock.flight[k]:
            place = wp.vec2(flock.x[k], flock.y[k])
            away = place - robots.sensor[w, nearest[k]]
            if target.flight == _FROM_ALL:
                away = away_from_all(w, place, curve, target, robots)
            fled = flee(place, away, step, curve, target)
            x[k] = fled[0]
            y[k] = fled[1]
            heading[k] = fled[2]
        if is_moved(flock.motion[k]):
            targets.position[w, flock.number[k]] = wp.vec2(x[k], y[k])
            targets.heading[w, flock.number[k]] = heading[k]
    return x, y


@part
def detect(w, t, now, nearest: wp.vec2, sight: wp.vec2, radius: float, targets, latest) -> int:
    """Let a robot detect a target: the first on its way or else, if it is seen there, the nearest at its end.

    `nearest` is of `nearest_sensors`, `sight` of `first_sight`. Returns 1 where it does.
    """
    found = wp.where(nearest[1] < radius * radius, int(nearest[0]), -1)
    if sight[1] <= 1.0:
        found = int(sight[0])
        targets.found_early[w, t] = 1.0 - sight[1]
    targets.status[w, t] = wp.where(found >= 0, FOUND, PRESENT)
    if found < 0:
        return 0
    targets.found_at[w, t] = now
    wp.atomic_add(latest.detections, w, found, 1)
    return 1


@part
def detect_together(
    w,
    now,
    flock: Flock,
    square: Floats,
    x: Floats,
    y: Floats,
    far: float,
    way: float,
    sensing,
    robots,
    targets,
    bins,
    latest,
) -> wp.vec2i:
    """Let robots detect targets that are at x, y now [m]; return how many wait on, and are in sight.

    `square` is of `nearest_sensors`, at the places before. No robot moves farther than `way` [m] in the step, and a
    robot that can have detected a target but is more than `far` [m] from it at the end is not in its list.
    """
    radius = sensing.radius
    sight = sensing.sight
    beyond = sight - radius
    before_x = flock.before_x
    before_y = flock.before_y
    near = Floats()
    for k in range(ABREAST):
        if k < width():
            across = x[k] - before_x[k]
            up = y[k] - before_y[k]
            near[k] = radius + wp.sqrt(across * across + up * up)
    comes_near = bool(False)
    for k in range(flock.count):
        comes_near = comes_near or square[k] < (near[k] + beyond) * (near[k] + beyond)
    # A target that was far from every sensor cannot have come into one's sight in this step.
    nearest = Ints()
    least = square
    if comes_near:
        nearest, least = nearest_sensors(w, flock.count, x, y, robots, bins)
    waiting = int(0)
    sighted = int(0)
    status = flock.status
    seen = Ints()
    asks = Ints()
    for k in range(ABREAST):
        if k < width():
            seen[k] = wp.where(least[k] < sight * sight, 1, 0)
            reach = near[k] + way
            met = wp.where(square[k] < reach * reach or reach > far, 1, 0)
            appears = wp.where(status[k] == HIDDEN, 1, 0)
            asks[k] = wp.where(status[k] == FOUND, 0, wp.where(least[k] < radius * radius, 1, 0) | met | appears)
    for k in range(flock.count):
        t = flock.number[k]
        targets.in_sight[w, t] = seen[k]
        sighted += seen[k]
        if seen[k] == 1 and bins.columns > 0:
            list_in_sight(w, t, wp.vec2(x[k], y[k]), bins)
        waiting += wp.where(flock.status[k] == FOUND, 0, 1)
        if asks[k] == 1:  # which is rare
            first = wp.vec2(-1.0, 2.0)
            if flock.status[k] == PRESENT:
                before = wp.vec2(flock.before_x[k], flock.before_y[k])
                first = first_sight(w, before, wp.vec2(x[k], y[k]), radius, near[k] + way, robots, bins)
            at_end = wp.vec2(float(nearest[k]), least[k])
            waiting -= detect(w, t, now, at_end, first, radius, targets, latest)
    return wp.vec2i(waiting, sighted)


@stage(
    TARGET,
    writes=(
        "bins: first_seen, seen, seen_used; latest: detections, in_sight, waiting; targets: before, "
        "found_at, found_early, heading, in_sight, position, status"
    ),
)
def move_and_detect(w, lane, lanes, curve, target, sensing, task, clock, robots, targets, latest, bins=OPTIONAL):
    """Remove detected targets, let others appear or move, and let the first robot that senses one detect it.

    A target appears at the end of its step: it is detected then or, on its way, from the next step on.
    """
    now = clock.step[w]
    key = randomness.step_key(clock.seed[w], now)
    way = max_displacement(w, robots)
    # A target that an extension moved farther than lists reach may have met any robot.
    far = wp.where(bins.columns > 0, bins.widened + way, 1.0e30)
    total = wp.vec2i(0, 0)
    end = targets.status.shape[1]
    t = int(lane)
    while t < end:
        number = Ints()
        count = int(0)
        while t < end and count < width():
            if targets.appears_at[w, t] > now:
                t = end  # the slots are in the order of their times
            else:
                status = targets.status[w, t]
                if target.leave == 1 and status == FOUND:
                    targets.status[w, t] = GONE
                    targets.in_sight[w, t] = 0
                elif status != GONE:
                    number[count] = t
                    count += 1
                t += lanes
        if count > 0:
            flock = gather(w, count, number, target, targets)
            nearest, square = nearest_sensors(w, count, flock.x, flock.y, robots, bins)
            x, y = move_together(w, key, flock, nearest, square, task.step, curve, target, robots, targets)
            total += detect_together(w, now, flock, square, x, y, far, way, sensing, robots, targets, bins, latest)
    if total[0] > 0:
        wp.atomic_add(latest.waiting, w, total[0])
    if total[1] > 0:
        wp.atomic_add(latest.in_sight, w, total[1])
