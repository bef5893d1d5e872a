"""The edge of the rectangle: who is outside, and who is removed for it. A wall stands in the motion of cars."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import RobotStruct, TaskStruct
from lissajous_env.device.structs import place_of
from lissajous_env.parameters.parts import Task
from lissajous_env.world.state import NOWHERE, REMOVED, Clock, Latest, Robots

wp.set_module_options(OPTIONS)

_REMOVE = wp.constant(place_of(Task, "boundary", "remove"))


@wp.kernel
def watch_boundary(
    first: int,
    lanes: int,
    curve: CurveStruct,
    robot: RobotStruct,
    task: TaskStruct,
    clock: Clock,
    robots: Robots,
    latest: Latest,
):
    """Note the robots whose whole body is outside the rectangle; remove them where `task.boundary` says so."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for i in range(lane, robots.status.shape[1], lanes):
        place = robots.position[w, i]
        beyond_x = wp.max(wp.abs(place[0]) - curve.half_width, 0.0)
        beyond_y = wp.max(wp.abs(place[1]) - curve.half_height, 0.0)
        beyond = beyond_x * beyond_x + beyond_y * beyond_y > robot.radius * robot.radius
        outside = beyond and robots.status[w, i] != REMOVED
        latest.outside[w, i] = wp.where(outside, 1, 0)
        if outside and task.boundary == _REMOVE:
            robots.status[w, i] = REMOVED
            robots.sensor[w, i] = wp.vec2(NOWHERE, NOWHERE)
            latest.terminated[w, i] = True
