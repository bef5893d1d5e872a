"""Robots that fail by schedule or at random, or are removed."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.abreast import where_equal
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.stage import ROBOT, WORLD, part, stage
from lissajous_env.device.structs import code_of
from lissajous_env.settings.parts import Faults
from lissajous_env.world.state import FAILED, NEVER, REMOVED, WORKING

wp.set_module_options(OPTIONS)
COAST = wp.constant(code_of(Faults, "stop", "coast"))


@part
def is_coasting(block, faults, robots) -> int:
    """Return a bit for each car of a block that has failed and coasts; a car that a collision stopped does not."""
    if faults.stop != COAST:
        return 0
    return where_equal(block, robots.status, FAILED) & ~where_equal(block, robots.failed_until, NEVER)


@stage(ROBOT, writes="robots: resumed_at, status, failed_until")
def update_status(w, i, faults, task, schedule, clock, robots):
    """Update which robots have failed, resumed or been removed in the step that ends now."""
    now = clock.step[w]
    if robots.status[w, i] == REMOVED or robots.removed_at[w, i] < now:
        robots.status[w, i] = REMOVED
    else:
        failed = int(0)
        for row in range(schedule.shape[0]):
            if schedule[row, 0] == i and schedule[row, 1] < now and now <= schedule[row, 2]:
                failed = 1
        if faults.rate > 0.0 and failed == 0 and robots.failed_until[w, i] < now:
            draw = randomness.stream(randomness.step_key(clock.seed[w], now), i, randomness.FAULT)
            if wp.randf(draw) < 1.0 - wp.exp(-faults.rate * task.step):  # a Poisson process has an event in the step
                duration = -wp.log(1.0 - wp.randf(draw)) * faults.mean_duration
                robots.failed_until[w, i] = now + int(wp.min(duration / task.step, 1.0e9))
        status = wp.where(failed == 1 or now <= robots.failed_until[w, i], FAILED, WORKING)
        if status == WORKING and robots.status[w, i] == FAILED:
            robots.resumed_at[w, i] = now - 1
        robots.status[w, i] = status


@stage(WORLD, writes="robots: removed_at")
def reset_losses(w, faults, removals, steps, clock, robots):
    """Set when each robot is removed in this episode: by schedule, or `faults.lost` of them at a random time."""
    n = robots.status.shape[1]
    draw = randomness.stream(randomness.step_key(clock.seed[w], 0), 0, randomness.LOSS)
    to_lose = int(faults.lost)
    for i in range(n):
        robots.removed_at[w, i] = removals[i]
        # Selection sampling: each of the robots left is as likely as any other to be among those still to be lost.
        pick = wp.randf(draw) * float(n - i) < float(to_lose)
        at = int((0.25 + 0.5 * wp.randf(draw)) * float(steps))
        if pick:
            robots.removed_at[w, i] = wp.min(robots.removed_at[w, i], at)
            to_lose -= 1


def schedule_steps(faults: Faults, step: float):
    """Return rows (robot, start, end) of the schedule in steps."""
    return [(i, _steps(start, step), _steps(end, step)) for i, start, end in faults.schedule]


def removal_steps(faults: Faults, num_robots: int, step: float) -> list[int]:
    """Return the step after which each robot is removed by schedule."""
    removals = [NEVER] * num_robots
    for robot, time in faults.removed:
        removals[robot] = min(removals[robot], _steps(time, step))
    return removals


def _steps(time: float, step: float) -> int:
    return round(min(time / step, NEVER))
