"""Detection of targets: they appear, move, and are detected by the first working robot that has them in its disc.

A target is in sight of each working robot that has it within `sensing.sight` at the end of a step. Within a step it
goes straight from its old place to its new one at one speed, past the robots, each of which goes along its path of
sub-steps.

The targets of a world are processed in groups, so that loops over a group become SIMD. With many robots, bins select
the robots near a target, with the same result to the last bit.
"""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.abreast import ABREAST, Floats, Ints, width
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.stage import TARGET, part, stage
from lissajous_env.device.structs import code_of
from lissajous_env.settings.task import Targets as TargetSettings
from lissajous_env.world.robots.nearby import Bins, bin_of, has_lists, max_displacement, nearest_sensors
from lissajous_env.world.state import DETECTED, GONE, HIDDEN, NOWHERE, PRESENT, planar
from lissajous_env.world.targets.motion import CUSTOM, FLEEING, STILL, away_from_all, flee, is_moved, wander

wp.set_module_options(MOTION)

TRIES = wp.constant(64)
"""Number of positions that are tried for a target that appears outside all discs."""
_FROM_ALL = wp.constant(code_of(TargetSettings, "flight", "all"))


@wp.func
def first_within(before: wp.vec2, after: wp.vec2, radius: float) -> float:
    """Return the smallest t in [0, 1] with |before + t (after - before)| <= radius [m]; 2 for none.

    `before` and `after` are the offset of two points at the two ends of a stretch of time, at equal speeds within it.
    """
    outside = wp.dot(before, before) - radius * radius
    if outside <= 0.0:
        return 0.0
    moved = after - before
    nearing = -wp.dot(before, moved)
    root = nearing * nearing - wp.dot(moved, moved) * outside
    if nearing <= 0.0 or root < 0.0:
        return 2.0
    # The smaller root of a quadratic equation, written without a difference of numbers that are nearly equal.
    t = outside / (nearing + wp.sqrt(root))
    return wp.where(t <= 1.0, t, 2.0)


@part
def share_until_detection(w, i, before: wp.vec2, after: wp.vec2, radius: float, robots) -> float:
    """Return the share of the step until a robot detects a target that moves as in `first_detection`; 2 for never."""
    pieces = robots.path.shape[2] - 1
    moved = (after - before) / float(pieces)
    start = before - planar(robots.path[w, i, 0])
    for s in range(pieces):
        end = before + float(s + 1) * moved - planar(robots.path[w, i, s + 1])
        share = first_within(start, end, radius)
        if share <= 1.0:
            return (float(s) + share) / float(pieces)
        start = end
    return 2.0


@part
def first_detection(
    w, before: wp.vec2, after: wp.vec2, radius: float, farthest: float, has_list: bool, robots, bins
) -> wp.vec2:
    """Return (index of the robot that first has a target in its disc, share of the step until then; 2 for none).

    The target goes straight from `before` to `after` [m], also if a wall reflected it in between. Robots that end the
    step farther than `farthest` [m] from `after` are skipped, and so are those that do not work. A robot that resumes
    works from the beginning of that step on. If the target `has_list`, robots are those in the list of the bin in which
    it was.
    """
    first = int(-1)
    least = float(2.0)
    if has_list:
        entry = bins.first[w, bin_of(before, bins)]
        while entry >= 0:
            i = bins.entry[w, entry][0]
            if robots.sensor[w, i][0] < NOWHERE:
                share = share_until_detection(w, i, before, after, radius, robots)
                if share < least or (share == least and i < first):
                    least = share
                    first = i
            entry = bins.entry[w, entry][1]
    else:
        for i in range(robots.sensor.shape[1]):
            if wp.length_sq(robots.sensor[w, i] - after) < farthest * farthest:
                share = share_until_detection(w, i, before, after, radius, robots)
                if share < least:
                    least = share
                    first = i
    return wp.vec2(float(first), least)


@wp.func
def list_in_sight(w: int, t: int, place: wp.vec2, bins: Bins):
    """List a target that is in sight, for the robots that observe it."""
    here = wp.atomic_add(bins.targets_used, w, 1)
    after = wp.atomic_exch(bins.first_target, w, bin_of(place, bins), here)
    bins.target_entry[w, here] = wp.vec4(place[0], place[1], float(t), float(after))


