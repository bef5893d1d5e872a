"""Text on the fine surface, averaged down with the rest, so that letters scale smoothly."""

from functools import lru_cache

import pygame

from lissajous_env.render import palette
from lissajous_env.render.canvas import FINE

_OUTLINED = 13
"""Height of the font of outlined text [px of the picture]."""
_LONGEST = 80
"""Letters of which words are written, at most."""


def plain(words: str) -> str:
    """Return text as one line of at most 80 printable characters."""
    shown = words if len(words) <= _LONGEST else words[: _LONGEST - 3] + "..."
    return "".join(letter if letter.isprintable() else "?" for letter in shown)


def width_of(words: str, size: int) -> float:
    """Return the width of a text [px of the picture] in a size [px]."""
    return _rendered(plain(words), size, palette.INK).get_width() / FINE


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
    text = _rendered(plain(words), size, colour)
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
