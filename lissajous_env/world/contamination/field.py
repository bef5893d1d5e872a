"""Contamination: the cells in which an undetected target may be, however it moves, and since when.

Each cell of a grid has a time e. Consider all targets that may be in the cell now and have not been in the disc of a
working robot: e is the earliest time at which one of them can have appeared. In the literature on pursuit and evasion,
a cell that may contain such a target is contaminated, any other cell is cleared: T. D. Parsons, "Pursuit-evasion in a
graph" (Theory and Applications of Graphs, 1978); L. J. Guibas, J.-C. Latombe, S. M. LaValle, D. Lin, R. Motwani, "A
visibility-based pursuit-evasion problem" (Int. J. Computational Geometry & Applications 9, 1999). t - min e is the time
for which a target can have stayed undetected.

Time is counted in ticks: a step has `Hops.ticks` of them, or one tick has `Hops.period` steps. A label is e in control
steps times 256, plus the share of a tick, in 255ths, at which the target arrived in its cell. Of two labels, the
smaller one is that of the older target or, at the same age, of the earlier arrival. The labels of the latest ticks are
stored for each cell, because a target that hops now (`lissajous_env.parameters.spreading`) arrived some ticks ago in
the cell from which it hops. All earlier labels of a sensed cell are deleted: during a hop, a target counts as being in
the cell from which it hops. A cell is sensed if it is in a disc at the end of a tick, and swept if it is sensed or a
disc has passed over it since the tick before. No target stays in a swept cell, but one that hops there may arrive after
the disc.
"""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.discs import half_of, mark_way, place_along, points_per_metre, run_of_bits, visit_disc
from lissajous_env.device.stage import FIELD_ROW, WORLD, part, stage
from lissajous_env.world.contamination.labels import MARGIN, clear_marked, context_of, label_cells, latest_slot
from lissajous_env.world.state import NEVER, NOWHERE
from lissajous_env.world.tally import FAULT_MARGIN, any_failed
from lissajous_env.world.targets.motion import BOUNDARY

wp.set_module_options(OPTIONS)


@wp.func
def entry_cells(entry: int, word: int, row: int, rows: int, columns: int) -> wp.uint32:
    """Return a bit for each cell of a word in which `targets.entry` introduces targets."""
    if entry != BOUNDARY or row == 0 or row == rows - 1:
        return half_of(run_of_bits(word / 2, 0, columns - 1), word)
    ends = run_of_bits(word / 2, 0, 0) | run_of_bits(word / 2, columns - 1, columns - 1)
    return half_of(ends, word)


@part
def is_over(w, target, clock, contamination) -> bool:
    """Return whether no undetected target is left in any tick, and none will be introduced."""
    return target.arrival_rate == 0.0 and contamination.cleared_at[w] < clock.step[w] - 1


@stage(FIELD_ROW, writes="contamination: sensed, swept, labelled", idle=True)
def clear_cells(w, lane, lanes, curve, target, hops, tick: int, clock, robots, contamination):
    """Delete the earlier labels of the cells that were marked last, and mark those that are sensed or swept now."""
    if clock.active[w] == 0 or is_over(w, target, clock, contamination):
        return
    latest = latest_slot(clock.step[w], tick, hops)
    rows = contamination.sensed.shape[2]
    for row in range(lane, rows, lanes):
        clear_marked(w, row, latest, contamination.sensed, contamination.swept, contamination.labelled)
    per_metre_x = points_per_metre(hops.columns, hops.edge_gap, curve.half_width)
    per_metre_y = points_per_metre(rows, hops.edge_gap, curve.half_height)
    cell = 1.0 / wp.max(per_metre_x, per_metre_y)
    sensed = contamination.sensed[w]
    swept = contamination.swept[w]
    for i in range(robots.sensor.shape[1]):
        if robots.sensor[w, i][0] < NOWHERE:
            end = place_along(robots.path, w, i, float(tick + 1) / float(hops.ticks))
            start = place_along(robots.path, w, i, float(tick) / float(hops.ticks))
            visit_disc(end, lane, lanes, curve, hops.radius, hops.columns, hops.edge_gap, sensed, swept)
            # On a short path the disc covers hardly more than at the two ends.
            if wp.length_sq(end - start) > hops.radius * cell:
                pieces = robots.path.shape[2] - 1
                for piece in range(1, pieces + 1):
                    end = place_along(
                        robots.path, w, i, (float(tick) + float(piece) / float(pieces)) / float(hops.ticks)
                    )
                    mark_way(start, end, lane, lanes, curve, hops.radius, hops.columns, hops.edge_gap, swept)
                    start = end


