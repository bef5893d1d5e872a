"""Default seeds, drawn from the operating system, so that processes made by a fork do not share them."""

import os

import numpy as np


def drawn_seeds(count: int) -> np.ndarray:
    """Return (count,) int64 seeds of worlds, from 0 to 2^31 - 1, different in every call and in every process."""
    return (np.frombuffer(os.urandom(4 * count), dtype=np.uint32) >> 1).astype(np.int64)
