"""The ground of a picture: the rectangle with its idleness, the curve, and the sensing discs."""

import numpy as np
import pygame

from lissajous_env.episodes.snapshot import thinned
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render import palette
from lissajous_env.render.canvas import FINE, View, opaque, transparent
from lissajous_env.theory import closed_forms

IDLE_BOUNDS = 2.0
"""Idleness that is drawn in full colour, in multiples of T_max."""

_MOST_POINTS = 60_000
"""Points of the curve that are drawn at most."""

_FILL, _RIM = 22, 105
"""Opacity of a disc and of its rim, of 255."""

_LAYERS = 8.0
"""Area of all discs, in multiples of the rectangle's, above which they are drawn as one: their union, with its rim.
Discs that are wider than the rectangle are, too."""

_FARTHEST = 1e6
"""Radius [fine px] at which a rim is as good as straight, and further of no matter."""


class Ground:
    """Draws the ground of one scenario on the fine surface; constant parts are drawn once."""

    def __init__(self, scenario: Scenario, view: View):
        self.view = view
        self.rectangle = view.rectangle(fine=True)
        self.idle_full = IDLE_BOUNDS * scenario.detection_time_bound
        """Idleness that is drawn in full colour [s]."""
        self._task = scenario.task
        self.base = opaque(view.fine_size)
        """Bottom layer, with the constant parts."""
        self.base.fill(palette.PAPER)
        self.base.fill(palette.GROUND, self.rectangle)
        self._curve = _curve(scenario, view)
        self._sensors = Sensors(FINE * view.scale * scenario.sensing_radius, scenario.num_robots, self.rectangle)
        self.most_cells = self.rectangle.height // FINE, self.rectangle.width // FINE
        """Rows and columns of the grid that are drawn at most."""

    def draw(self, surface: pygame.Surface, sensed_at: np.ndarray, step: int, sensing: np.ndarray) -> None:
        """Draw the ground; `sensing` (n, 2) are the positions of working robots [m], `sensed_at` as in the snapshot."""
        surface.blit(self.base, (0, 0))
        surface.set_clip(self.rectangle)
        if self._task.grid is not None:
            surface.blit(self._heat(sensed_at, step), self.rectangle)
        self._sensors.draw(surface, self.view.fine(sensing))
        surface.set_clip(None)
        surface.blit(self._curve, (0, 0))
        pygame.draw.rect(surface, palette.EDGE, self.rectangle.inflate(2 * FINE, 2 * FINE), FINE)

    def _heat(self, sensed_at: np.ndarray, step: int) -> pygame.Surface:
        sensed_at = thinned(sensed_at, self.most_cells)
        idle = np.clip((step - sensed_at) * self._task.step / self.idle_full, 0.0, 1.0)[..., None]
        colours = np.array(palette.GROUND) + idle * (np.array(palette.IDLE) - palette.GROUND)
        cells = opaque(sensed_at.shape[::-1])
        # Rows count upwards in the world and downwards in a picture.
        pygame.surfarray.blit_array(cells, np.rint(colours[::-1]).astype(np.uint8).swapaxes(0, 1))
        return pygame.transform.smoothscale(cells, self.rectangle.size)


def _curve(scenario: Scenario, view: View) -> pygame.Surface:
    """Draw the Lissajous curve; at crossings, the lower branch is interrupted."""
    curve, rectangle = scenario.driven, view.rectangle(fine=True)
    surface = transparent(view.fine_size)
    # Dense curves are drawn fainter.
    share = float(np.clip(16 / (curve.oscillations), 0.35, 1.0)) ** 0.5
    width, colour = max(round(1.3 * share * FINE), 2), (*palette.CURVE, round(235 * share))
    if curve.oscillations > max(rectangle.size) / width:
        surface.fill(colour, rectangle)  # the lines are too dense
        return surface
    lap = np.linspace(0.0, 2 * np.pi, min(max(180 * (curve.oscillations), 2000), _MOST_POINTS))
    points = view.fine(closed_forms.curve_point(curve, lap))
    if curve.half_depth == 0:
        pygame.draw.lines(surface, colour, True, points.tolist(), width)
        return surface
    height = np.sin(curve.c * lap)
    for k in np.argsort(height[:-1]):
        pygame.draw.line(surface, (0, 0, 0, 0), points[k], points[k + 1], width + 6 * FINE)
        pygame.draw.line(surface, colour, points[k], points[k + 1], width)
    return surface


class Sensors:
    """Draws a sensing disc around each robot, within a rectangle.

    Args:
        radius: Radius of a disc [fine px].
        robots: Number of robots; the discs of many are fainter.
        rectangle: Rectangle in which they are drawn, in pixels of the fine surface.
    """

    def __init__(self, radius: float, robots: int, rectangle: pygame.Rect):
        self.radius, self.rectangle = min(radius, _FARTHEST), rectangle
        strength = 1.0 if robots <= 6 else 0.8
        self._fill = (*palette.SENSING, round(_FILL * strength))
        self._rim = (*palette.SENSING, round(_RIM * strength))
        area = min(np.pi * self.radius**2 / max(rectangle.width * rectangle.height, 1), 1.0)
        fits = 2 * self.radius + 3 <= max(rectangle.size) and robots * area <= _LAYERS
        self._disc = self._drawn_once() if fits else None
        self._layer = None if fits else transparent((max(rectangle.width, 1), max(rectangle.height, 1)))

    def draw(self, surface: pygame.Surface, middles: np.ndarray) -> None:
        """Draw the discs around (n, 2) centres [px] on a surface that the caller clips to the rectangle."""
        near = np.abs(middles - self.rectangle.center) < self.radius + np.array(self.rectangle.size)
        middles = middles[near.all(axis=1)]
        if self._disc is not None:
            for x, y in middles:
                surface.blit(self._disc, self._disc.get_rect(center=(round(x), round(y))))
        elif self._layer is not None:
            self._lay_union(self._layer, middles - np.array(self.rectangle.topleft))
            surface.blit(self._layer, self.rectangle)

    def _drawn_once(self) -> pygame.Surface:
        side = 2 * round(self.radius) + 3
        surface = transparent((side, side))
        middle = (side // 2, side // 2)
        pygame.draw.circle(surface, self._fill, middle, self.radius)
        pygame.draw.circle(surface, self._rim, middle, self.radius, FINE)
        return surface

    def _lay_union(self, layer: pygame.Surface, middles: np.ndarray) -> None:
        """Draw the union of the discs with its rim."""
        layer.fill((*palette.SENSING, 0))
        for colour, radius in ((self._rim, self.radius), (self._fill, self.radius - FINE)):
            for middle in np.rint(middles).tolist():
                pygame.draw.circle(layer, colour, middle, radius)
