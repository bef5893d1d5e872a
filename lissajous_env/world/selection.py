"""Worlds of a batch that are selected by a mask or by indices, and seeds that are drawn for worlds."""

import os
from typing import Any

import numpy as np

from lissajous_env.wording import shown


def world_mask(worlds: Any, num_worlds: int) -> np.ndarray:
    """Return the (W,) bool mask of the worlds that `chosen_worlds` chooses.

    Raises:
        ValueError: as `chosen_worlds`.
    """
    mask = np.zeros(num_worlds, dtype=bool)
    mask[chosen_worlds(worlds, num_worlds)] = True
    return mask


def chosen_worlds(worlds: Any, num_worlds: int) -> np.ndarray:
    """Return the indices of the worlds of a (W,) mask, or of indices; None selects all.

    Raises:
        ValueError: a mask of another shape, or indices that are not whole numbers from 0 to W - 1, each once.
    """
    if worlds is None:
        return np.arange(num_worlds)
    try:
        chosen = np.asarray(worlds)
    except ValueError as error:  # rows of different lengths
        raise ValueError(f"worlds must be a mask or indices of worlds, got {shown(worlds)}") from error
    if chosen.dtype == bool:
        if chosen.shape != (num_worlds,):
            raise ValueError(f"worlds must be a mask of shape ({num_worlds},), got shape {chosen.shape}")
        return np.flatnonzero(chosen)
    chosen = np.atleast_1d(chosen)
    if chosen.size == 0:
        return np.zeros(0, dtype=np.int64)
    if chosen.dtype.kind not in "iu":
        raise ValueError(f"worlds must be a mask or indices of worlds, got {shown(worlds)}")
    if chosen.min() < 0 or chosen.max() >= num_worlds:
        raise ValueError(f"worlds must be from 0 to {num_worlds - 1}, got {shown(worlds)}")
    if chosen.ndim != 1 or len(np.unique(chosen)) != len(chosen):
        raise ValueError(f"worlds must be in one row, each once, got {shown(worlds)}")
    return chosen.astype(np.int64)


def drawn_seeds(count: int) -> np.ndarray:
    """Return (count,) int64 seeds of worlds, from 0 to 2^31 - 1, different in every call and in every process."""
    return (np.frombuffer(os.urandom(4 * count), dtype=np.uint32) >> 1).astype(np.int64)
