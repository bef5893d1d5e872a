"""Robots outside the rectangle, and their removal. The wall is part of the motion of cars."""

import warp as wp

from lissajous_env.device.abreast import (
    ABREAST,
    block_of,
    coordinates,
    is_in,
    put_bits,
    where_above,
    where_equal,
    width,
)
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import RobotStruct, TaskStruct
from lissajous_env.device.structs import place_of
from lissajous_env.settings.task import Task
from lissajous_env.world.state import NOWHERE, REMOVED, Clock, Robots, StepEvents

wp.set_module_options(OPTIONS)

_REMOVE = wp.constant(place_of(Task, "boundary", "remove"))


@wp.kernel
def watch_boundary(
    begin: int,
    end: int,
    curve: CurveStruct,
    robot: RobotStruct,
    task: TaskStruct,
    clock: Clock,
    robots: Robots,
    latest: StepEvents,
):
    """Mark the robots whose whole body is outside the rectangle; remove them if `task.boundary` is `remove`."""
    n = robots.status.shape[1]
    block = block_of(wp.tid(), begin, end, n, clock.active)
    if block.count == 0:
        return
    beyond = coordinates(block, robots.position, 0)
    y = coordinates(block, robots.position, 1)
    for k in range(ABREAST):
        if k < width():
            beyond_x = wp.max(wp.abs(beyond[k]) - curve.half_width, 0.0)
            beyond_y = wp.max(wp.abs(y[k]) - curve.half_height, 0.0)
            beyond[k] = beyond_x * beyond_x + beyond_y * beyond_y
    outside = where_above(block, beyond, robot.radius * robot.radius) & ~where_equal(block, robots.status, REMOVED)
    put_bits(block, block.active_mask, outside, latest.outside)
    if task.boundary == _REMOVE:
        for k in range(block.count):
            if is_in(k, outside & block.active_mask):
                w = (block.start + k) / n
                i = (block.start + k) % n
                robots.status[w, i] = REMOVED
                robots.sensor[w, i] = wp.vec2(NOWHERE, NOWHERE)
                latest.terminated[w, i] = True
