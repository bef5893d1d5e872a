"""Labels of contamination on the host, cell by cell."""

from typing import Any

import numpy as np

from lissajous_env.world.contamination.labels import MARGIN, NONE
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import NEVER


def introduced_at(simulation: Simulation, world: int = 0) -> np.ndarray:
    """Return the (R, C) int32 earliest step in which a target that may be in a cell now can have been introduced.

    It can have stayed undetected since then. The lowest row comes first. NEVER where none can be; (1, 1)
    NEVER where `task.contamination` is None.
    """
    hops, margin = simulation.scenario.spreading, int(MARGIN)
    if simulation.scenario.task.contamination is None:
        return np.full((1, 1), int(NEVER), dtype=np.int32)
    slot = int(simulation.clock.step.numpy()[world]) * hops.ticks // hops.period % hops.history_length
    if simulation.scenario.task.conservative:
        labels = _of_world(simulation.contamination.labels, world)[slot]
        labels = labels[margin : margin + hops.rows, margin : margin + hops.columns]
        return np.where(labels < int(NONE), labels >> 8, int(NEVER)).astype(np.int32)
    inside, columns = slice(margin, hops.rows + margin), np.arange(hops.columns)
    words = _of_world(simulation.contamination.there, world)[inside, 1:-1, slot]
    there = words[:, columns // 32] >> (columns % 32).astype(np.uint32) & 1
    labels = _of_world(simulation.contamination.labels, world)[slot, inside, margin : margin + hops.columns]
    return np.where(there == 1, labels >> 8, int(NEVER)).astype(np.int32)


def _of_world(array: Any, world: int) -> np.ndarray:
    return np.asarray(array)[world] if array.device.is_cpu else array[world].numpy()
