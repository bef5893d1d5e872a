"""Named arrays, with several sets in one dictionary: `world.clock.step` is `clock.step` of the set `world`."""

import numpy as np


def prefixed(part: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arrays of a set with the prefix of the set."""
    return {f"{part}.{name}": array for name, array in arrays.items()}


def within(part: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arrays of one set without its prefix."""
    start = f"{part}."
    return {name.removeprefix(start): array for name, array in arrays.items() if name.startswith(start)}