@stage(TARGET, writes="targets: position")
def place_unseen(w, lane, lanes, curve, sensing, clock, robots, targets, bins):
    """Put targets that appear now at the first of 64 random positions outside all sensing discs, or at the last."""
    now = clock.step[w]
    key = randomness.step_key(clock.seed[w], now)
    for t in range(lane, targets.status.shape[1], lanes):
        if targets.appears_at[w, t] > now:
            break  # the slots are in the order of their times
        if targets.status[w, t] == HIDDEN:
            draw = randomness.stream(key, t, randomness.UNSEEN)
            for _ in range(TRIES):
                x = (2.0 * wp.randf(draw) - 1.0) * curve.half_width
                y = (2.0 * wp.randf(draw) - 1.0) * curve.half_height
                targets.position[w, t] = wp.vec2(x, y)
                _nearest, square = nearest_sensors(w, 1, Floats(x), Floats(y), robots, bins)
                if square[0] >= sensing.radius * sensing.radius:
                    break


@wp.struct
class TargetGroup:
    """A group of targets of a world, of which loops process all together."""

    count: wp.int32
    number: Ints
    """Their slots."""
    status: Ints
    motion: Ints
    """STILL for a hidden target."""
    before_x: Floats
    before_y: Floats
    """Position at the beginning of the step [m]."""
    x: Floats
    y: Floats
    """Position before `move_together` [m]: that at the beginning, unless an extension or an adversary has moved it."""
    heading: Floats
    speed: Floats
    """Speed of a target while it does not flee [m/s]."""


@part
def gather(w, count: int, number: Ints, target, targets) -> TargetGroup:
    """Return the group of `count` targets, whose slots are `number`.

    Targets that an extension or an adversary moves have already moved in this step: their position before it is read
    from `targets.before`, where the present one replaces it.
    """
    group = TargetGroup()
    group.count = count
    group.number = number
    for k in range(count):
        t = number[k]
        place = targets.position[w, t]
        group.status[k] = targets.status[w, t]
        group.motion[k] = targets.motion[w, t]
        group.x[k] = place[0]
        group.y[k] = place[1]
        group.heading[k] = targets.heading[w, t]
        group.speed[k] = target.speed
        if target.speed_min < target.speed:
            group.speed[k] = targets.speed[w, t]
        before = place
        if targets.motion[w, t] == CUSTOM:
            before = targets.before[w, t]
            targets.before[w, t] = place
        group.before_x[k] = before[0]
        group.before_y[k] = before[1]
        if targets.status[w, t] == HIDDEN:
            group.motion[k] = STILL
    return group


@part
def move_together(
    w, key, group: TargetGroup, nearest_robot: Ints, square: Floats, step: float, curve, target, robots, targets
) -> tuple[Floats, Floats]:
    """Move a group of targets over a step [s]; return their new x, y [m].

    `nearest_robot` and `square` are the results of `nearest_sensors` at `group.x`, `group.y`.
    """
    # Copies: a loop over the fields of a struct does not become SIMD.
    number = group.number
    motion = group.motion
    x = group.x
    y = group.y
    heading = group.heading
    speed = group.speed
    for k in range(ABREAST):
        if k < width():
            moved = wander(number[k], key, motion[k], x[k], y[k], heading[k], speed[k], step, curve, target)
            x[k] = wp.where(is_moved(motion[k]), moved[0], x[k])
            y[k] = wp.where(is_moved(motion[k]), moved[1], y[k])
            heading[k] = moved[2]
    for k in range(group.count):
        if square[k] < target.flee_radius * target.flee_radius and group.motion[k] == FLEEING:
            place = wp.vec2(group.x[k], group.y[k])
            away = place - robots.sensor[w, nearest_robot[k]]
            if target.flight == _FROM_ALL:
                away = away_from_all(w, place, curve, target, robots)
            fled = flee(place, away, step, curve, target)
            x[k] = fled[0]
            y[k] = fled[1]
            heading[k] = fled[2]
        if is_moved(group.motion[k]):
            targets.position[w, group.number[k]] = wp.vec2(x[k], y[k])
            targets.heading[w, group.number[k]] = heading[k]
    return x, y


@part
def detect(w, t, now, at_end: wp.vec2, first: wp.vec2, radius: float, targets, latest) -> int:
    """Let a robot detect a target: the first one during the step or, without any, the nearest one at its end.

    `at_end` is the result of `nearest_sensors` at the end, and `first` that of `first_detection`. Returns 1 for a
    detection, else 0.
    """
    robot = wp.where(at_end[1] < radius * radius, int(at_end[0]), -1)
    if first[1] <= 1.0:
        robot = int(first[0])
        targets.found_early[w, t] = 1.0 - first[1]
    targets.status[w, t] = wp.where(robot >= 0, DETECTED, PRESENT)
    if robot < 0:
        return 0
    targets.found_at[w, t] = now
    wp.atomic_add(latest.detections, w, robot, 1)
    return 1


