"""The clock of each world: its seed, its steps, and the beginning and end of its episodes."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.stage import WORLD, stage
from lissajous_env.world.state import ENDED, IDLE, RUNNING, Clock, StepEvents

wp.set_module_options(OPTIONS)


@stage(WORLD, writes="clock: active, invalid, invalid_at, seed, stage, step", idle=True)
def reset_clock(w: int, seeds: wp.array(dtype=int), clock: Clock):
    """Begin an episode with the given seed or, if it is negative, with one drawn from the seed before."""
    clock.active[w] = clock.fresh[w]
    if clock.active[w] == 0:
        return
    seed = seeds[w]
    if seed < 0:
        key = randomness.step_key(clock.seed[w], 0)
        seed = int(randomness.stream(key, 0, randomness.EPISODE) >> wp.uint32(1))
    clock.seed[w] = seed
    clock.step[w] = 0
    clock.stage[w] = RUNNING
    clock.invalid[w] = 0
    clock.invalid_at[w] = 0


@stage(WORLD, writes="clock: active, stage, step", idle=True)
def advance_clock(w: int, clock: Clock):
    """Count the step in worlds whose episode is running; the others stay as they are."""
    if clock.stage[w] == RUNNING:
        clock.active[w] = 1
        clock.step[w] += 1
    else:
        clock.active[w] = 0
        clock.stage[w] = IDLE


@stage(WORLD, writes="clock: stage; latest: truncated")
def end_episodes(w: int, steps: int, clock: Clock, latest: StepEvents):
    """End an episode when its time is over, or when every robot is terminated."""
    over = clock.step[w] >= steps
    running = int(0)
    for i in range(latest.terminated.shape[1]):
        latest.truncated[w, i] = over
        if not latest.terminated[w, i]:
            running += 1
    if over or running == 0:
        clock.stage[w] = ENDED
