"""Arrays by name, several sets of them in one: `world.clock.step` is `clock.step` of the set `world`."""

import numpy as np


def prefixed(part: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays of one set, under the names that they have among several."""
    return {f"{part}.{name}": array for name, array in arrays.items()}


def within(part: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays of one set among several, under their own names."""
    start = f"{part}."
    return {name.removeprefix(start): array for name, array in arrays.items() if name.startswith(start)}
