"""Measurements that robots make of themselves."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.abreast import (
    ABREAST,
    Floats,
    block_of,
    floats,
    is_in,
    put_fours,
    put_pairs,
    where_equal,
    where_world,
    width,
)
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.curve import CurveStruct, curve_parameter, project, wrap_phase
from lissajous_env.device.part_structs import FormationStruct, NoiseStruct
from lissajous_env.device.trig import cos_sin
from lissajous_env.world.robots.placing import LARGEST_CORRECTION, places_of
from lissajous_env.world.state import NOWHERE, REMOVED, WORKING, Clock, Robots

wp.set_module_options(MOTION)


@wp.func
def disturb(
    draw: wp.uint32, alpha: float, curve: CurveStruct, noise: NoiseStruct, pose: wp.vec4, phase: wp.float64
) -> tuple[wp.vec4, wp.float64]:
    """Add noise to a pose (x, y [m], heading [rad], speed [m/s]) and a phase [rad]."""
    pose[0] += noise.position * wp.randn(draw)
    pose[1] += noise.position * wp.randn(draw)
    pose[2] += noise.heading * wp.randn(draw)
    pose[3] += noise.speed * wp.randn(draw)
    gamma = curve_parameter(alpha, phase)
    seen = project(curve, wp.vec2(pose[0], pose[1]), gamma, LARGEST_CORRECTION)
    return pose, wrap_phase(phase + wp.float64((seen - gamma) / alpha))


@wp.kernel
def measure(
    begin: int,
    end: int,
    curve: CurveStruct,
    formation: FormationStruct,
    noise: NoiseStruct,
    clock: Clock,
    robots: Robots,
):
    """Measure each robot's pose and phase, and place its sensor; measurements of a removed robot are frozen."""
    n = robots.status.shape[1]
    block = block_of(wp.tid(), begin, end, n, clock.active)
    if block.count == 0:
        return
    alpha = float(formation.alpha)
    x, y, phase = places_of(block, robots)
    heading = floats(block, robots.heading)
    speed = floats(block, robots.speed)
    working = block.active_mask & where_equal(block, robots.status, WORKING)
    sensor_x = Floats()
    sensor_y = Floats()
    for k in range(ABREAST):
        if k < width():
            senses = is_in(k, working)
            sensor_x[k] = wp.where(senses, x[k], NOWHERE)
            sensor_y[k] = wp.where(senses, y[k], NOWHERE)
    put_pairs(block, block.active_mask, sensor_x, sensor_y, robots.sensor)
    measuring = block.active_mask & ~(where_equal(block, robots.status, REMOVED) & where_world(block, n, clock.step, 1))
    if noise.position > 0.0 or noise.heading > 0.0 or noise.speed > 0.0:
        for k in range(block.count):
            if is_in(k, measuring):
                w = (block.start + k) / n
                key = randomness.step_key(clock.seed[w], clock.step[w])
                draw = randomness.stream(key, (block.start + k) % n, randomness.MEASURE)
                pose, seen = disturb(draw, alpha, curve, noise, wp.vec4(x[k], y[k], heading[k], speed[k]), phase[k])
                x[k] = pose[0]
                y[k] = pose[1]
                heading[k] = pose[2]
                speed[k] = pose[3]
                phase[k] = seen
    cos_phase = Floats()
    sin_phase = Floats()
    cos_heading = Floats()
    sin_heading = Floats()
    for k in range(ABREAST):
        if k < width():
            turn = cos_sin(float(phase[k]))
            cos_phase[k] = turn[0]
            sin_phase[k] = turn[1]
            faces = cos_sin(heading[k])
            cos_heading[k] = faces[0]
            sin_heading[k] = faces[1]
    put_fours(block, measuring, x, y, heading, speed, robots.measured)
    put_fours(block, measuring, cos_phase, sin_phase, cos_heading, sin_heading, robots.measured_turn)
