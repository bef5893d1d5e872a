"""Motion of a block of robots on the ground: those that stand, walls in their way, and where they end."""

import warp as wp

from lissajous_env.device.abreast import (
    ABREAST,
    Block,
    Floats,
    put_floats,
    put_places,
    put_vectors,
    width,
)
from lissajous_env.device.curve import CurveStruct, wrap
from lissajous_env.world.robots.walls import stop_at_wall
from lissajous_env.world.state import Robots


@wp.func
def begin_track(block: Block, standing: int, x: Floats, y: Floats, robots: Robots):
    """Begin the track of a step, and store that of robots which stand, with a speed of 0."""
    if standing != 0:
        put_floats(block, standing, Floats(), robots.speed)
        for s in range(1, robots.track.shape[2]):
            put_places(block, standing, x, y, s, robots.track)
    put_places(block, block.active_mask, x, y, 0, robots.track)


@wp.func
def stop_at_walls(
    curve: CurveStruct, radius: float, x: Floats, y: Floats, heading: Floats, speed: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return x, y [m] and speed [m/s] of bodies that walls stop, as `stop_at_wall` does."""
    for k in range(ABREAST):
        if k < width():
            pose = stop_at_wall(curve, radius, wp.vec4(x[k], y[k], heading[k], speed[k]))
            x[k] = pose[0]
            y[k] = pose[1]
            speed[k] = pose[3]
    return x, y, speed


@wp.func
def end_motion(block: Block, moving: int, x: Floats, y: Floats, heading: Floats, speed: Floats, robots: Robots):
    """Store where robots are at the end of a step."""
    for k in range(ABREAST):
        if k < width():
            heading[k] = wrap(heading[k])
    put_vectors(block, moving, x, y, Floats(), robots.position)
    put_floats(block, moving, heading, robots.heading)
    put_floats(block, moving, speed, robots.speed)
