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
def stop_at_wall(curve, radius: float, pose: wp.vec4) -> wp.vec4:
    """Return a body (x, y [m], heading [rad], speed [m/s]) moved back into the rectangle.

    The component of its velocity into a wall is lost; its heading is unchanged.
    """
    along = cos_sin(pose[2])
    x = wp.clamp(pose[0], radius - curve.half_width, curve.half_width - radius)
    y = wp.clamp(pose[1], radius - curve.half_height, curve.half_height - radius)
    forwards = wp.where(pose[3] < 0.0, -1.0, 1.0)
    along_x = wp.where((pose[0] - x) * along[0] * forwards > 0.0, 0.0, along[0])
    along_y = wp.where((pose[1] - y) * along[1] * forwards > 0.0, 0.0, along[1])
    share = wp.where(along_x == along[0] and along_y == along[1], 1.0, wp.length(wp.vec2(along_x, along_y)))
    return wp.vec4(x, y, pose[2], pose[3] * share)


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
    """Return x, y [m] and speed [m/s] of bodies that walls stop, as `stop_at_wall` does."""
    for k in range(abreast.ABREAST):
        if k < abreast.width():
            pose = stop_at_wall(curve, radius, wp.vec4(x[k], y[k], heading[k], speed[k]))
            x[k] = pose[0]
            y[k] = pose[1]
            speed[k] = pose[3]
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
