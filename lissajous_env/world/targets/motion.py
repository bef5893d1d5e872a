"""Targets: their positions, motions and times of appearance, and their motion in a step."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.curve import into_rectangle, wrap
from lissajous_env.device.stage import TARGET, WORLD, part, stage
from lissajous_env.device.structs import code_of
from lissajous_env.device.trig import PI, TWO_PI, atan2, cos_sin
from lissajous_env.settings.task import Targets as TargetSettings
from lissajous_env.world.state import DETECTED, HIDDEN, NEVER

wp.set_module_options(MOTION)

STILL = wp.constant(0)
DRIFTING = wp.constant(1)
WANDERING = wp.constant(2)
FLEEING = wp.constant(3)
CUSTOM = wp.constant(4)
"""Moved by an extension of the scenario, or by an adversary: `lissajous_env.world.rogues`."""

BOUNDARY = wp.constant(code_of(TargetSettings, "entry", "boundary"))
_HOTSPOTS = wp.constant(code_of(TargetSettings, "entry", "hotspots"))
_MIDDLE = wp.constant(0.85)
"""Share of the width and of the height in which hotspots are."""
_CLOSEST = wp.constant(0.05)
"""Distance below which the repulsion of robots and walls does not increase further [flee_radius]."""
_WALL = wp.constant(0.5)
"""Weight of a wall relative to that of a robot at the same distance."""


@part
def boundary_point(curve, share: float) -> wp.vec2:
    """Return the point at a share in [0, 1) of the boundary, counter-clockwise from the lower right corner [m]."""
    width = curve.half_width
    height = curve.half_height
    along = share * 4.0 * (width + height)
    if along < 2.0 * height:
        return wp.vec2(width, along - height)
    along -= 2.0 * height
    if along < 2.0 * width:
        return wp.vec2(width - along, height)
    along -= 2.0 * width
    if along < 2.0 * height:
        return wp.vec2(-width, height - along)
    return wp.vec2(along - 2.0 * height - width, -height)


@part
def hotspot(key, k: int, curve) -> wp.vec3:
    """Return x, y [m] and weight of hotspot k; `key` is that of step 0, so that hotspots stay for the episode."""
    draw = randomness.stream(key, k, randomness.HOTSPOT)
    x = _MIDDLE * (2.0 * wp.randf(draw) - 1.0) * curve.half_width
    y = _MIDDLE * (2.0 * wp.randf(draw) - 1.0) * curve.half_height
    # The sum of two exponential variates is a gamma variate of shape 2.
    weight = -wp.log(1.0 - wp.randf(draw)) - wp.log(1.0 - wp.randf(draw))
    return wp.vec3(x, y, weight)


@part
def near_hotspot(key, share: float, offset: wp.vec2, curve, target) -> wp.vec2:
    """Return the point at an offset [m] from the hotspot that a share in [0, 1) of the sum of the weights selects."""
    total = float(0.0)
    for k in range(target.hotspots):
        total += hotspot(key, k, curve)[2]
    left = share * total
    chosen = int(0)
    for k in range(target.hotspots):
        if left >= 0.0:
            chosen = k
        left -= hotspot(key, k, curve)[2]
    place = hotspot(key, chosen, curve)
    return into_rectangle(wp.vec2(place[0], place[1]) + offset, curve)


@part
def draw_entry(w, t, key, draw: wp.uint32, curve, target, targets) -> wp.uint32:
    """Draw position and heading of a target that appears; return the next state of the generator `draw`."""
    x = (2.0 * wp.randf(draw) - 1.0) * curve.half_width
    y = (2.0 * wp.randf(draw) - 1.0) * curve.half_height
    place = wp.vec2(x, y)
    if target.entry == BOUNDARY:
        place = boundary_point(curve, wp.randf(draw))
    elif target.entry == _HOTSPOTS and wp.randf(draw) >= target.hotspot_uniform:
        share = wp.randf(draw)
        offset = target.hotspot_spread * wp.vec2(wp.randn(draw), wp.randn(draw))
        place = near_hotspot(key, share, offset, curve, target)
    targets.position[w, t] = place
    targets.before[w, t] = place
    targets.heading[w, t] = TWO_PI * wp.randf(draw)
    return draw


@stage(TARGET, writes="targets: before, heading, motion, position, speed")
def reset_targets(w, t, curve, target, clock, targets):
    """Draw position, heading and motion of every target; those of the start appear at step 0.

    With `targets.entry` = `unseen`, the position is drawn again when the target appears (`place_unseen`).
    """
    key = randomness.step_key(clock.seed[w], 0)
    draw = draw_entry(w, t, key, randomness.stream(key, t, randomness.ENTRY), curve, target, targets)
    share = wp.randf(draw)
    motion = int(STILL)
    if share < target.drifting:
        motion = DRIFTING
    elif share < target.drifting + target.wandering:
        motion = WANDERING
    elif share < target.drifting + target.wandering + target.fleeing:
        motion = FLEEING
    elif share < target.drifting + target.wandering + target.fleeing + target.custom:
        motion = CUSTOM
    targets.motion[w, t] = motion
    spread = (target.speed - target.speed_min) * randomness.uniform(key, t, randomness.SPEED)
    targets.speed[w, t] = target.speed_min + spread


@stage(
    TARGET,
    writes=(
        "targets: appears_at, before, earlier, earlier_longest, earlier_time, found_at, found_early, heading, "
        "position, status"
    ),
)
def respawn(w, t, curve, target, clock, targets):
    """Let each target that was detected in the previous step appear anew in this one."""
    if targets.status[w, t] == DETECTED:
        now = clock.step[w]
        time = float(targets.found_at[w, t] - targets.appears_at[w, t]) - targets.found_early[w, t]
        targets.earlier[w, t] += 1
        targets.earlier_time[w, t] += wp.float64(time)
        targets.earlier_longest[w, t] = wp.max(targets.earlier_longest[w, t], time)
        draw = randomness.stream(randomness.step_key(clock.seed[w], now), t, randomness.ENTRY)
        draw_entry(w, t, randomness.step_key(clock.seed[w], 0), draw, curve, target, targets)
        targets.status[w, t] = HIDDEN
        targets.appears_at[w, t] = now
        targets.found_at[w, t] = NEVER
        targets.found_early[w, t] = 0.0


@stage(WORLD, writes="targets: appears_at")
def reset_arrivals(w, target, task, clock, targets):
    """Draw the arrival times of the targets after those of the start, by a Poisson process."""
    draw = randomness.stream(randomness.step_key(clock.seed[w], 0), 0, randomness.ARRIVAL)
    time = float(0.0)
    for t in range(target.count, targets.status.shape[1]):
        time -= wp.log(1.0 - wp.randf(draw)) / target.arrival_rate
        targets.appears_at[w, t] = 1 + int(wp.min(time / task.step, 1.0e9))


@part
def bounce(x: float, y: float, heading: float, curve) -> wp.vec3:
    """Return x, y [m], heading [rad] of a target that the boundary of the rectangle reflects."""
    beyond_x = wp.abs(x) > curve.half_width
    beyond_y = wp.abs(y) > curve.half_height
    inside_x = wp.clamp(wp.sign(x) * 2.0 * curve.half_width - x, -curve.half_width, curve.half_width)
    inside_y = wp.clamp(wp.sign(y) * 2.0 * curve.half_height - y, -curve.half_height, curve.half_height)
    turned = wp.where(beyond_x, PI - heading, heading)
    turned = wp.where(beyond_y, -turned, turned)
    return wp.vec3(wp.where(beyond_x, inside_x, x), wp.where(beyond_y, inside_y, y), wrap(turned))


@part
def wander(
    t, key, motion: int, x: float, y: float, heading: float, speed: float, step: float, curve, target
) -> wp.vec3:
    """Return x, y [m], heading [rad] of a target after a step [s] of drift, or of a random walk, at a speed [m/s]."""
    # A uniform draw with the deviation of a normal one costs a third, and sums of draws are nearly normal.
    turn = target.turn_rate * wp.sqrt(3.0 * step) * (2.0 * randomness.uniform(key, t, randomness.WANDER) - 1.0)
    turned = wp.where(motion == DRIFTING, heading, heading + turn)
    distance = speed * step
    ahead = cos_sin(turned)
    return bounce(x + distance * ahead[0], y + distance * ahead[1], turned, curve)


@wp.func
def is_moved(motion: int) -> bool:
    """Return whether targets of this motion are moved by the simulation."""
    return motion != STILL and motion != CUSTOM


@part
def repulsion(distance: float, target) -> float:
    """Return the repulsion of a robot or wall at a distance [m]: 1 / distance, limited [1/m]."""
    return 1.0 / wp.max(distance, _CLOSEST * target.flee_radius)


@part
def away_from_all(w, place: wp.vec2, curve, target, robots) -> wp.vec2:
    """Return the direction of flight from all robots within `flee_radius` and from the walls, of any length."""
    x = repulsion(curve.half_width + place[0], target) - repulsion(curve.half_width - place[0], target)
    y = repulsion(curve.half_height + place[1], target) - repulsion(curve.half_height - place[1], target)
    force = _WALL * wp.vec2(x, y)
    for i in range(robots.sensor.shape[1]):
        away = place - robots.sensor[w, i]
        distance = wp.length(away)
        if distance < target.flee_radius:
            force += repulsion(distance, target) * wp.normalize(away)
    return force


@part
def flee(place: wp.vec2, away: wp.vec2, step: float, curve, target) -> wp.vec3:
    """Return x, y [m], heading [rad] of a target that flees for a step [s] in the direction `away`, of any length."""
    # A wall turns the flight along itself; it does not send the target back to the robot.
    fled = into_rectangle(place + target.flee_speed * step * wp.normalize(away), curve)
    return wp.vec3(fled[0], fled[1], atan2(away[1], away[0]))
