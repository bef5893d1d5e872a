"""Targets where robots or targets are many: each asks the robots in the list of its bin, and threads share them.

The same numbers as those of `lissajous_env.world.targets.flock`, to the last bit.
"""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import SensingStruct, TargetStruct, TaskStruct
from lissajous_env.world.robots.bins import Bins, bin_of
from lissajous_env.world.robots.sight import first_sight, longest_way, nearest_sensor, share_until_sight
from lissajous_env.world.state import FOUND, GONE, HIDDEN, NOWHERE, PRESENT, Clock, Counted, Robots, Targets
from lissajous_env.world.targets.motion import CUSTOM, FLEEING, PLACES, STILL, add_counts, detect, flee, wander

wp.set_module_options(MOTION)


@wp.func
def nearest_listed(w: int, k: int, place: wp.vec2, robots: Robots, bins: Bins) -> wp.vec2:
    """`nearest_sensor` of the robots in the list of bin k."""
    nearest = int(0)
    least = float(1.0e30)
    entry = bins.entry[w, bins.first[w, k]]
    while entry[0] >= 0:
        i = entry[0]
        away = robots.sensor[w, i] - place
        square = wp.dot(away, away)
        if square < least or (square == least and i < nearest):
            least = square
            nearest = i
        entry = bins.entry[w, entry[1]]
    return wp.vec2(float(nearest), least)


@wp.func
def first_sight_listed(
    w: int, k: int, before: wp.vec2, after: wp.vec2, radius: float, robots: Robots, bins: Bins
) -> wp.vec2:
    """`first_sight` by the robots in the list of bin k."""
    finder = int(-1)
    least = float(2.0)
    entry = bins.entry[w, bins.first[w, k]]
    while entry[0] >= 0:
        i = entry[0]
        if robots.sensor[w, i][0] < NOWHERE:
            share = share_until_sight(w, i, before, after, radius, robots)
            if share < least or (share == least and i < finder):
                least = share
                finder = i
        entry = bins.entry[w, entry[1]]
    return wp.vec2(float(finder), least)


@wp.func
def see(w: int, t: int, part: int, begin: int, place: wp.vec2, bins: Bins):
    """List a target that is in sight, of the part whose first target is `begin`."""
    here = begin + wp.atomic_add(bins.seen_used, w, part, 1)
    after = wp.atomic_exch(bins.first_seen, w, part, bin_of(place, bins), here)
    bins.seen[w, here] = wp.vec4(place[0], place[1], float(t), float(after))


@wp.kernel
def place_unseen_listed(
    first: int,
    lanes: int,
    begin: int,
    end: int,
    curve: CurveStruct,
    sensing: SensingStruct,
    clock: Clock,
    robots: Robots,
    targets: Targets,
    bins: Bins,
):
    """Put each target that appears now at the first of some uniform random places that is unseen, or the last."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    now = clock.step[w]
    key = randomness.step_key(clock.seed[w], now)
    for t in range(begin + lane, end, lanes):
        if targets.appears_at[w, t] > now:
            break  # the slots are in the order of their times
        if targets.stage[w, t] == HIDDEN:
            draw = randomness.stream(key, t, randomness.UNSEEN)
            for _ in range(PLACES):
                x = (2.0 * wp.randf(draw) - 1.0) * curve.half_width
                y = (2.0 * wp.randf(draw) - 1.0) * curve.half_height
                place = wp.vec2(x, y)
                targets.position[w, t] = place
                nearest = nearest_listed(w, bin_of(place, bins), place, robots, bins)
                if nearest[1] >= sensing.radius * sensing.radius:
                    break


@wp.func
def look_around(w: int, k: int, moved_far: bool, place: wp.vec2, robots: Robots, bins: Bins) -> wp.vec2:
    """`nearest_sensor` as far as lists reach, from a place that is not far from bin k, or of any other place."""
    if moved_far:
        return nearest_sensor(w, place, robots)
    return nearest_listed(w, k, place, robots, bins)


@wp.func
def look_back(
    w: int, k: int, moved_far: bool, before: wp.vec2, place: wp.vec2, radius: float, robots: Robots, bins: Bins
) -> wp.vec2:
    """`first_sight` of a target that came from bin k."""
    if moved_far:
        reach = radius + wp.length(place - before) + longest_way(w, robots)
        return first_sight(w, before, place, radius, reach, robots)
    return first_sight_listed(w, k, before, place, radius, robots, bins)


@wp.kernel
def move_and_detect_listed(
    first: int,
    lanes: int,
    part: int,
    begin: int,
    end: int,
    curve: CurveStruct,
    target: TargetStruct,
    sensing: SensingStruct,
    task: TaskStruct,
    clock: Clock,
    robots: Robots,
    targets: Targets,
    bins: Bins,
    counted: Counted,
):
    """Let detected targets leave, others appear or move, and the first robot that meets one detect it."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    now, radius = clock.step[w], sensing.radius
    key = randomness.step_key(clock.seed[w], now)
    waiting = int(0)
    sighted = int(0)
    for t in range(begin + lane, end, lanes):
        if targets.appears_at[w, t] > now:
            break  # the slots are in the order of their times
        stage = targets.stage[w, t]
        if stage == FOUND and target.leave == 1:
            targets.stage[w, t] = GONE
            targets.in_sight[w, t] = 0
        elif stage != GONE:
            place = targets.position[w, t]
            motion = targets.motion[w, t]
            before = place
            moved_far = bool(False)
            if motion == CUSTOM:
                before = targets.before[w, t]
                targets.before[w, t] = place
                moved_far = wp.length(place - before) > bins.reach - radius
            k = bin_of(before, bins)
            alone = bins.entry[w, bins.first[w, k]][0] < 0 and not moved_far
            moves = stage != HIDDEN and motion != STILL and motion != CUSTOM
            nearest = wp.vec2(0.0, 1.0e30)
            if not alone and (motion == FLEEING or not moves):
                nearest = look_around(w, k, moved_far, place, robots, bins)
            if moves:
                moved = wander(t, key, motion, place[0], place[1], targets.heading[w, t], task.step, curve, target)
                if motion == FLEEING and nearest[1] < target.flee_radius * target.flee_radius:
                    moved = flee(place, robots.sensor[w, int(nearest[0])], task.step, curve, target)
                place = wp.vec2(moved[0], moved[1])
                targets.position[w, t] = place
                targets.heading[w, t] = moved[2]
                if not alone:
                    nearest = look_around(w, k, moved_far, place, robots, bins)
            seen = nearest[1] < radius * radius
            targets.in_sight[w, t] = wp.where(seen, 1, 0)
            if seen:
                sighted += 1
                see(w, t, part, begin, place, bins)
            if stage != FOUND:
                sight = wp.vec2(-1.0, 2.0)
                if stage == PRESENT and not alone:
                    sight = look_back(w, k, moved_far, before, place, radius, robots, bins)
                waiting += 1 - detect(w, t, now, part, nearest, sight, radius, targets, counted)
    add_counts(w, part, waiting, sighted, counted)
