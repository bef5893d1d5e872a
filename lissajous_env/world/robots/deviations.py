"""Distances of the robots from the curve, and from their positions in the formation."""

import warp as wp

from lissajous_env.device.abreast import ABREAST, Floats, block_of, put_floats, put_vectors, width
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct, curve_parameter, lissajous, point2
from lissajous_env.device.part_structs import FormationStruct
from lissajous_env.device.trig import cos_sin
from lissajous_env.world.robots.distance import DistanceTable, curve_distances
from lissajous_env.world.robots.placing import places_of
from lissajous_env.world.state import Clock, Robots, StepEvents

wp.set_module_options(OPTIONS)


@wp.func
def own_distance(curve: CurveStruct, x: float, y: float, alpha: float, phase: wp.float64) -> float:
    """Return the distance of a place from the point of a Lissajous curve at a phase [m]."""
    point = lissajous(curve, curve_parameter(alpha, phase))
    return wp.length(wp.vec2(x - point[0], y - point[1]))


@wp.kernel
def find_deviations(
    begin: int,
    end: int,
    curve: CurveStruct,
    formation: FormationStruct,
    distances: DistanceTable,
    equilibrium: wp.array(dtype=wp.float64),
    clock: Clock,
    robots: Robots,
    latest: StepEvents,
):
    """Find each robot's distance from the curve and from its own point of it, and its phase from the equilibrium."""
    block = block_of(wp.tid(), begin, end, robots.status.shape[1], clock.active)
    if block.count == 0:
        return
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
    lateral = curve_distances(distances, curve, x, y, block.count)
    put_floats(block, block.active_mask, tracking, latest.tracking)
    put_floats(block, block.active_mask, lateral, latest.lateral)
    put_vectors(block, block.active_mask, phase_offset, cos_offset, sin_offset, latest.phase_offset)
