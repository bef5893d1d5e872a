"""Actions on their way to the motors."""

import numpy as np
import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.part_structs import NoiseStruct
from lissajous_env.world.state import Clock, Latest

wp.set_module_options(MOTION)

_LARGEST = wp.constant(float(np.finfo(np.float32).max))


@wp.kernel
def take_commands(
    first: int,
    lanes: int,
    noise: NoiseStruct,
    action: wp.array3d(dtype=float),
    clock: Clock,
    latest: Latest,
    taken: wp.array3d(dtype=float),
    command_out: wp.array3d(dtype=float),
):
    """Limit the actions to [-1, 1] and add noise; one that is not finite is taken as zero, and its world flagged.

    Effort and change are those of the action without the noise, which `taken` keeps until the next step.
    """
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    size = action.shape[2]
    for i in range(lane, action.shape[1], lanes):
        finite = bool(True)
        for k in range(size):
            finite = finite and wp.abs(action[w, i, k]) <= _LARGEST
        if not finite:
            clock.invalid[w] = 1
            if clock.invalid_at[w] == 0:
                clock.invalid_at[w] = clock.step[w]
        squares = float(0.0)
        change = float(0.0)
        for k in range(size):
            command = wp.where(finite, wp.clamp(action[w, i, k], -1.0, 1.0), 0.0)
            difference = command - taken[w, i, k]
            squares += command * command
            change += difference * difference
            command_out[w, i, k] = command
            taken[w, i, k] = command
        latest.effort[w, i] = squares / float(size)
        latest.change[w, i] = wp.where(clock.step[w] > 1, change / float(size), 0.0)
        if noise.actuator > 0.0:
            draw = randomness.stream(randomness.step_key(clock.seed[w], clock.step[w]), i, randomness.ACTUATOR)
            for k in range(size):
                command_out[w, i, k] = wp.clamp(command_out[w, i, k] + noise.actuator * wp.randn(draw), -1.0, 1.0)
