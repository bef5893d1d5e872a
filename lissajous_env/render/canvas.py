"""Coordinates of the picture, and drawing on a finer surface that is averaged down for smooth edges."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pygame

from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render import palette
from lissajous_env.wording import shown

FINE = 3
"""Pixels of the fine surface for one of the picture, along each side."""

HEADER, FOOTER, MARGIN = 46, 40, 14
"""Space above and below the plot, and around it [px]."""

SMALLEST, LARGEST = 160, 3840 * 2160
"""Sides of a picture are at least so long [px], and it has at most so many pixels."""


@dataclass(frozen=True)
class View:
    """Maps the world to the picture."""

    size: tuple[int, int]
    """Width and height of the picture [px]."""
    scale: float
    """Pixels per metre."""
    centre: tuple[float, float]
    """Centre of the rectangle [px]."""
    half: tuple[float, float]
    """Half of the rectangle's width and height [m]."""

    @classmethod
    def of(cls, scenario: Scenario, size: Sequence[int] | None = None) -> "View":
        """Fit the scenario's rectangle, and robots on its edge, into a picture of a given or a fitting size.

        Raises:
            ValueError: a size that is not two whole numbers of at least 160, or of more than 3840 x 2160 pixels.
        """
        half = scenario.curve.half_width, scenario.curve.half_height
        extent = 2 * (np.array(half) + 1.25 * scenario.robot.radius)
        if size is None:
            scale = float(min(960 / extent[0], 680 / extent[1]))
            wide, high = (round(scale * length) for length in extent)
            size = max(wide + 2 * MARGIN, 720), high + HEADER + FOOTER + 2 * MARGIN
            # Video codecs require even numbers.
            size = size[0] + size[0] % 2, size[1] + size[1] % 2
        elif not _is_size(size):
            raise ValueError(
                f"size must be (width, height), whole numbers of at least {SMALLEST} [px] and together of at most "
                f"{LARGEST:,} pixels, got {shown(size)}"
            )
        width, height = int(size[0]), int(size[1])
        room = np.array([width - 2 * MARGIN, height - HEADER - FOOTER - 2 * MARGIN])
        scale = float(np.min(np.maximum(room, 20) / extent))
        centre = width / 2, HEADER + (height - HEADER - FOOTER) / 2
        return cls((width, height), scale, centre, half)

    @property
    def fine_size(self) -> tuple[int, int]:
        """Size of the fine surface [px]."""
        return FINE * self.size[0], FINE * self.size[1]

    def place(self, points: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) of the picture for points (..., 2) of the world [m]."""
        return np.asarray(self.centre) + np.asarray(points, dtype=float) * (self.scale, -self.scale)

    def fine(self, points: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) of the fine surface for points (..., 2) of the world [m]."""
        return FINE * self.place(points)

    def plot(self) -> pygame.Rect:
        """Return the part of the fine surface between status line and legend."""
        width, height = self.fine_size
        return pygame.Rect(0, FINE * HEADER, width, height - FINE * (HEADER + FOOTER))

    def rectangle(self, fine: bool) -> pygame.Rect:
        """Return the monitored rectangle in pixels of the fine surface or of the picture."""
        factor = FINE if fine else 1
        low = factor * self.place(np.array([-self.half[0], self.half[1]]))
        high = factor * self.place(np.array([self.half[0], -self.half[1]]))
        left, top, right, bottom = (round(float(edge)) for edge in (*low, *high))
        return pygame.Rect(left, top, right - left, bottom - top)


def _is_size(size: Sequence[int]) -> bool:
    if np.shape(size) != (2,) or np.asarray(size).dtype.kind not in "iuf":
        return False
    width, height = (float(length) for length in size)
    whole = width.is_integer() and height.is_integer()
    return whole and min(width, height) >= SMALLEST and width * height <= LARGEST


def within(points: np.ndarray, room: pygame.Rect) -> np.ndarray:
    """Return (...,) bool: True for points (..., 2) in a rectangle."""
    return np.asarray(((points >= room.topleft) & (points < room.bottomright)).all(axis=-1))


def opaque(size: tuple[int, int]) -> pygame.Surface:
    """Make a surface without transparency."""
    return pygame.Surface(size, 0, 32)


def transparent(size: tuple[int, int]) -> pygame.Surface:
    """Make a surface that is fully transparent."""
    return pygame.Surface(size, pygame.SRCALPHA, 32)


def pixels(surface: pygame.Surface) -> np.ndarray:
    """Copy a surface to (H, W, 3) uint8."""
    width, height = surface.get_size()
    return np.frombuffer(pygame.image.tobytes(surface, "RGB"), np.uint8).reshape(height, width, 3).copy()


def stamp(
    surface: pygame.Surface,
    points: np.ndarray,
    radius: float,
    colour: palette.Colour,
    *,
    hole: float = 0.0,
    alpha: float = 1.0,
) -> None:
    """Draw the same disc, or ring with `hole` above 0, at thousands of points (n, 2) at once; lengths in pixels."""
    sprite = _disc(round(radius, 1), round(hole, 1), colour, round(255 * alpha))
    size = np.array(sprite.get_size())
    corner = np.rint(points) - size // 2
    visible = ((corner > -size) & (corner < surface.get_size())).all(axis=1)
    surface.fblits([(sprite, place) for place in corner[visible].astype(int).tolist()])


@lru_cache(maxsize=256)
def _disc(radius: float, hole: float, colour: palette.Colour, alpha: int) -> pygame.Surface:
    reach = int(radius) + 1
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    square = x * x + y * y
    sprite = transparent((2 * reach + 1, 2 * reach + 1))
    sprite.fill((*colour, 0))
    pygame.surfarray.pixels_alpha(sprite)[(square <= radius * radius) & (square >= hole * hole)] = alpha
    return sprite