@part
def detect_together(
    w,
    now,
    group: TargetGroup,
    square: Floats,
    x: Floats,
    y: Floats,
    longest_listed: float,
    displacement: float,
    sensing,
    robots,
    targets,
    bins,
    latest,
) -> wp.vec2i:
    """Let robots detect the targets of a group, now at x, y [m]; return the numbers undetected and in sight.

    `square` are the squared distances of `nearest_sensors` at `group.x`, `group.y` [m^2]. No robot moves farther than
    `displacement` [m] in the step. Where the sensing radius and the displacement of a target add up to more than
    `longest_listed` [m], the lists of bins may lack robots that detected the target.
    """
    radius = sensing.radius
    sight = sensing.sight
    before_x = group.before_x
    before_y = group.before_y
    near = Floats()  # distance from both ends of a target's way within which a robot at rest may detect it [m]
    approached = int(0)  # number of targets that may have come into sight
    for k in range(ABREAST):
        if k < width():
            dx = x[k] - before_x[k]
            dy = y[k] - before_y[k]
            near[k] = radius + wp.sqrt(dx * dx + dy * dy)
            reach = near[k] + sight - radius
            approached += wp.where(k < group.count, wp.where(square[k] < reach * reach, 1, 0), 0)
    nearest = Ints()
    least = square
    if approached > 0:  # otherwise `square` shows, too, that no target is in sight
        nearest, least = nearest_sensors(w, group.count, x, y, robots, bins)
    waiting = int(0)
    sighted = int(0)
    status = group.status
    in_sight = Ints()
    is_candidate = Ints()
    for k in range(ABREAST):
        if k < width():
            in_sight[k] = wp.where(least[k] < sight * sight, 1, 0)
            reach = near[k] + displacement
            passed = wp.where(square[k] < reach * reach or near[k] > longest_listed, 1, 0)
            appears = wp.where(status[k] == HIDDEN, 1, 0)
            is_candidate[k] = wp.where(
                status[k] == DETECTED, 0, wp.where(least[k] < radius * radius, 1, 0) | passed | appears
            )
    for k in range(group.count):
        t = group.number[k]
        targets.in_sight[w, t] = in_sight[k]
        sighted += in_sight[k]
        if in_sight[k] == 1 and bins.columns > 0:
            list_in_sight(w, t, wp.vec2(x[k], y[k]), bins)
        waiting += wp.where(group.status[k] == DETECTED, 0, 1)
        if is_candidate[k] == 1:  # which is rare
            first = wp.vec2(-1.0, 2.0)
            if group.status[k] == PRESENT:
                before = wp.vec2(group.before_x[k], group.before_y[k])
                after = wp.vec2(x[k], y[k])
                has_list = near[k] <= longest_listed and has_lists(w, bins)
                first = first_detection(w, before, after, radius, near[k] + displacement, has_list, robots, bins)
            at_end = wp.vec2(float(nearest[k]), least[k])
            waiting -= detect(w, t, now, at_end, first, radius, targets, latest)
    return wp.vec2i(waiting, sighted)


@stage(
    TARGET,
    writes=(
        "bins: first_target, target_entry, targets_used; latest: detections, in_sight, waiting; targets: before, "
        "found_at, found_early, heading, in_sight, position, status"
    ),
)
def move_and_detect(w, lane, lanes, curve, target, sensing, task, clock, robots, targets, latest, bins):
    """Remove detected targets, let others appear or move, and let robots detect them.

    A target appears at the end of a step. It can be detected at that moment, and at any moment of the later steps.
    """
    now = clock.step[w]
    key = randomness.step_key(clock.seed[w], now)
    displacement = max_displacement(w, robots)
    # A target that an extension moved farther than lists reach may have passed any robot. Half of the margin of the
    # lists is for the rounding of a target that moves exactly as far.
    longest_listed = wp.where(has_lists(w, bins), 0.5 * (bins.reach + bins.widened), 1.0e30)
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
                if target.leave == 1 and status == DETECTED:
                    targets.status[w, t] = GONE
                    targets.in_sight[w, t] = 0
                elif status != GONE:
                    number[count] = t
                    count += 1
                t += lanes
        if count > 0:
            group = gather(w, count, number, target, targets)
            nearest, square = nearest_sensors(w, count, group.x, group.y, robots, bins)
            x, y = move_together(w, key, group, nearest, square, task.step, curve, target, robots, targets)
            total += detect_together(
                w, now, group, square, x, y, longest_listed, displacement, sensing, robots, targets, bins, latest
            )
    if total[0] > 0:
        wp.atomic_add(latest.waiting, w, total[0])
    if total[1] > 0:
        wp.atomic_add(latest.in_sight, w, total[1])
