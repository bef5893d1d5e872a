"""The renderer, which combines ground, targets, team and panel to one picture, and the pictures of a batch."""

import math
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pygame

from lissajous_env.episodes.snapshot import Snapshot
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render import palette
from lissajous_env.render.canvas import FOOTER, HEADER, MARGIN, View, opaque, pixels
from lissajous_env.render.ground import Ground
from lissajous_env.render.panel import Panel
from lissajous_env.render.targets import Targets
from lissajous_env.render.team import Team
from lissajous_env.render.window import Window
from lissajous_env.world.state import WORKING

if TYPE_CHECKING:
    from lissajous_env.world.simulation import Simulation

LONGEST_TRAIL = 60
"""Moments of which a trail is drawn, at most."""

MOST_WORLDS = 64
"""Number of worlds of which one renderer stores trails."""

_SMALLEST = 240, 180
"""Width and height of a picture, at least [px]."""


class Renderer:
    """Draws worlds of one scenario in memory; only `show` opens a window.

    Args:
        scenario: Name of a scenario, or one that was made.
        size: Width and height of the picture [px]; None fits the scenario's rectangle.

    Raises:
        ValueError: a size that is not two whole numbers of at least 160, or of more than 3840 x 2160 pixels.
    """

    def __init__(self, scenario: str | Scenario, size: Sequence[int] | None = None):
        self.scenario = named.build(scenario).resolve()
        self.view = View.of(self.scenario, size)
        self.picture = opaque(self.view.size)
        """The latest picture, as a pygame surface."""
        self._fine = opaque(self.view.fine_size)
        self._ground = Ground(self.scenario, self.view)
        self._targets = Targets(self.scenario, self.view)
        self._team = Team(self.scenario, self.view)
        self._panel = Panel(self.scenario, self.view, self._ground.idle_full, self._targets.radius)
        self._panel.draw_fixed(self._ground.base)
        self._window: Window | None = None
        self._past: dict[int, tuple[int, deque[tuple[int, np.ndarray]]]] = {}

    def draw(self, simulation: "Simulation | Snapshot", world: int = 0) -> np.ndarray:
        """Return the picture of one world of a simulation, or of a snapshot.

        Trails show what was drawn of the same episode before, unless the snapshot brings its own.

        Returns:
            (H, W, 3) uint8, the caller's own.
        """
        seen = simulation
        if not isinstance(seen, Snapshot):
            seen = Snapshot.of(seen, world, self._ground.most_cells)
        steps, trail = self._trail(seen)
        sensing = seen.position[seen.status == int(WORKING), :2]
        self._ground.draw(self._fine, seen.sensed_at, seen.step, sensing)
        self._fine.set_clip(self.view.plot())
        self._team.draw_links(self._fine, seen, steps, trail)
        self._targets.draw(self._fine, seen)
        self._team.draw(self._fine, seen)
        self._fine.set_clip(None)
        self._panel.draw(self._fine, seen)
        pygame.transform.smoothscale(self._fine, self.view.size, self.picture)
        return pixels(self.picture)

    def show(self, fps: float) -> None:
        """Show the latest picture in a window, at most `fps` per second; do nothing once the user has closed it."""
        if self._window is None:
            self._window = Window(self.view.size, f"{self.scenario.name} - lissajous")
        self._window.show(self.picture, fps)

    def reset(self) -> None:
        """Delete the trails."""
        self._past.clear()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _trail(self, seen: Snapshot) -> tuple[np.ndarray, np.ndarray]:
        """Return the steps (K,) and positions (K, N, 2) of the trails, oldest first, ending at the robots."""
        longest = self._team.trail_steps()
        apart = -(-longest // LONGEST_TRAIL)
        if seen.trail is not None:
            steps, places = seen.trail
            keep = np.flatnonzero(steps >= seen.step - longest)[::-apart][::-1]
            return steps[keep], places[keep]
        past = self._past_of(seen)
        while past and past[-1][0] >= seen.step:
            past.pop()
        while past and past[0][0] < seen.step - longest:
            past.popleft()
        now = (seen.step, seen.position[:, :2])
        trail = [*past, now]
        if not past or seen.step - past[-1][0] >= apart:
            past.append(now)
        return np.array([step for step, _ in trail]), np.stack([place for _, place in trail])

    def _past_of(self, seen: Snapshot) -> deque[tuple[int, np.ndarray]]:
        """Return the drawn steps and positions of an episode; the oldest worlds are dropped beyond a limit."""
        seed, past = self._past.get(seen.world, (None, deque()))
        if seed != seen.seed:
            past.clear()
            self._past[seen.world] = seen.seed, past
        if len(self._past) > MOST_WORLDS:
            del self._past[next(iter(self._past))]
        return past


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
