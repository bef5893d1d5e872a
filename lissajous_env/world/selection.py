"""Selection of worlds of a batch by a mask or by indices, their seeds, and their arrays on the host."""

import os
from typing import Any

import numpy as np

from lissajous_env.settings.checks import LAST_SEED, whole_number
from lissajous_env.wording import require, shown


def world_mask(worlds: Any, num_worlds: int) -> np.ndarray:
    """Return the (W,) bool mask of the worlds that a mask or indices select, as `chosen_worlds` does.

    Raises:
        ValueError: as `chosen_worlds`.
    """
    mask = np.zeros(num_worlds, dtype=bool)
    mask[chosen_worlds(worlds, num_worlds)] = True
    return mask


def chosen_worlds(worlds: Any, num_worlds: int) -> np.ndarray:
    """Return the indices of the worlds that a (W,) mask or indices select; None selects all.

    Raises:
        ValueError: a mask of another shape, or indices that are not whole numbers from 0 to W - 1, each once.
    """
    if worlds is None:
        return np.arange(num_worlds)
    chosen = _as_array("worlds", worlds, rule := "must be a mask or indices of worlds")
    if chosen.dtype == bool:
        require(chosen.shape == (num_worlds,), "worlds", f"must be a mask of shape ({num_worlds},)", chosen.shape)
        return np.flatnonzero(chosen)
    if chosen.size == 0:
        return np.zeros(0, dtype=np.int64)
    require(chosen.dtype.kind in "iu", "worlds", rule, worlds)
    require(chosen.min() >= 0 and chosen.max() < num_worlds, "worlds", f"must be from 0 to {num_worlds - 1}", worlds)
    fits = chosen.ndim == 1 and len(np.unique(chosen)) == len(chosen)
    require(fits, "worlds", "must be in one row, each once", worlds)
    return chosen.astype(np.int64)


def _as_array(name: str, given: Any, rule: str) -> np.ndarray:
    try:
        return np.atleast_1d(np.asarray(given))
    except ValueError as error:  # rows of different lengths
        raise ValueError(f"{name} {rule}, got {shown(given)}") from error


def drawn_seeds(count: int) -> np.ndarray:
    """Return (count,) int64 seeds of worlds, from 0 to 2^31 - 1, drawn by the operating system."""
    return (np.frombuffer(os.urandom(4 * count), dtype=np.uint32) >> 1).astype(np.int64)


def fold_seed(seed: int) -> int:
    """Map a whole number of at least 0 to a seed of a world; numbers below 2^31 are unchanged."""
    seed = whole_number("seed", seed, 0)
    return seed if seed <= LAST_SEED else int(np.random.SeedSequence(seed).generate_state(1)[0] >> 1)


def checked_seeds(seeds: Any, count: int) -> np.ndarray:
    """Return seeds of `count` worlds as int32 (count,).

    Raises:
        ValueError: they are not that many whole numbers from 0 to 2^31 - 1.
    """
    array = _as_array("seed", seeds, rule := f"must be a whole number from 0 to {LAST_SEED}")
    fits = not array.size or (array.dtype.kind in "iu" and array.min() >= 0 and array.max() <= LAST_SEED)
    require(fits, "seed", rule, seeds)
    require(array.shape == (count,), "seeds", f"must be one for each of the {count} worlds to reset", array.shape)
    return array.astype(np.int32)


def of_world(array: Any, world: int) -> np.ndarray:
    """Copy one world of a device array to the host."""
    if array.device.is_cpu and array.size > 0:
        return np.array(np.asarray(array)[world])  # five times as fast as `numpy`, which synchronizes streams
    whole = array.ndim == 1 or array.size == 0
    return np.array(array.numpy()[world] if whole else array[world].numpy())
