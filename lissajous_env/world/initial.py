"""Initial values: at a reset every array of a world is zero, but those that INITIAL names."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.stage import ARRAY, stage
from lissajous_env.device.warp_abi import fields_of
from lissajous_env.world.state import INITIAL_STATE, Clock
from lissajous_env.world.tally import INITIAL_TOTALS

wp.set_module_options(OPTIONS)

INITIAL = INITIAL_STATE | INITIAL_TOTALS
"""Initial values that are not zero, by struct and field."""


@wp.struct
class Initial:
    """The arrays of the state (A,), and the values with which an episode begins."""

    address: wp.array(dtype=wp.uint64)
    """Address of the first world."""
    size: wp.array(dtype=wp.int64)
    """Size of a world [bytes]."""
    value: wp.array(dtype=wp.uint32)
    """Bits of the initial value; 0 for numbers of other sizes."""


def initial_of(structs: Mapping[str, Any], device: Any) -> Initial:
    """Return the arrays of the structs of the state, by name, but of the clock, which goes on."""
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
    filled.value = wp.array([int(each.view(np.uint32)) for each in bits], dtype=wp.uint32, device=device)
    return filled


@wp.func_native("""
    char* const begin = (char*)address + w * size;
    if (size % 4 == 0)
        for (wp::int64 k = lane; k < size / 4; k += lanes)
            ((wp::uint32*)begin)[k] = value;
    else  // truth values, which are bytes
        for (wp::int64 k = lane; k < size; k += lanes)
            begin[k] = 0;
""")
def fill(address: wp.uint64, w: int, size: wp.int64, value: wp.uint32, lane: int, lanes: int):
    """Set every `lanes`-th number of an array in a world, from number `lane` on."""


@stage(ARRAY, writes="")
def reset_arrays(w: int, lane: int, lanes: int, initial: Initial, clock: Clock):
    """Set all arrays of the state to their initial values."""
    for k in range(initial.address.shape[0]):
        fill(initial.address[k], w, initial.size[k], initial.value[k], lane, lanes)
