"""Starts with a headway: robots that would collide at once begin at another place."""

import warp as wp

from lissajous_env.device.approach import closest_approach
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import FormationStruct, RobotStruct
from lissajous_env.device.trig import cos_sin
from lissajous_env.world.robots.placing import begin_on_curve, start_phase
from lissajous_env.world.state import Clock, Robots, planar

wp.set_module_options(OPTIONS)

_DRAWS = wp.constant(100)
"""Displacements that are drawn for a robot at most; the last one remains."""


@wp.func
def collides_within(w: int, i: int, j: int, time: float, radius: float, robots: Robots) -> bool:
    """Return whether the bodies of two robots overlap within a time [s] if both go straight on, seen from above."""
    apart = planar(robots.position[w, i] - robots.position[w, j])
    velocity = robots.speed[w, i] * cos_sin(robots.heading[w, i]) - robots.speed[w, j] * cos_sin(robots.heading[w, j])
    return closest_approach(apart, apart + time * velocity) < 4.0 * radius * radius


@wp.kernel
def draw_apart(
    first: int,
    curve: CurveStruct,
    formation: FormationStruct,
    robot: RobotStruct,
    equilibrium: wp.array(dtype=wp.float64),
    displaced: wp.array(dtype=float),
    top_speeds: wp.array(dtype=float),
    clock: Clock,
    robots: Robots,
):
    """Draw the start of a robot again while it would collide with one of a smaller number within the headway."""
    w = first + wp.tid()
    if clock.active[w] == 0:
        return
    for i in range(1, robots.status.shape[1]):
        draw = int(0)
        j = int(0)
        while j < i and draw < _DRAWS:
            if collides_within(w, i, j, formation.start_headway, robot.radius, robots):
                draw += 1
                phase = start_phase(w, i, draw, formation, equilibrium, displaced, clock)
                begin_on_curve(w, i, phase, curve, formation, top_speeds, robots)
                j = 0
            else:
                j += 1
