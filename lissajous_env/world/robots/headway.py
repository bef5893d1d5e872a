"""Starts with a headway: a robot that would collide at once begins at another place."""

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
"""Displacements of a robot that are drawn at most; the last one remains."""


@wp.func
def collides_at_once(w: int, i: int, time: float, radius: float, places: wp.array(dtype=int), robots: Robots) -> bool:
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


@wp.kernel
def draw_apart(
    first: int,
    curve: CurveStruct,
    formation: FormationStruct,
    robot: RobotStruct,
    equilibrium: wp.array(dtype=wp.float64),
    displaced: wp.array(dtype=float),
    top_speeds: wp.array(dtype=float),
    places: wp.array(dtype=int),
    clock: Clock,
    robots: Robots,
):
    """Draw the start of a robot again while it would collide within the headway, one robot after another."""
    w = first + wp.tid()
    if clock.active[w] == 0:
        return
    for i in range(1, robots.status.shape[1]):
        for draw in range(1, _DRAWS):
            if not collides_at_once(w, i, formation.start_headway, robot.radius, places, robots):
                break
            phase = start_phase(w, i, draw, formation, equilibrium, displaced, clock)
            begin_on_curve(w, i, phase, curve, formation, top_speeds, robots)
