"""Places of a rogue on a fine lattice, as bits: where it can move in a time, and where sensors detect it.

Bit i of word k of a row is the node of column 64 k + i.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

_ROUNDING = 1e-9
"""Relative increase of distances, for numbers of 64 bits."""


class Fineness(NamedTuple):
    """Rules for the spacing of a lattice."""

    nodes: float
    """Limit on its nodes."""
    per_cell: int
    """Nodes along a cell of the contamination grid, unless there are too many."""
    moved: float
    """Least distance of a move [node]: a shorter one would be slow between the axes."""


COARSE = Fineness(6e5, 8, 4.0)
FINE = Fineness(4e6, 24, 8.0)


class Window(NamedTuple):
    """Bits of the nodes in a part of a lattice; all others are 0."""

    row: int
    """First row."""
    word: int
    """First word of the rows."""
    bits: np.ndarray
    """(rows, words) uint64."""


@dataclass(frozen=True)
class Lattice:
    """Nodes on a rectangle, its edges included."""

    half: tuple[float, float]
    """Half width and half height of the rectangle [m]."""
    columns: int
    rows: int

    @property
    def spacing(self) -> tuple[float, float]:
        """Distance between columns, and between rows [m]."""
        return 2 * self.half[0] / (self.columns - 1), 2 * self.half[1] / (self.rows - 1)

    @cached_property
    def runs(self) -> np.ndarray:
        """(columns + 1, words) the bits of the first 0, 1, 2 ... columns."""
        bits = np.tri(self.columns + 1, -(-self.columns // 64) * 64, -1, dtype=bool)
        bits[:, self.columns :] = False
        return np.packbits(bits, axis=1, bitorder="little").view(np.uint64)

    @cached_property
    def everywhere(self) -> np.ndarray:
        """(rows, words) all nodes."""
        return np.repeat(self.runs[-1:], self.rows, axis=0)

    @cached_property
    def boundary(self) -> np.ndarray:
        """(rows, words) the nodes on the edges."""
        edge = np.repeat((self.runs[1] | self.runs[-1] & ~self.runs[-2])[None], self.rows, axis=0)
        edge[[0, -1]] = self.runs[-1]
        return edge

    def places(self, nodes: np.ndarray) -> np.ndarray:
        """Return the positions (K, 2) of nodes (K, 2), row and column [m]."""
        return nodes[:, ::-1] * np.array(self.spacing) - np.array(self.half)

    def table(self, window: Window) -> np.ndarray:
        """Return (rows, columns) bool: the nodes whose bits are set."""
        bits = np.zeros((self.rows, self.runs.shape[1]), dtype=np.uint64)
        (row, word), (rows, words) = window[:2], window.bits.shape
        bits[row : row + rows, word : word + words] = window.bits
        return unpacked(bits)[:, : self.columns]

    def clear(self, window: Window, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """Return the bits of a window without those within closed discs (K, 2), (K,) [m]."""
        (across, up), (width, height) = self.spacing, self.half
        top, left, bits = window
        bits, runs = bits.copy(), self.runs[:, left : left + bits.shape[1]]
        for (x, y), radius in zip(centres, radii, strict=True):
            first = min(max(int(np.ceil((y - radius + height) / up)) - top, 0), len(bits))
            after = min(max(int(np.floor((y + radius + height) / up)) + 1 - top, first), len(bits))
            away = np.arange(first + top, after + top) * up - height - y
            reach = np.sqrt(np.maximum(radius**2 - away**2, 0.0))
            low = np.clip(np.ceil((x - reach + width) / across), 0, self.columns).astype(int)
            high = np.clip(np.floor((x + reach + width) / across) + 1, 0, self.columns).astype(int)
            bits[first:after] &= ~(runs[np.maximum(low, high)] & ~runs[low])
        return bits

    def vectors(self, distance: float, count: int = 16) -> np.ndarray:
        """Return rows and columns (K, 2) of no move, and of moves of about a distance in all directions [node]."""
        angles = 2 * np.pi * np.arange(count) / count
        shares = np.linspace(1, 0.8, 9)[:, None, None]
        found = np.rint(shares * distance * np.stack([np.sin(angles), np.cos(angles)], axis=1) / self.spacing[::-1])
        fits = np.linalg.norm(found * self.spacing[::-1], axis=-1) <= distance
        best = found[np.argmax(fits, axis=0), np.arange(count)]
        return np.unique(np.concatenate([[[0, 0]], best[fits.any(axis=0)]]).astype(int), axis=0)

    def widened(self, window: Window, distance: float) -> Window:
        """Return the least window with all nodes within a distance of those whose bits are set [m]."""
        rows, words = np.flatnonzero(window.bits.any(axis=1)), np.flatnonzero(window.bits.any(axis=0))
        if not len(rows):
            return Window(0, 0, window.bits[:0, :0])
        up, aside = int(distance / self.spacing[1]), int(distance / self.spacing[0]) // 64 + 1
        top, left = max(window.row + rows[0] - up, 0), max(window.word + words[0] - aside, 0)
        bottom = min(window.row + rows[-1] + up + 1, self.rows)
        right = min(window.word + words[-1] + aside + 1, self.runs.shape[1])
        wide = np.zeros((bottom - top, right - left), dtype=np.uint64)
        place = window.row + rows[0] - top, window.word + words[0] - left
        part = window.bits[rows[0] : rows[-1] + 1, words[0] : words[-1] + 1]
        wide[place[0] : place[0] + part.shape[0], place[1] : place[1] + part.shape[1]] = part
        return Window(int(top), int(left), wide)

    def inside(self, window: Window) -> np.ndarray:
        """Return the bits of a window without those beyond the last column."""
        return window.bits & self.runs[-1, window.word : window.word + window.bits.shape[1]]

    def widths(self, distance: float) -> list[int]:
        """Return, for 0, 1, 2 ... rows up or down, the columns to either side within a distance [m]."""
        across, up = self.spacing
        distance *= 1 + _ROUNDING
        rows = np.arange(int(distance / up) + 1) * up
        return [int(width) for width in np.sqrt(np.maximum(distance**2 - rows**2, 0.0)) / across]

    def spread(self, bits: np.ndarray, distance: float) -> np.ndarray:
        """Return the nodes that are within a distance of a node whose bit is set [m]."""

        def beside(wide: np.ndarray, more: int) -> np.ndarray:
            return wide | _shifted(wide, more) | _shifted(wide, -more)

        return self._gathered(bits, distance, beside, np.bitwise_or)

    def spread_least(self, labels: np.ndarray, distance: float) -> np.ndarray:
        """Return the least label (rows, columns) of the nodes that are within a distance of each [m]."""

        def beside(wide: np.ndarray, more: int) -> np.ndarray:
            least = wide.copy()
            np.minimum(least[:, more:], wide[:, :-more], out=least[:, more:])
            np.minimum(least[:, :-more], wide[:, more:], out=least[:, :-more])
            return least

        return self._gathered(labels, distance, beside, np.minimum)

    def _gathered(self, values: np.ndarray, distance: float, beside: Callable, joined: np.ufunc) -> np.ndarray:
        """Join the values of all nodes within a distance of each; `beside` joins those of the nodes aside."""
        widths = self.widths(distance)
        gathered, wide, reached = values.copy(), values, 0
        for up in range(len(widths) - 1, -1, -1):  # the run of columns becomes wider towards the node's own row
            while reached < widths[up]:
                more = min(widths[up] - reached, 2 * reached + 1)
                wide, reached = beside(wide, more), reached + more
            if up > 0:
                joined(gathered[up:], wide[:-up], out=gathered[up:])
                joined(gathered[:-up], wide[up:], out=gathered[:-up])
        return joined(gathered, wide)


def lattice_of(
    half: tuple[float, float], cells: tuple[int, int], moved: float, steps: int, fineness: Fineness
) -> tuple[Lattice, int]:
    """Return a lattice for a grid of cells, and the control steps of a move.

    Args:
        half: Half width and half height of the rectangle [m].
        cells: Columns and rows of the contamination grid.
        moved: Distance of a rogue in a control step [m].
        steps: Limit on the steps of a move.
        fineness: Rules for the spacing.
    """
    side = min(half[0] / cells[0], half[1] / cells[1]) * 2 / fineness.per_cell
    side = max(side, float(np.sqrt(4 * half[0] * half[1] / fineness.nodes)))
    columns, rows = (int(np.ceil(2 * length / side)) + 1 for length in half)
    period = math.ceil(fineness.moved * side / moved) if moved * steps > side else 1
    return Lattice(half, columns, rows), min(period, max(steps, 1))


def unpacked(bits: np.ndarray) -> np.ndarray:
    """Return bits (rows, words) as bool (rows, 64 words)."""
    return np.unpackbits(np.ascontiguousarray(bits).view(np.uint8), axis=1, bitorder="little").view(bool)


def packed(table: np.ndarray) -> np.ndarray:
    """Return bool (rows, 64 words) as bits (rows, words)."""
    return np.packbits(table, axis=1, bitorder="little").view(np.uint64)


def _shifted(bits: np.ndarray, columns: int) -> np.ndarray:
    """Return rows of bits shifted to higher columns, or to lower ones."""
    words, rest = divmod(abs(columns), 64)
    shifted = np.zeros_like(bits)
    last = bits.shape[1] - words
    if last <= 0:
        return shifted
    if columns >= 0:
        shifted[:, words:] = bits[:, :last] << np.uint64(rest)
        if rest and last > 1:
            shifted[:, words + 1 :] |= bits[:, : last - 1] >> np.uint64(64 - rest)
    else:
        shifted[:, :last] = bits[:, words:] >> np.uint64(rest)
        if rest and last > 1:
            shifted[:, : last - 1] |= bits[:, words + 1 :] << np.uint64(64 - rest)
    return shifted
