"""The memory of a policy from one step to the next, in Warp arrays, world first."""

import numpy as np
import warp as wp


def clear_worlds(memory: wp.array, mask: np.ndarray) -> None:
    """Zero the memory (W, ...) of the worlds in a mask (W,)."""
    kept = memory.numpy().copy()
    kept[mask] = 0
    memory.assign(kept)
