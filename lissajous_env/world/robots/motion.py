"""Motion of robots in the plane within a step: its path, and walls that stop bodies."""

import warp as wp

from lissajous_env.device import abreast
from lissajous_env.device.abreast import Floats
from lissajous_env.device.curve import wrap
from lissajous_env.device.stage import part
from lissajous_env.device.structs import code_of
from lissajous_env.device.trig import cos_sin
from lissajous_env.settings.task import Task

WALL = wp.constant(code_of(Task, "boundary", "wall"))


@part
def begin_path(block, standing: int, x: Floats, y: Floats, robots):
    """Store the first position of each robot's path in a step, and the whole path of `standing` robots, at speed 0."""
    if standing != 0:
        abreast.put_floats(block, standing, Floats(), robots.speed)
        for s in range(1, robots.path.shape[2]):
            abreast.put_places(block, standing, x, y, s, robots.path)
    abreast.put_places(block, block.active_mask, x, y, 0, robots.path)


@part
def stop_at_walls(
    curve, radius: float, x: Floats, y: Floats, heading: Floats, speed: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return x, y [m] and speed [m/s] of bodies that are moved back into the rectangle.

    The component of a velocity into a wall is lost; headings are unchanged.
    """
    for k in range(abreast.ABREAST):
        if k < abreast.width():
            along = cos_sin(heading[k])
            inside_x = wp.clamp(x[k], radius - curve.half_width, curve.half_width - radius)
            inside_y = wp.clamp(y[k], radius - curve.half_height, curve.half_height - radius)
            forwards = wp.where(speed[k] < 0.0, -1.0, 1.0)
            along_x = wp.where((x[k] - inside_x) * along[0] * forwards > 0.0, 0.0, along[0])
            along_y = wp.where((y[k] - inside_y) * along[1] * forwards > 0.0, 0.0, along[1])
            is_free = along_x == along[0] and along_y == along[1]
            speed[k] = speed[k] * wp.where(is_free, 1.0, wp.length(wp.vec2(along_x, along_y)))
            x[k] = inside_x
            y[k] = inside_y
    return x, y, speed


@part
def end_motion(block, moving: int, x: Floats, y: Floats, heading: Floats, speed: Floats, robots):
    """Store position, heading and speed of the `moving` robots at the end of a step."""
    for k in range(abreast.ABREAST):
        if k < abreast.width():
            heading[k] = wrap(heading[k])
    abreast.put_vectors(block, moving, x, y, Floats(), robots.position)
    abreast.put_floats(block, moving, heading, robots.heading)
    abreast.put_floats(block, moving, speed, robots.speed)
