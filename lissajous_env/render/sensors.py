"""The sensing discs; only their parts in the rectangle are drawn, however large they are."""

import numpy as np
import pygame

from lissajous_env.render import palette
from lissajous_env.render.canvas import FINE, transparent

_FILL, _RIM = 22, 105
"""Opacity of a disc and of its rim, of 255."""

_LAYERS = 8.0
"""Area of all discs, in multiples of the rectangle's, above which they are drawn as one: their union, with its rim."""

_TOGETHER = 64
"""Discs whose rows are looked at together."""

_FARTHEST = 1e9
"""Radius [fine px] at which a rim is as good as straight, and further of no matter."""


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
        self._as_one = robots * area > _LAYERS
        fits = 2 * self.radius + 3 <= max(rectangle.size) and not self._as_one
        self._disc = self._drawn_once() if fits else None
        self._layer = None if fits else transparent((max(rectangle.width, 1), max(rectangle.height, 1)))

    def draw(self, surface: pygame.Surface, middles: np.ndarray) -> None:
        """Draw the discs around (n, 2) centres [px] on a surface that the caller clips to the rectangle."""
        corner = np.array(self.rectangle.topleft)
        near = np.abs(middles - self.rectangle.center) < self.radius + np.array(self.rectangle.size)
        middles = middles[near.all(axis=1)]
        if self._disc is not None:
            for x, y in middles:
                surface.blit(self._disc, self._disc.get_rect(center=(round(x), round(y))))
        elif self._layer is not None and self._as_one:
            self._lay_union(self._layer, middles - corner)
            surface.blit(self._layer, self.rectangle)
        elif self._layer is not None:
            for middle in middles - corner:
                self._layer.fill((0, 0, 0, 0))
                _fill_disc(self._layer, middle, self.radius, self._rim)
                _fill_disc(self._layer, middle, self.radius - FINE, self._fill)
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
        alpha = pygame.surfarray.pixels_alpha(layer).T
        alpha[_union(middles, self.radius, alpha.shape)] = self._rim[3]
        alpha[_union(middles, self.radius - FINE, alpha.shape)] = self._fill[3]


def _reach(rows: np.ndarray, middle: np.ndarray, radius: float) -> np.ndarray:
    """Return the half width of a disc in some rows; 0 in rows that it does not cross."""
    away = np.abs(rows - middle)
    return np.sqrt(np.maximum((radius - away) * (radius + away), 0.0))


def _fill_disc(layer: pygame.Surface, middle: np.ndarray, radius: float, colour: tuple) -> None:
    """Fill the part of a disc on the layer, row by row."""
    width, height = layer.get_size()
    top, bottom = max(middle[1] - radius, -1.0), min(middle[1] + radius, height + 1.0)
    if radius <= 0 or top > bottom:
        return
    rows = np.linspace(top, bottom, max(int(bottom - top), 2))
    reach = _reach(rows, middle[1], radius)
    left, right = np.clip(middle[0] - reach, -2, width + 2), np.clip(middle[0] + reach, -2, width + 2)
    outline = np.concatenate([np.stack([left, rows], axis=1), np.stack([right, rows], axis=1)[::-1]])
    pygame.draw.polygon(layer, colour, outline.tolist())


def _union(middles: np.ndarray, radius: float, shape: tuple[int, int]) -> np.ndarray:
    """Return (H, W) bool: pixels in a disc around any of the centres (n, 2)."""
    height, width = shape
    rows, entered = np.arange(height), np.zeros((height, width + 1), dtype=np.int32)
    for first in range(0, len(middles), _TOGETHER):
        x, y = middles[first : first + _TOGETHER].T[..., None]
        reach = _reach(rows, y, radius)
        left = np.clip(np.ceil(x - reach), 0, width).astype(np.int64)
        right = np.clip(np.floor(x + reach) + 1, 0, width).astype(np.int64)
        disc, row = np.nonzero((np.abs(rows - y) <= radius) & (right > left))
        np.add.at(entered, (row, left[disc, row]), 1)
        np.add.at(entered, (row, right[disc, row]), -1)
    return np.cumsum(entered, axis=1)[:, :width] > 0
