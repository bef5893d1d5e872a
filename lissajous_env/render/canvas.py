"""Coordinates of the picture, and drawing and text on a finer surface that is averaged down for smooth edges."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pygame

from lissajous_env.parameters.scenario import Scenario
from lissajous_env.render import palette

FINE = 3
"""Pixels of the fine surface for one of the picture, along each side."""
HEADER, FOOTER, MARGIN = 46, 40, 14
"""Space above and below the plot, and around it [px]."""
_LARGEST, _NARROWEST, _SMALLEST = (960, 680), 720, (240, 180)
"""Largest plot, least width of a picture of size 1, and least width and height of any picture [px]."""
_FARTHEST = 1e6
"""Distance beyond which the end of a line may be moved, because only its direction matters [px]."""
_OUTLINED = 13
"""Height of the font of outlined text [px of the picture]."""
_LONGEST = 80
"""Largest number of characters of a text."""


@dataclass(frozen=True)
class View:
    """Maps the world to the picture."""

    size: tuple[int, int]
    """Width and height of the picture [px]."""
    scale: float
    """Pixels per metre."""
    half: tuple[float, float]
    """Half of the rectangle's width and height [m]."""

    @classmethod
    def of(cls, scenario: Scenario, size: float = 1.0) -> "View":
        """Fit the rectangle, and robots on its edge, into a picture; `size` is a factor of the picture's usual size."""
        half = scenario.curve.half_width, scenario.curve.half_height
        extent = 2 * (np.array(half) + 1.25 * scenario.robot.radius)
        scale = size * float(np.min(_LARGEST / extent))
        wide, high = scale * extent
        sides = max(wide + 2 * MARGIN, size * _NARROWEST), high + HEADER + FOOTER + 2 * MARGIN
        # Video codecs require even numbers.
        width, height = (2 * round(max(side, least) / 2) for side, least in zip(sides, _SMALLEST, strict=True))
        return cls((width, height), scale, half)

    @property
    def fine_size(self) -> tuple[int, int]:
        """Size of the fine surface [px]."""
        return FINE * self.size[0], FINE * self.size[1]

    def fine(self, points: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) of the fine surface for points (..., 2) of the world [m]."""
        width, height = self.size
        centre = width / 2, HEADER + (height - HEADER - FOOTER) / 2
        return FINE * (np.asarray(centre) + np.asarray(points, dtype=float) * (self.scale, -self.scale))

    def plot(self) -> pygame.Rect:
        """Return the part of the fine surface between status line and legend."""
        width, height = self.fine_size
        return pygame.Rect(0, FINE * HEADER, width, height - FINE * (HEADER + FOOTER))

    def rectangle(self) -> pygame.Rect:
        """Return the monitored rectangle in pixels of the fine surface."""
        corners = self.fine(np.multiply(self.half, [[-1, 1], [1, -1]]))
        (left, top), (right, bottom) = np.rint(corners).astype(int).tolist()
        return pygame.Rect(left, top, right - left, bottom - top)


def within(points: np.ndarray, room: pygame.Rect) -> np.ndarray:
    """Return (...,) bool: True for points (..., 2) in a rectangle."""
    return np.asarray(((points >= room.topleft) & (points < room.bottomright)).all(axis=-1))


def transparent(size: tuple[int, int]) -> pygame.Surface:
    """Make a surface that is fully transparent."""
    return pygame.Surface(size, pygame.SRCALPHA, 32)


def pixels(surface: pygame.Surface) -> np.ndarray:
    """Copy a surface to (H, W, 3) uint8."""
    width, height = surface.get_size()
    return np.frombuffer(pygame.image.tobytes(surface, "RGB"), np.uint8).reshape(height, width, 3).copy()


def draw_line(surface: pygame.Surface, colour: tuple, start: np.ndarray, end: np.ndarray, width: int) -> None:
    """Draw a line between two points (2,) however far away; pygame would iterate over all of its length."""
    ends = np.clip([start, end], -_FARTHEST, _FARTHEST).tolist()
    if seen := surface.get_rect().clipline(*ends):
        pygame.draw.line(surface, colour, *seen, width)


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


def printable(words: str) -> str:
    """Return text as one line of at most 80 printable characters."""
    shown = words if len(words) <= _LONGEST else words[: _LONGEST - 3] + "..."
    return "".join(letter if letter.isprintable() else "?" for letter in shown)


def width_of(words: str, size: int) -> float:
    """Return the width of a text [px of the picture] in a size [px]."""
    return _rendered(printable(words), size, palette.INK).get_width() / FINE


def write(
    fine: pygame.Surface,
    words: str,
    at: tuple[float, float],
    size: int,
    colour: palette.Colour,
    anchor: str = "midleft",
) -> float:
    """Write a text and return the x coordinate of its end.

    Args:
        fine: The fine surface.
        words: Text to write.
        at: Place of the anchor [px of the picture].
        size: Height of the font [px of the picture].
        colour: RGB.
        anchor: Point of the words, such as `center`, as an attribute of `pygame.Rect`.
    """
    text = _rendered(printable(words), size, colour)
    place = text.get_rect(**{anchor: (round(FINE * at[0]), round(FINE * at[1]))})
    fine.blit(text, place)
    return place.right / FINE


def write_outlined(fine: pygame.Surface, words: str, at: tuple[float, float], colour: palette.Colour) -> None:
    """Write a centred text with a light outline, readable on any ground."""
    for dx, dy in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        write(fine, words, (at[0] + 1.2 * dx, at[1] + 1.2 * dy), _OUTLINED, palette.GROUND, "center")
    write(fine, words, at, _OUTLINED, colour, "center")


@lru_cache(maxsize=256)
def _rendered(words: str, size: int, colour: palette.Colour) -> pygame.Surface:
    pygame.font.init()  # starts fonts only, not sound or display; other code may have quit pygame
    return pygame.font.Font(None, FINE * size).render(words, True, colour)