@stage(FIELD_ROW, writes="contamination: labelled")
def reset_labels(w, row, target, hops, clock, contamination):
    """Contaminate the cells in which targets are introduced, if some are present from the start."""
    if target.count > 0:
        for word in range(contamination.labelled.shape[2] - 2):
            for k in range(hops.history_length):
                enter = entry_cells(target.entry, word, row, contamination.sensed.shape[2], hops.columns)
                contamination.labelled[w, row + MARGIN, word + 1, k] = enter


@stage(FIELD_ROW, writes="contamination: labelled, labels, row_ages, row_oldest, settled", idle=True)
def spread(w, lane, lanes, target, hops, tick: int, clock, contamination):
    """Label the cells in which undetected targets may be: targets stay, hop and are introduced outside all discs."""
    if clock.active[w] == 0 or is_over(w, target, clock, contamination):
        return
    now = context_of(clock.step[w], tick, contamination.oldest[w], target.arrival_rate > 0.0, hops)
    rows = contamination.sensed.shape[2]
    for row in range(lane, rows, lanes):
        row_oldest = int(NEVER)
        ages = wp.int64(0)
        for word in range(contamination.labelled.shape[2] - 2):
            sensed = half_of(contamination.sensed[w, word / 2, row], word)
            swept = half_of(contamination.swept[w, word / 2, row], word)
            todo = half_of(run_of_bits(word / 2, 0, hops.columns - 1), word) & ~sensed
            enter = entry_cells(target.entry, word, row, rows, hops.columns)
            settled = contamination.settled[w, row, word]
            word_result = label_cells(
                contamination.labels, contamination.labelled, w, row, word, todo, ~swept, enter, settled, now
            )
            row_oldest = wp.min(row_oldest, word_result[0])
            ages += wp.int64(word_result[1])
            contamination.settled[w, row, word] = wp.uint32(word_result[3])
            contamination.labelled[w, row + MARGIN, word + 1, now.slot] = wp.uint32(word_result[2])
        contamination.row_oldest[w, row] = row_oldest
        contamination.row_ages[w, row] = ages


@stage(
    WORLD,
    writes=(
        "contamination: age, age_before, age_max, age_reduction, cleared_at, high_at, mean_age, mean_age_sum, oldest"
    ),
)
def update_undetected_time(w, target, task, hops, clock, robots, tally, contamination):
    """Compute the worst-case undetected time t - min e [step], its largest value so far and its mean over cells."""
    now = clock.step[w]
    oldest = int(NEVER)
    ages = wp.int64(0)
    for row in range(contamination.row_oldest.shape[1]):
        oldest = wp.min(oldest, contamination.row_oldest[w, row])
        ages += contamination.row_ages[w, row]
    age = wp.where(oldest == NEVER, 0, now - oldest)
    mean_age = float(ages) / float(contamination.row_oldest.shape[1] * hops.columns)
    if task.conservative == 1 and now > 0:
        # A target that was undetected a step ago, or appeared since then, may have been so until the end of this step.
        latest = wp.where(target.arrival_rate > 0.0, now - 1, NEVER)
        before = wp.min(contamination.oldest[w], latest)
        if before != NEVER:
            contamination.age_max[w] = wp.max(contamination.age_max[w], now - before)
    contamination.oldest[w] = oldest
    contamination.cleared_at[w] = wp.where(oldest == NEVER, wp.min(contamination.cleared_at[w], now), NEVER)
    contamination.age[w] = age
    contamination.age_max[w] = wp.max(contamination.age_max[w], age)
    contamination.age_reduction[w] = contamination.mean_age[w] - mean_age
    contamination.mean_age[w] = mean_age
    contamination.mean_age_sum[w] += wp.float64(mean_age)
    if tally.faulted[w] == 0 and not any_failed(w, robots):
        contamination.age_before[w] = contamination.age_max[w]
    elif float(age) > FAULT_MARGIN * float(contamination.age_before[w]):
        contamination.high_at[w] = now
