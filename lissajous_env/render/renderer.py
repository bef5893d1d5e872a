"""The renderer, which combines ground, targets, team and panel to one picture, and the window that shows it."""

import os

import numpy as np
import pygame

from lissajous_env.episodes.snapshot import Snapshot
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render.canvas import View, pixels, printable
from lissajous_env.render.ground import Ground
from lissajous_env.render.panel import Panel
from lissajous_env.render.targets import Targets
from lissajous_env.render.team import Team
from lissajous_env.world.simulation import Simulation

_TRAIL_MOMENTS = 60
"""Largest number of moments of a trail."""


class Renderer:
    """Draws worlds of one scenario in memory; only `show` opens a window.

    Args:
        scenario: Name of a scenario, or one that was made.
        size: Factor of the usual size of the picture, which fits the scenario's rectangle.
    """

    def __init__(self, scenario: str | Scenario, size: float = 1.0):
        self.scenario = named.build(scenario).resolve()
        self.view = View.of(self.scenario, size)
        self.picture = pygame.Surface(self.view.size, depth=32)
        """The latest picture, as a pygame surface."""
        self._fine = pygame.Surface(self.view.fine_size, depth=32)
        self._ground = Ground(self.scenario, self.view)
        self._targets = Targets(self.scenario, self.view)
        self._team = Team(self.scenario, self.view)
        self._panel = Panel(self.scenario, self.view, self._ground.idle_full, self._targets.radius)
        self._panel.draw_fixed(self._ground.base)
        self._window: Window | None = None
        self._past: list[tuple[tuple[int, int], int, np.ndarray]] = []
        """Moments of the trails: world and seed, step, and positions (N, 2) [m]."""

    def draw(self, simulation: Simulation | Snapshot, world: int = 0) -> np.ndarray:
        """Return the picture of one world of a simulation, or of a snapshot.

        Trails show where the robots were when the same episode was drawn before.

        Returns:
            (H, W, 3) uint8, the caller's own.
        """
        snapshot = simulation if isinstance(simulation, Snapshot) else Snapshot.of(simulation, world)
        steps, trail = self._trail(snapshot)
        self._ground.draw(self._fine, snapshot)
        self._fine.set_clip(self.view.plot())
        self._team.draw_links(self._fine, snapshot, steps, trail)
        self._targets.draw(self._fine, snapshot)
        self._team.draw(self._fine, snapshot)
        self._fine.set_clip(None)
        self._panel.draw(self._fine, snapshot)
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

    def _trail(self, snapshot: Snapshot) -> tuple[np.ndarray, np.ndarray]:
        """Return the steps (K,) and positions (K, N, 2) of the trails, oldest first, ending at the robots."""
        episode, now, longest = (snapshot.world, snapshot.seed), snapshot.step, self._team.trail_steps
        past = [moment for moment in self._past if moment[0] == episode and now - longest <= moment[1] < now]
        trail = [*past, (episode, now, snapshot.position[:, :2])]
        is_new = not past or now - past[-1][1] >= longest / _TRAIL_MOMENTS
        self._past = trail if is_new else past
        _, steps, places = zip(*trail, strict=True)
        return np.array(steps), np.stack(places)


class Window:
    """A window of a given size [px], the only user of the display. After the user closes it, `show` does nothing.

    If other code in the process closes it, such as an environment that quits pygame, it is opened again.

    Raises:
        OSError: there is no display to open a window on.
    """

    def __init__(self, size: tuple[int, int], caption: str):
        self.closed = False
        self._size, self._caption = size, printable(caption)
        self._clock = pygame.time.Clock()
        self._open()

    def _open(self) -> None:
        try:
            pygame.display.init()
            if pygame.display.get_driver() == "offscreen" != os.environ.get("SDL_VIDEODRIVER"):  # a choice of SDL
                pygame.display.quit()
                raise pygame.error("there is no display")
            pygame.display.set_caption(self._caption)
            self._screen = pygame.display.set_mode(self._size)
        except pygame.error as error:
            raise OSError(f"no window can be opened ({error}); draw to rgb_array or to a file instead") from error

    def show(self, picture: pygame.Surface, fps: float) -> None:
        """Show a picture for at least 1 / `fps` seconds."""
        if self.closed:
            return
        screen = pygame.display.get_surface() if pygame.display.get_init() else None
        if screen is None or screen is not self._screen or screen.get_size() != self._size:
            self._open()  # other code has quit pygame or replaced its window
        self._screen.blit(picture, (0, 0))
        pygame.display.flip()
        self._clock.tick(fps)
        for event in pygame.event.get():
            if event.type == pygame.QUIT or (event.type == pygame.KEYDOWN and event.key == pygame.K_ESCAPE):
                self.close()

    def close(self) -> None:
        """Close the window."""
        if not self.closed:
            self.closed = True
            pygame.display.quit()
