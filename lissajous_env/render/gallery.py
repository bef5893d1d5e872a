"""Pictures of a batch of worlds, one each."""

import math
from typing import TYPE_CHECKING

import numpy as np

from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render import palette
from lissajous_env.render.canvas import FOOTER, HEADER, MARGIN, View
from lissajous_env.render.renderer import MOST_WORLDS, Renderer

if TYPE_CHECKING:
    from lissajous_env.world.simulation import Simulation

_SMALLEST = 240, 180
"""Width and height of a picture, at least [px]."""


class Gallery:
    """Draws the worlds of a batch, in a total size similar to that of one picture.

    Only the first 64 are drawn; the rest share one empty picture.

    Args:
        scenario: Scenario that is simulated.
        num_worlds: Number of worlds.
    """

    def __init__(self, scenario: Scenario, num_worlds: int):
        self.drawn = min(num_worlds, MOST_WORLDS)
        """Worlds that are drawn."""
        along = math.ceil(math.sqrt(self.drawn))
        width, height = View.of(scenario).size
        around = HEADER + FOOTER + 2 * MARGIN  # constant height
        sizes = width / along, (height - around) / along + around
        # Video codecs require even numbers.
        size = [max(round(length / 2) * 2, least) for length, least in zip(sizes, _SMALLEST, strict=True)]
        self._renderer = Renderer(scenario, size)
        self._empty = np.full((size[1], size[0], 3), palette.PAPER, dtype=np.uint8)

    def draw(self, simulation: "Simulation") -> list[np.ndarray]:
        """Return pictures (H, W, 3) uint8 of all worlds."""
        pictures = [self._renderer.draw(simulation, world) for world in range(self.drawn)]
        return pictures + [self._empty] * (simulation.num_worlds - self.drawn)
