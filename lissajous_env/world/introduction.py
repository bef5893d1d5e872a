"""Since when a rogue can have been where it is now, cell by cell: the labels of contamination on the host."""

import numpy as np

from lissajous_env.world.contamination import MARGIN, NONE
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import NEVER


def introduced_at(simulation: Simulation, world: int = 0) -> np.ndarray:
    """(R, C) int32 earliest step in which a rogue that may be in a cell now can have been introduced.

    A rogue of a cell can have gone unseen since then. The lowest row comes first. NEVER where none can be; (1, 1)
    NEVER where `task.contamination` is None.
    """
    hops, margin = simulation.scenario.spreading, int(MARGIN)
    if simulation.scenario.task.contamination is None:
        return np.full((1, 1), int(NEVER), dtype=np.int32)
    ticks = int(simulation.clock.step.numpy()[world]) * hops.ticks // hops.period
    labels = simulation.contamination.labels
    kept = np.asarray(labels)[world] if labels.device.is_cpu else labels[world].numpy()
    cells = kept[ticks % hops.ring].reshape(hops.rows + 2 * margin, hops.columns + 2 * margin)
    inside = cells[margin:-margin, margin:-margin]
    return np.where(inside >= int(NONE), int(NEVER), inside >> 8).astype(np.int32)
