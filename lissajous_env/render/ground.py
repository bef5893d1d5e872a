"""The ground of a picture: the rectangle with its idleness, the curve, and the sensing discs."""

import numpy as np
import pygame

from lissajous_env.episodes.snapshot import Snapshot, thinned
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render import palette
from lissajous_env.render.canvas import FINE, View, transparent
from lissajous_env.theory import closed_forms
from lissajous_env.world.state import WORKING

IDLE_BOUNDS = 2.0
"""Idleness that is drawn in full colour, in multiples of T_max."""
_MOST_POINTS = 60_000
"""Limit on the points of the curve."""
_FILL, _RIM = (*palette.SENSING, 22), (*palette.SENSING, 105)
"""Colours of sensing discs and of their rims, with opacity."""
_SIGHT = *palette.SENSING, 60
"""Colour of the circle within which a robot sees targets, where it is farther than it detects them."""
_FARTHEST = 1e6
"""Radius [fine px] at which a rim is as good as straight."""


class Ground:
    """Draws the ground of one scenario on the fine surface; constant parts are drawn once."""

    def __init__(self, scenario: Scenario, view: View):
        self.view = view
        self.rectangle = view.rectangle()
        self.idle_full = IDLE_BOUNDS * scenario.detection_time_bound
        """Idleness that is drawn in full colour [s]."""
        self._task = scenario.task
        self.base = pygame.Surface(view.fine_size, depth=32)
        """Bottom layer, with the constant parts."""
        self.base.fill(palette.PAPER)
        self.base.fill(palette.GROUND, self.rectangle)
        self._curve = _curve(scenario, view)
        radii = {scenario.sensing_radius, scenario.sight}
        self._radius, *self._farther = sorted(min(FINE * view.scale * radius, _FARTHEST) for radius in radii)
        self._discs = transparent(self.rectangle.size)

    def draw(self, surface: pygame.Surface, snapshot: Snapshot) -> None:
        """Draw the idleness of the ground, the discs of working robots, and the curve."""
        surface.blit(self.base, (0, 0))
        if self._task.grid is not None:
            surface.blit(self._heat(snapshot), self.rectangle)
        middles = self.view.fine(snapshot.position[snapshot.status == WORKING, :2]) - self.rectangle.topleft
        draw_union(self._discs, middles, self._radius)
        for radius in self._farther:
            for middle in np.rint(middles).tolist():
                pygame.draw.circle(self._discs, _SIGHT, middle, radius, FINE)
        surface.blit(self._discs, self.rectangle)
        surface.blit(self._curve, (0, 0))
        pygame.draw.rect(surface, palette.EDGE, self.rectangle.inflate(2 * FINE, 2 * FINE), FINE)

    def _heat(self, snapshot: Snapshot) -> pygame.Surface:
        sensed_at = thinned(snapshot.sensed_at, (self.rectangle.height // FINE, self.rectangle.width // FINE))
        idle = np.clip((snapshot.step - sensed_at) * self._task.step / self.idle_full, 0.0, 1.0)[..., None]
        colours = np.array(palette.GROUND) + idle * (np.array(palette.IDLE) - palette.GROUND)
        cells = pygame.Surface(sensed_at.shape[::-1], depth=32)
        # Rows count upwards in the world and downwards in a picture.
        pygame.surfarray.blit_array(cells, np.rint(colours[::-1]).astype(np.uint8).swapaxes(0, 1))
        return pygame.transform.smoothscale(cells, self.rectangle.size)


def draw_union(layer: pygame.Surface, middles: np.ndarray, radius: float) -> None:
    """Draw the union of discs around (n, 2) centres, with its rim, on a layer; lengths in pixels."""
    layer.fill((*palette.SENSING, 0))
    near = middles[(np.abs(middles - np.array(layer.get_size()) / 2) < radius + np.array(layer.get_size())).all(axis=1)]
    for colour, reach in ((_RIM, radius), (_FILL, radius - FINE)):
        for middle in np.rint(near).tolist():
            pygame.draw.circle(layer, colour, middle, reach)


def points_of_curve(scenario: Scenario) -> np.ndarray:
    """Return points (K, 3) of the curve of a formation [m]; none without a formation."""
    curve = scenario.driven
    count = min(max(90 * curve.oscillations, 600), _MOST_POINTS) if scenario.has_formation else 0
    return closed_forms.curve_point_3d(curve, np.linspace(0.0, 2 * np.pi, count))


def _curve(scenario: Scenario, view: View) -> pygame.Surface:
    """Draw the Lissajous curve of a formation; at crossings, the lower branch is interrupted."""
    surface, places = transparent(view.fine_size), points_of_curve(scenario)
    points = view.fine(places[:, :2])
    # Dense curves are drawn fainter.
    share = float(np.clip(16 / scenario.driven.oscillations, 0.35, 1.0)) ** 0.5
    width, colour = max(round(1.3 * share * FINE), 2), (*palette.CURVE, round(235 * share))
    if len(points) and scenario.curve.half_depth == 0:
        pygame.draw.lines(surface, colour, True, points.tolist(), width)
        return surface
    for k in np.argsort(places[:-1, 2], kind="stable"):
        pygame.draw.line(surface, (0, 0, 0, 0), points[k], points[k + 1], width + 6 * FINE)
        pygame.draw.line(surface, colour, points[k], points[k + 1], width)
    return surface
