"""Phases of robots along the curve: at the beginning of an episode, and as they move beside it."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.abreast import (
    ABREAST,
    Block,
    Doubles,
    Floats,
    coordinates,
    doubles,
    put_doubles,
    where_equal,
    width,
)
from lissajous_env.device.approach import closest_approach
from lissajous_env.device.compilation import MOTION, OPTIONS, module_apart
from lissajous_env.device.curve import (
    curve_parameter,
    point,
    project,
    project_lissajous,
    tangent2,
    wrap_phase,
)
from lissajous_env.device.stage import ROBOT, WORLD, part, stage
from lissajous_env.device.structs import place_of
from lissajous_env.device.trig import cos_sin
from lissajous_env.settings.parts import Formation
from lissajous_env.world.robots.faults import rolling
from lissajous_env.world.state import REMOVED, WORKING, planar

wp.set_module_options(MOTION)
_HEADWAY = module_apart(f"{__name__}.headway", OPTIONS)

LARGEST_CORRECTION = wp.constant(0.1)
"""Limit of a correction of a robot's parameter on the curve [rad]: it may slide along its branch, not jump."""

ROTATED = wp.constant(place_of(Formation, "start", "rotated"))
RANDOM = wp.constant(place_of(Formation, "start", "random"))

_DRAWS = wp.constant(100)
"""Displacements of a robot that are drawn at most; the last one remains."""


@part
def place_on_curve(w, i, rate: float, curve, alpha: float, robots):
    """Place a robot at the point of its phase, heading along the curve at phase rate `rate` [rad/s]."""
    gamma = curve_parameter(alpha, robots.phase[w, i])
    tangent = tangent2(curve, gamma) * (alpha * rate)
    robots.position[w, i] = point(curve, gamma)
    robots.speed[w, i] = wp.length(tangent)
    if rate != 0.0:
        robots.heading[w, i] = wp.atan2(tangent[1], tangent[0])


@part
def start_phase(w, i, draw: int, formation, equilibrium, displaced, clock) -> wp.float64:
    """Return the phase of a robot at reset [rad]; each `draw`, counted from 0, has a random displacement of its own."""
    phase = equilibrium[i] + wp.float64(displaced[i])
    if formation.start == ROTATED:  # the same turn for every robot
        turn = randomness.stream(randomness.step_key(clock.seed[w], 0), -1, randomness.START)
        phase += wp.float64(6.2831853 * wp.randf(turn))
    own = randomness.stream(randomness.step_key(clock.seed[w], -draw), i, randomness.START)
    if formation.start == RANDOM:
        phase = wp.float64(6.2831853 * wp.randf(own))
    phase += wp.float64(formation.start_noise * wp.randn(own))
    return wrap_phase(phase)


@part
def begin_on_curve(w, i, phase: wp.float64, curve, formation, top_speeds, robots):
    """Put a robot on the curve at a phase [rad], at the formation's speed or its own top speed if that is lower."""
    alpha = float(formation.alpha)
    robots.phase[w, i] = phase
    place_on_curve(w, i, formation.phase_rate / alpha, curve, alpha, robots)
    robots.speed[w, i] = wp.max(wp.min(robots.speed[w, i], top_speeds[i]), 0.0)
    for s in range(robots.track.shape[2]):
        robots.track[w, i, s] = robots.position[w, i]


@part
def places_of(block: Block, robots) -> tuple[Floats, Floats, Doubles]:
    """Return x, y [m] and phase [rad] of the robots of a block."""
    x = coordinates(block, robots.position, 0)
    y = coordinates(block, robots.position, 1)
    return x, y, doubles(block, robots.phase)


@stage(ROBOT, writes="robots: phase")
def follow_curve(block, curve, formation, faults, clock, robots):
    """Let the phase of a robot that is not bound to the curve follow it along its branch."""
    alpha = float(formation.alpha)
    x, y, phase = places_of(block, robots)
    if curve.harmonics.shape[0] == 0:
        for k in range(ABREAST):
            if k < width():
                start = curve_parameter(alpha, phase[k])
                gamma = project_lissajous(curve, x[k], y[k], start, LARGEST_CORRECTION)
                phase[k] = wrap_phase(phase[k] + wp.float64((gamma - start) / alpha))
    else:
        for k in range(block.count):
            start = curve_parameter(alpha, phase[k])
            gamma = project(curve, wp.vec2(x[k], y[k]), start, LARGEST_CORRECTION)
            phase[k] = wrap_phase(phase[k] + wp.float64((gamma - start) / alpha))
    moving = where_equal(block, robots.status, WORKING) | rolling(block, faults, robots)
    put_doubles(block, block.active_mask & moving, phase, robots.phase)


@stage(
    ROBOT,
    writes="robots: drive, heading, phase, position, speed, status, track, wheelbase",
)
def reset_robots(
    w, i, curve, formation, robot, noise, equilibrium, displaced, drive_factors, top_speeds, clock, robots
):
    """Place the robots on the curve at the formation's speed or their top speed, and draw each one's own constants."""
    key = randomness.step_key(clock.seed[w], 0)
    phase = start_phase(w, i, 0, formation, equilibrium, displaced, clock)
    begin_on_curve(w, i, phase, curve, formation, top_speeds, robots)
    robots.status[w, i] = wp.where(robots.removed_at[w, i] < 1, REMOVED, WORKING)
    body = randomness.stream(key, i, randomness.BODY)
    # A spread is clipped at three deviations, so that no car has a wheelbase of zero.
    robots.wheelbase[w, i] = robot.wheelbase * (1.0 + noise.wheelbase_spread * wp.clamp(wp.randn(body), -3.0, 3.0))
    drive = robot.drive * drive_factors[i]
    robots.drive[w, i] = drive * (1.0 + noise.drive_spread * wp.clamp(wp.randn(body), -3.0, 3.0))


@part
def collides_at_once(w, i, time: float, radius: float, places, robots) -> bool:
    """Return whether a robot collides within a time [s] with one of a smaller number if all go straight on.

    Positions and velocities are those in the plane. Robots of one of `places` overlap by design: `Scenario.places`.
    """
    velocity = robots.speed[w, i] * cos_sin(robots.heading[w, i])
    for j in range(i):
        apart = planar(robots.position[w, i] - robots.position[w, j])
        parting = velocity - robots.speed[w, j] * cos_sin(robots.heading[w, j])
        if places[i] != places[j] and closest_approach(apart, apart + time * parting) < 4.0 * radius * radius:
            return True
    return False


@stage(WORLD, writes="robots: heading, phase, position, speed, track", module=_HEADWAY)
def draw_apart(w, curve, formation, robot, equilibrium, displaced, top_speeds, places, clock, robots):
    """Draw the start of a robot again while it would collide within the headway, one robot after another."""
    for i in range(1, robots.status.shape[1]):
        for draw in range(1, _DRAWS):
            if not collides_at_once(w, i, formation.start_headway, robot.radius, places, robots):
                break
            phase = start_phase(w, i, draw, formation, equilibrium, displaced, clock)
            begin_on_curve(w, i, phase, curve, formation, top_speeds, robots)
