"""Actuation: the limits and noise of actions."""

import numpy as np
import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.abreast import (
    ABREAST,
    Floats,
    block_of,
    entries,
    is_in,
    put_entries,
    put_floats,
    where_above,
    where_world,
    width,
)
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.part_structs import NoiseStruct
from lissajous_env.world.state import Clock, StepEvents

wp.set_module_options(MOTION)

_LARGEST = wp.constant(float(np.finfo(np.float32).max))


@wp.func
def flag(w: int, clock: Clock):
    """Flag a world that received an action that is not finite."""
    clock.invalid[w] = 1
    if clock.invalid_at[w] == 0:
        clock.invalid_at[w] = clock.step[w]


@wp.func
def disturb(w: int, i: int, noise: NoiseStruct, clock: Clock, command_out: wp.array3d(dtype=float)):
    """Add noise to the commands of a robot."""
    draw = randomness.stream(randomness.step_key(clock.seed[w], clock.step[w]), i, randomness.ACTUATOR)
    for entry in range(command_out.shape[2]):
        command_out[w, i, entry] = wp.clamp(command_out[w, i, entry] + noise.actuator * wp.randn(draw), -1.0, 1.0)


@wp.kernel
def take_commands(
    begin: int,
    end: int,
    noise: NoiseStruct,
    action: wp.array3d(dtype=float),
    clock: Clock,
    latest: StepEvents,
    taken: wp.array3d(dtype=float),
    command_out: wp.array3d(dtype=float),
):
    """Limit the actions to [-1, 1] and add noise; replace one that is not finite by zero, and flag its world.

    Effort and change are those of the commands without the noise, which `taken` stores until the next step. The
    components after the commands in an action are a message, which `taken` stores too; it has neither noise nor effort.
    """
    n = action.shape[1]
    size = command_out.shape[2]
    block = block_of(wp.tid(), begin, end, n, clock.active)
    if block.count == 0:
        return
    invalid = Floats()
    for entry in range(action.shape[2]):
        given = entries(block, action, entry)
        for k in range(ABREAST):
            if k < width():
                invalid[k] = wp.where(wp.abs(given[k]) <= _LARGEST, invalid[k], 1.0)
    followed = where_world(block, n, clock.step, 2)
    squares = Floats()
    change = Floats()
    for entry in range(size):
        command = entries(block, action, entry)
        before = entries(block, taken, entry)
        for k in range(ABREAST):
            if k < width():
                command[k] = wp.where(invalid[k] == 0.0, wp.clamp(command[k], -1.0, 1.0), 0.0)
                difference = command[k] - before[k]
                squares[k] += command[k] * command[k]
                change[k] += difference * difference
        put_entries(block, block.active_mask, command, entry, taken)
        put_entries(block, block.active_mask, command, entry, command_out)
    for entry in range(size, action.shape[2]):
        message = entries(block, action, entry)
        for k in range(ABREAST):
            if k < width():
                message[k] = wp.where(invalid[k] == 0.0, wp.clamp(message[k], -1.0, 1.0), 0.0)
        put_entries(block, block.active_mask, message, entry, taken)
    for k in range(ABREAST):
        if k < width():
            squares[k] = squares[k] / float(size)
            change[k] = wp.where(is_in(k, followed), change[k] / float(size), 0.0)
    put_floats(block, block.active_mask, squares, latest.effort)
    put_floats(block, block.active_mask, change, latest.change)
    flagged = block.active_mask & where_above(block, invalid, 0.0)
    if flagged != 0:
        for k in range(block.count):
            if is_in(k, flagged):
                flag((block.start + k) / n, clock)
    if noise.actuator > 0.0:
        for k in range(block.count):
            if is_in(k, block.active_mask):
                disturb((block.start + k) / n, (block.start + k) % n, noise, clock, command_out)
