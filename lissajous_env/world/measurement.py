"""What robots measure of themselves."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.curve import CurveStruct, curve_parameter, project, wrap_phase
from lissajous_env.device.part_structs import FormationStruct, NoiseStruct
from lissajous_env.device.trig import cos_sin
from lissajous_env.world.robots.placing import LARGEST_CORRECTION
from lissajous_env.world.state import NOWHERE, REMOVED, WORKING, Clock, Robots

wp.set_module_options(MOTION)


@wp.kernel
def measure(
    first: int,
    lanes: int,
    begin: int,
    end: int,
    curve: CurveStruct,
    formation: FormationStruct,
    noise: NoiseStruct,
    clock: Clock,
    robots: Robots,
):
    """Let each robot measure its own pose and phase, and point its sensor; of a removed one stays what it last knew."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    now = clock.step[w]
    alpha = float(formation.alpha)
    for i in range(begin + lane, end, lanes):
        position = robots.position[w, i]
        status = robots.status[w, i]
        senses = status == WORKING
        robots.sensor[w, i] = wp.vec2(wp.where(senses, position[0], NOWHERE), wp.where(senses, position[1], NOWHERE))
        if now == 0 or status != REMOVED:
            pose = wp.vec4(position[0], position[1], robots.heading[w, i], robots.speed[w, i])
            phase = robots.phase[w, i]
            if noise.position > 0.0 or noise.heading > 0.0 or noise.speed > 0.0:
                draw = randomness.stream(randomness.step_key(clock.seed[w], now), i, randomness.MEASURE)
                pose[0] += noise.position * wp.randn(draw)
                pose[1] += noise.position * wp.randn(draw)
                pose[2] += noise.heading * wp.randn(draw)
                pose[3] += noise.speed * wp.randn(draw)
                gamma = curve_parameter(alpha, phase)
                seen = project(curve, wp.vec2(pose[0], pose[1]), gamma, LARGEST_CORRECTION)
                phase = wrap_phase(phase + wp.float64((seen - gamma) / alpha))
            robots.measured[w, i] = pose
            robots.measured_turn[w, i] = cos_sin(float(phase))
