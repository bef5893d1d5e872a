"""The worst-case undetected time of targets: now, its largest value, its mean over the cells, and after a fault."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.part_structs import TargetStruct, TaskStruct
from lissajous_env.device.stage import WORLD, stage
from lissajous_env.world.contamination.labels import Hops
from lissajous_env.world.state import NEVER, Clock, Contamination, Robots
from lissajous_env.world.tally import FAULT_MARGIN, EpisodeTotals, any_failed

wp.set_module_options(OPTIONS)


@stage(
    WORLD,
    writes=("contamination: age, age_before, age_max, age_reduction, cleared_at, high_at, mean_age, mean_age_sum"),
)
def reset_guarantee(w: int, clock: Clock, contamination: Contamination):
    """Reset the undetected times of a new episode."""
    contamination.cleared_at[w] = NEVER
    contamination.age[w] = 0
    contamination.age_max[w] = 0
    contamination.age_reduction[w] = 0.0
    contamination.mean_age[w] = 0.0
    contamination.mean_age_sum[w] = wp.float64(0.0)
    contamination.age_before[w] = 0
    contamination.high_at[w] = -1


@stage(
    WORLD,
    writes=(
        "contamination: age, age_before, age_max, age_reduction, cleared_at, high_at, mean_age, mean_age_sum, oldest"
    ),
)
def keep_guarantee(
    w: int,
    target: TargetStruct,
    task: TaskStruct,
    hops: Hops,
    clock: Clock,
    robots: Robots,
    tally: EpisodeTotals,
    contamination: Contamination,
):
    """Compute how long a target can have been undetected: t - min e, its largest value and its mean over the cells."""
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
    elif float(age) >= FAULT_MARGIN * float(contamination.age_before[w]):
        contamination.high_at[w] = now
