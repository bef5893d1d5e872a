"""Contamination with bounds for `task.conservative`: no target stays undetected for longer than it reports.

A tick is P steps. A label L[n, c] is a lower bound: every target that is somewhere in cell c at the end of tick n, and
that no working robot has sensed until then, was introduced at the end of step L[n, c] or later. The proof is by
induction over steps. A target moves in any way at no more than the speed limit v, and D(c, c') is the least distance of
two cells.

* At the start, cells in which targets are introduced have label 0, and targets that are present came at step 0.
* A target that is in c' at the end of tick n, and was present k ticks ago, was in a cell c with D(c, c') <= k P v dt.
  It was undetected at that time, so L[n - k, c] applies to it. So for each k, the least L[n - k, c] of these cells is a
  bound, and so is the largest of these bounds.
* A target that came since then was introduced in a cell where targets are introduced, at most k P v dt away. A
  target that is introduced in tick n - k is treated as present since that tick. This is safe: the bound covers every
  place that it can reach. Targets that came later came at the end of step (n - k + 1) P - 1 or later, which enters the
  bound of the lag k of cells that are so near.
* In the steps s = 1 ... P - 1 between two ticks, labels stay with the cell in which a target was in the tick before. It
  is within s v dt of that cell. If a disc covers the cell and a margin of that width, the target has been sensed, and
  the label is deleted; for s = 0, the disc must cover the cell. A target that comes between two ticks counts, as above,
  from the tick before, with the step before its introduction as its label.
* Sensing between the ends of steps is ignored, and so are cells that only several discs together cover. Both make
  labels older, never younger, so that they remain bounds.

A target that is undetected at the end of a step may be so until the end of the next one, so the largest age that is
stored is that at the end of the next step (`lissajous_env.world.contamination.field`).

`Contamination.labels` contains L times 256.
"""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.discs import columns_of, disc_run
from lissajous_env.device.stage import FIELD_ROW, part, stage
from lissajous_env.world.contamination.labels import MARGIN, NONE, PER_STEP
from lissajous_env.world.state import NEVER, NOWHERE
from lissajous_env.world.targets.motion import BOUNDARY

wp.set_module_options(OPTIONS)

_ROUNDING = wp.constant(1e-6)
"""Share of all lengths by which a disc is made smaller, because of the rounding of float32."""


@part
def is_near_entry(row, column, rows_away: int, columns_away: int, rows: int, columns: int, target) -> bool:
    """Return whether targets may be introduced in a cell at most so many rows and columns away."""
    if target.entry != BOUNDARY:
        return True
    near_row = row <= rows_away or row >= rows - 1 - rows_away
    return near_row or column <= columns_away or column >= columns - 1 - columns_away


@part
def least_label(w, slot, row, column, rows: int, lag: int, enough: int, hops, contamination) -> int:
    """Return the smallest label among the cells that a lag reaches, or any label of at most `enough`."""
    least = int(NONE)
    for k in range(2 * hops.rows_away[lag] + 1):  # this row, one below, one above, two below ...
        rows_away = (k + 1) / 2
        width = hops.widths[lag, rows_away]
        other = wp.where(k % 2 == 1, row - rows_away, row + rows_away)
        if other >= 0 and other < rows:
            for near in range(wp.max(column - width, 0), wp.min(column + width, hops.columns - 1) + 1):
                least = wp.min(least, contamination.labels[w, slot, other + MARGIN, near + MARGIN])
            if least <= enough:
                return least
    return least


@part
def bound_of_cell(w, tick: int, row, column, rows: int, target, hops, contamination) -> int:
    """Return the label of a cell at a tick: the largest of the bounds of all lags."""
    label = int(-1)
    arrives = target.arrival_rate > 0.0
    for k in range(hops.lags.shape[0]):
        lag = hops.lags[k]
        since = int(NONE)  # of targets that were introduced in the meantime
        if arrives and is_near_entry(row, column, hops.rows_away[k], hops.widths[k, 0], rows, hops.columns, target):
            since = wp.max((tick - lag + 1) * hops.period - 1, 0) * PER_STEP
        if label < NONE and since > label:
            slot = (tick - lag + hops.history_length) % hops.history_length
            least = least_label(w, slot, row, column, rows, k, label, hops, contamination)
            label = wp.max(label, wp.min(least, since))
    return label


@part
def clear_covered(w, slot, row, rows: int, grown: float, curve, hops, robots, contamination):
    """Clear the cells of a row that a disc covers together with a margin of `grown` [m]."""
    height = 2.0 * curve.half_height / float(rows)
    scale = float(hops.columns) / (2.0 * curve.half_width)
    bottom = float(row) * height - curve.half_height
    for i in range(robots.sensor.shape[1]):
        place = robots.sensor[w, i]
        if place[0] < NOWHERE:
            size = curve.half_width + curve.half_height + hops.radius + wp.abs(place[0]) + wp.abs(place[1])
            radius = hops.radius - grown - _ROUNDING * size
            far = wp.where(place[1] < bottom + 0.5 * height, bottom + height, bottom)  # edge of the row
            edges = columns_of(disc_run(place, radius, far), curve.half_width, scale, 0.0, hops.columns + 1)
            for column in range(edges[0], edges[1]):
                contamination.labels[w, slot, row + MARGIN, column + MARGIN] = NONE


@stage(FIELD_ROW, writes="contamination: labels, row_ages, row_oldest")
def bound_labels(w, row, curve, target, hops, clock, robots, contamination):
    """Bound the label of each cell, and clear the cells that a disc covers entirely.

    At a reset, the cells in which targets are introduced are contaminated if some are present from the start.
    """
    now = clock.step[w]
    tick = now / hops.period
    steps_since = now % hops.period  # the tick
    slot = tick % hops.history_length
    rows = contamination.row_ages.shape[1]
    for column in range(hops.columns):
        is_entry = is_near_entry(row, column, 0, 0, rows, hops.columns, target)
        if now == 0:
            for k in range(hops.history_length):
                label = wp.where(target.count > 0 and is_entry, 0, NONE)
                contamination.labels[w, k, row + MARGIN, column + MARGIN] = label
        elif steps_since == 0:
            label = bound_of_cell(w, tick, row, column, rows, target, hops, contamination)
            contamination.labels[w, slot, row + MARGIN, column + MARGIN] = label
        elif target.arrival_rate > 0.0 and is_entry:
            label = contamination.labels[w, slot, row + MARGIN, column + MARGIN]
            contamination.labels[w, slot, row + MARGIN, column + MARGIN] = wp.min(label, (now - 1) * PER_STEP)
    clear_covered(w, slot, row, rows, float(steps_since) * hops.moved, curve, hops, robots, contamination)
    oldest = int(NEVER)
    ages = wp.int64(0)
    for column in range(hops.columns):
        label = contamination.labels[w, slot, row + MARGIN, column + MARGIN]
        if label < NONE:
            oldest = wp.min(oldest, label / PER_STEP)
            ages += wp.int64(now - label / PER_STEP)
    contamination.row_oldest[w, row] = oldest
    contamination.row_ages[w, row] = ages
