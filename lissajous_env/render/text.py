"""Text on the fine surface, averaged down with the rest, so that letters scale smoothly."""

from collections.abc import Callable
from functools import lru_cache
from typing import TypeVar

import pygame

from lissajous_env.render import palette
from lissajous_env.render.canvas import FINE

_AROUND = ((-1, -1), (-1, 1), (1, -1), (1, 1), (-1, 0), (1, 0), (0, -1), (0, 1))
_OUTLINED = 13
"""Height of the font of outlined text [px of the picture]."""
_LONGEST = 80
"""Letters of which words are written, at most."""

T = TypeVar("T")


def plain(words: str) -> str:
    """Return text as one line of at most 80 printable characters."""
    shown = words if len(words) <= _LONGEST else words[: _LONGEST - 3] + "..."
    return "".join(letter if letter.isprintable() else "?" for letter in shown)


def width_of(words: str, size: int) -> float:
    """Return the width of a text [px of the picture] in a size [px]."""
    return _with_font(size, lambda font: font.size(plain(words)))[0] / FINE


def write(
    fine: pygame.Surface,
    words: str,
    at: tuple[float, float],
    size: int,
    colour: palette.Colour,
    *,
    centred: bool = False,
) -> float:
    """Write a text and return the x coordinate of its end.

    Args:
        fine: The fine surface.
        words: Text to write.
        at: Middle of the words, or of their left side [px of the picture].
        size: Height of the font [px of the picture].
        colour: RGB.
        centred: True if `at` is the middle instead of the left side.
    """
    text = _rendered(plain(words), size, colour)
    where = text.get_rect()
    setattr(where, "center" if centred else "midleft", (round(FINE * at[0]), round(FINE * at[1])))
    fine.blit(text, where)
    return where.right / FINE


def write_outlined(fine: pygame.Surface, words: str, at: tuple[float, float], colour: palette.Colour) -> None:
    """Write a centred text with a light outline, readable on any ground."""
    for dx, dy in _AROUND:
        write(fine, words, (at[0] + 1.2 * dx, at[1] + 1.2 * dy), _OUTLINED, palette.GROUND, centred=True)
    write(fine, words, at, _OUTLINED, colour, centred=True)


@lru_cache(maxsize=256)
def _rendered(words: str, size: int, colour: palette.Colour) -> pygame.Surface:
    return _with_font(size, lambda font: font.render(words, True, colour))


def _with_font(size: int, use: Callable[[pygame.font.Font], T]) -> T:
    """Use a font, and make it again if other code has quit pygame."""
    pygame.font.init()  # starts fonts only, not sound or display
    try:
        return use(_font(size))
    except pygame.error:
        _font.cache_clear()
        return use(_font(size))


@lru_cache(maxsize=32)
def _font(size: int) -> pygame.font.Font:
    """Return the font of pygame."""
    return pygame.font.Font(None, FINE * size)
