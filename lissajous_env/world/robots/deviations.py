"""Robots off the rectangle, and their removal; distances from the curve, and from the positions in the formation."""

import warp as wp

from lissajous_env.device.abreast import (
    ABREAST,
    Block,
    Floats,
    coordinates,
    is_in,
    put_bits,
    put_floats,
    put_vectors,
    where_above,
    where_equal,
    width,
)
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct, curve_parameter, lissajous, point2
from lissajous_env.device.part_structs import FormationStruct, RobotStruct, TaskStruct
from lissajous_env.device.stage import ROBOT, stage
from lissajous_env.device.structs import place_of
from lissajous_env.device.trig import cos_sin
from lissajous_env.settings.task import Task
from lissajous_env.world.robots.distance import CurvePoints, curve_distances
from lissajous_env.world.robots.placing import places_of
from lissajous_env.world.state import NOWHERE, REMOVED, Clock, Robots, StepEvents

wp.set_module_options(OPTIONS)

_REMOVE = wp.constant(place_of(Task, "boundary", "remove"))


@stage(ROBOT, writes="latest: outside, terminated; robots: sensor, status")
def watch_boundary(
    block: Block,
    curve: CurveStruct,
    robot: RobotStruct,
    task: TaskStruct,
    clock: Clock,
    robots: Robots,
    latest: StepEvents,
):
    """Mark the robots whose whole body is outside the rectangle; remove them if `task.boundary` is `remove`."""
    n = robots.status.shape[1]
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


@wp.func
def own_distance(curve: CurveStruct, x: float, y: float, alpha: float, phase: wp.float64) -> float:
    """Return the distance of a place from the point of a Lissajous curve at a phase [m]."""
    point = lissajous(curve, curve_parameter(alpha, phase))
    return wp.length(wp.vec2(x - point[0], y - point[1]))


@stage(ROBOT, writes="latest: lateral, phase_offset, tracking")
def find_deviations(
    block: Block,
    curve: CurveStruct,
    formation: FormationStruct,
    curve_points: CurvePoints,
    equilibrium: wp.array(dtype=wp.float64),
    clock: Clock,
    robots: Robots,
    latest: StepEvents,
):
    """Find each robot's distance from the curve and from its own point of it, and its phase from the equilibrium."""
    alpha = float(formation.alpha)
    x, y, phase = places_of(block, robots)
    phase_offset = Floats()
    cos_offset = Floats()
    sin_offset = Floats()
    tracking = Floats()
    i = int(block.start % robots.status.shape[1])
    for k in range(block.count):
        phase_offset[k] = float(phase[k] - equilibrium[i])
        i = wp.where(i + 1 == robots.status.shape[1], 0, i + 1)
    if curve.harmonics.shape[0] == 0:
        for k in range(ABREAST):
            if k < width():
                tracking[k] = own_distance(curve, x[k], y[k], alpha, phase[k])
    else:
        for k in range(block.count):
            tracking[k] = wp.length(wp.vec2(x[k], y[k]) - point2(curve, curve_parameter(alpha, phase[k])))
    for k in range(ABREAST):
        if k < width():
            turn = cos_sin(phase_offset[k])
            cos_offset[k] = turn[0]
            sin_offset[k] = turn[1]
    lateral = curve_distances(curve_points, curve, x, y, block.count)
    put_floats(block, block.active_mask, tracking, latest.tracking)
    put_floats(block, block.active_mask, lateral, latest.lateral)
    put_vectors(block, block.active_mask, phase_offset, cos_offset, sin_offset, latest.phase_offset)
