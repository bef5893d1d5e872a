"""The clock of each world: its seed, its steps, and the beginning and end of its episodes.

A reset sets every array of a world to its initial value, which its struct states.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.stage import ARRAY, INITIAL, WORLD, named_struct, stage
from lissajous_env.device.warp_abi import fields_of
from lissajous_env.world.state import ENDED, IDLE, RUNNING

wp.set_module_options(OPTIONS)


@stage(WORLD, writes="clock: active, invalid, invalid_at, seed, status, step", idle=True)
def reset_clock(w, seeds, clock):
    """Begin an episode with the given seed or, if it is negative, with one that follows from the previous seed."""
    clock.active[w] = clock.fresh[w]
    if clock.active[w] == 0:
        return
    seed = seeds[w]
    if seed < 0:
        key = randomness.step_key(clock.seed[w], 0)
        seed = int(randomness.stream(key, 0, randomness.EPISODE) >> wp.uint32(1))
    clock.seed[w] = seed
    clock.step[w] = 0
    clock.status[w] = RUNNING
    clock.invalid[w] = 0
    clock.invalid_at[w] = 0


@stage(
    WORLD,
    writes="clock: active, status, step; latest: collisions, detections, idle_ended, in_sight, waiting",
    idle=True,
)
def advance_clock(w, clock, latest):
    """Count a step, which has no events yet, in the worlds whose episode is running; the others become inactive."""
    if clock.status[w] == RUNNING:
        clock.active[w] = 1
        clock.step[w] += 1
        for i in range(latest.detections.shape[1]):
            latest.detections[w, i] = 0
            latest.collisions[w, i] = 0
        latest.in_sight[w] = 0
        latest.waiting[w] = 0
        latest.idle_ended[w] = wp.int64(0)
    else:
        clock.active[w] = 0
        clock.status[w] = IDLE


@stage(WORLD, writes="clock: status; latest: truncated")
def end_episodes(w, steps, clock, latest):
    """End an episode when its time is over, or when every robot is terminated."""
    over = clock.step[w] >= steps
    running = int(0)
    for i in range(latest.terminated.shape[1]):
        latest.truncated[w, i] = over
        if not latest.terminated[w, i]:
            running += 1
    if over or running == 0:
        clock.status[w] = ENDED


@named_struct("initial")
class Initial:
    """The A arrays of the state (A,), and their values at the beginning of an episode."""

    address: wp.array(dtype=wp.uint64)
    """Address of the first world."""
    size: wp.array(dtype=wp.int64)
    """Size of a world [bytes]."""
    value: wp.array(dtype=wp.uint32)
    """Bits of the initial value; 0 for numbers of other sizes."""


def initial_of(structs: Mapping[str, Any], device: Any) -> Initial:
    """Return the arrays of the state, except those of the clock, with their initial values; `structs` is by name."""
    arrays = {
        f"{name}.{field}": array
        for name, struct in structs.items()
        if name != "clock"
        for field, array in fields_of(struct).items()
        if array.size > 0
    }
    values = [INITIAL.get(name, 0) for name in arrays]
    bits = [np.array(value, dtype=np.float32 if isinstance(value, float) else np.int32) for value in values]
    filled: Any = Initial()
    filled.address = wp.array([array.ptr for array in arrays.values()], dtype=wp.uint64, device=device)
    filled.size = wp.array([array.strides[0] for array in arrays.values()], dtype=wp.int64, device=device)
    filled.value = wp.array([int(number.view(np.uint32)) for number in bits], dtype=wp.uint32, device=device)
    return filled


@wp.func_native("""
    char* const begin = (char*)address + w * size;
    if (size % 4 == 0)
        for (wp::int64 k = lane; k < size / 4; k += lanes)
            ((wp::uint32*)begin)[k] = value;
    else  // booleans, which are bytes
        for (wp::int64 k = lane; k < size; k += lanes)
            begin[k] = 0;
""")
def fill(address: wp.uint64, w: int, size: wp.int64, value: wp.uint32, lane: int, lanes: int):
    """Set every `lanes`-th number of world w in an array to the bits `value`, from number `lane` on."""


@stage(ARRAY, writes="")
def reset_arrays(w, lane, lanes, initial, clock):
    """Set all arrays of the state to their initial values, except those of the clock."""
    for k in range(initial.address.shape[0]):
        fill(initial.address[k], w, initial.size[k], initial.value[k], lane, lanes)
