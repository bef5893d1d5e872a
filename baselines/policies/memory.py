"""Memories of policies, filters, coordinators and wall rules, one for each world."""

from typing import Any

import numpy as np

from lissajous_env.world.selection import world_mask


def clear_worlds(array: Any, mask: np.ndarray) -> None:
    """Zero a device array (W, ...) in the worlds of a mask (W,)."""
    values = array.numpy().copy()
    values[mask] = 0
    array.assign(values)


class Remembering:
    """Base class of policies, filters, coordinators and wall rules, which may have a memory for each of W worlds."""

    remembers: tuple[str, ...] = ()
    """Names of attributes with Warp arrays (W, ...) that are zero when an episode begins."""
    num_worlds: int
    """Number of worlds W."""

    def reset(self, worlds: Any = None) -> None:
        """Reset the memory of some worlds, or of all, and that of the attributes that are `Remembering`.

        Args:
            worlds: (W,) mask or indices of the worlds; all by default.

        Raises:
            ValueError: `worlds` is neither a mask of this shape nor indices from 0 to W - 1.
        """
        mask = world_mask(worlds, self.num_worlds)
        self.forget(mask)
        for part in vars(self).values():
            if isinstance(part, Remembering):
                part.reset(mask)

    def forget(self, mask: np.ndarray) -> None:
        """Reset the own memory of the worlds in a mask (W,), whose episodes begin anew.

        By default the arrays that `remembers` names become zero.
        """
        for name in self.remembers:
            clear_worlds(getattr(self, name), mask)
