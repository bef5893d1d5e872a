"""Kernels that copy the results of a scenario's extensions, in the worlds that are active."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.stage import ROBOT, TARGET, WORLD, stage
from lissajous_env.parameters.extensions import LARGEST
from lissajous_env.world.state import GONE, HIDDEN, Clock, StepEvents, Targets
from lissajous_env.world.targets.motion import CUSTOM

wp.set_module_options(OPTIONS)

_LARGEST = wp.constant(LARGEST)


@wp.func
def or_zero(value: float) -> float:
    """Return the value, or 0 if it is not finite or too large: on a GPU, an error would have to be waited for."""
    return wp.where(wp.abs(value) <= _LARGEST, value, 0.0)


@stage(ROBOT, writes="latest: terms")
def take_term(
    w: int, i: int, term: int, weight: float, value: wp.array2d(dtype=float), clock: Clock, latest: StepEvents
):
    """Copy an extension's term among those of the reward."""
    latest.terms[w, i, term] = or_zero(weight * value[w, i])


@stage(ROBOT, writes="observation_out")
def take_entries(
    w: int,
    i: int,
    start: int,
    low: float,
    high: float,
    value: wp.array3d(dtype=float),
    clock: Clock,
    observation_out: wp.array3d(dtype=float),
):
    """Copy an extension's entries to the end of the rows."""
    for k in range(value.shape[2]):
        observation_out[w, i, start + k] = wp.clamp(or_zero(value[w, i, k]), low, high)


@stage(WORLD, writes="kept_out")
def keep_column(w: int, value: wp.array(dtype=wp.float64), clock: Clock, kept_out: wp.array2d(dtype=wp.float64)):
    """Update sum, largest, least and last of an extension's score column."""
    if clock.step[w] == 0:
        kept_out[w, 0] = wp.float64(0.0)
        kept_out[w, 1] = wp.float64(-wp.inf)
        kept_out[w, 2] = wp.float64(wp.inf)
        kept_out[w, 3] = wp.float64(wp.nan)
    else:
        latest = wp.where(wp.abs(value[w]) <= wp.float64(_LARGEST), value[w], wp.float64(0.0))
        kept_out[w, 0] += latest
        kept_out[w, 1] = wp.max(kept_out[w, 1], latest)
        kept_out[w, 2] = wp.min(kept_out[w, 2], latest)
        kept_out[w, 3] = latest


@stage(TARGET, writes="targets: heading, position")
def take_places(w: int, t: int, curve: CurveStruct, value: wp.array2d(dtype=wp.vec2), clock: Clock, targets: Targets):
    """Move the targets of an extension to their new positions."""
    stage = targets.stage[w, t]
    if targets.motion[w, t] == CUSTOM and stage != HIDDEN and stage != GONE:
        x = wp.clamp(value[w, t][0], -curve.half_width, curve.half_width)
        y = wp.clamp(value[w, t][1], -curve.half_height, curve.half_height)
        moved = wp.vec2(x, y) - targets.position[w, t]
        if wp.length_sq(moved) > 0.0:
            targets.heading[w, t] = wp.atan2(moved[1], moved[0])
        targets.position[w, t] = wp.vec2(x, y)
