"""Search for the rogue that a policy misses, over all paths on a fine lattice of the rectangle.

From the nodes at which a rogue can appear undetected, the set of nodes that it can have reached undetected is followed
move by move, until it is empty or the episode ends. In a move, which lasts one or several control steps, a rogue goes
straight at one speed to another node, and each robot goes along its recorded path, as when the simulation detects
targets; the distance between the two is computed without rounding to moments. A path is then traced back from the last
set. So every path that is returned is undetected, and no path on the lattice is undetected for longer.
"""

import math
from collections.abc import Sequence

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import compile_quietly
from lissajous_env.device.discs import in_discs
from lissajous_env.episodes.missed.played import Path, PlayedEpisode, crossing_steps
from lissajous_env.world.robots.contacts import closest_approach
from lissajous_env.world.state import NOWHERE

wp.set_module_options(OPTIONS)

LATTICES = (2, 8), (4, 8), (8, 6), (16, 4)
"""Nodes of the lattices along a cell of the contamination grid, and the least number of them in the distance of a move.
Finer lattices are searched where coarser ones have no path that is undetected for as long as the stage reports."""
_ROGUES = 3
"""Number of rogues of the contamination stage that are searched, those that are undetected for longest first."""
_MOST = 2**29
"""Limit on the nodes of all moves of a search, each of which takes a bit; only the coarsest lattice may have more."""
_MARGIN = 4e-6
"""Share of all lengths by which discs are made larger, for numbers of 32 bits."""
_ROUNDING = 1e-6
"""Relative increase of the speed limit, for numbers of 32 bits: a whole number of nodes stays one."""


@wp.struct
class Lattice:
    """A lattice over the rectangle of an episode with T steps, N robots and S sub-steps."""

    path: wp.array3d(dtype=wp.vec2)
    """(T + 1, N, S + 1) positions of the robots through the step that led to a moment [m], NOWHERE without sensing."""
    radius: float
    """Sensing radius, with a margin for rounding [m]."""
    half: wp.vec2
    """Half width and half height of the rectangle [m]."""
    spacing: wp.vec2
    """Distance of columns and of rows [m]."""
    moves: wp.array(dtype=wp.vec2i)
    """(H,) columns and rows of the moves."""
    middle: wp.array(dtype=wp.vec2)
    """(N,) positions around which the robots are during the moves [m]."""
    near: wp.array(dtype=float)
    """(N,) distances from these: the robot detects no move that ends farther away [m]."""


@wp.func
def place_of(row: int, column: int, lattice: Lattice) -> wp.vec2:
    """Return the position of a node [m]."""
    return wp.cw_mul(wp.vec2(float(column), float(row)), lattice.spacing) - lattice.half


@wp.func
def is_undetected(start: wp.vec2, end: wp.vec2, first: int, last: int, lattice: Lattice) -> bool:
    """Return whether a straight move from the end of step `first` to that of step `last` stays out of all discs."""
    pieces = lattice.path.shape[2] - 1
    count = float((last - first) * pieces)
    for i in range(lattice.path.shape[1]):
        if wp.length_sq(lattice.middle[i] - end) > lattice.near[i] * lattice.near[i]:
            continue
        for step in range(first + 1, last + 1):
            for s in range(pieces):
                share = float((step - first - 1) * pieces + s)
                before = wp.lerp(start, end, share / count) - lattice.path[step, i, s]
                after = wp.lerp(start, end, (share + 1.0) / count) - lattice.path[step, i, s + 1]
                if closest_approach(before, after) < lattice.radius * lattice.radius:
                    return False
    return True


@wp.func
def is_sensed(place: wp.vec2, step: int, lattice: Lattice) -> bool:
    """Return whether a disc senses a position at the end of a step."""
    last = lattice.path.shape[2] - 1
    for i in range(lattice.path.shape[1]):
        if wp.length_sq(lattice.path[step, i, last] - place) < lattice.radius * lattice.radius:
            return True
    return False


@wp.kernel
def move(
    first: int,
    last: int,
    corner: wp.vec2i,
    lattice: Lattice,
    nodes: wp.array2d(dtype=wp.bool),
    moves_out: wp.array2d(dtype=wp.int16),
):
    """Write the number, from 1, of the first move that leads to a node undetected from one of `nodes`.

    The kernel runs for a rectangle of nodes, whose first row and column are `corner`.
    """
    i, j = wp.tid()
    row = corner[0] + i
    column = corner[1] + j
    end = place_of(row, column, lattice)
    if is_sensed(end, last, lattice):
        return
    for k in range(lattice.moves.shape[0]):
        r = row - lattice.moves[k][1]
        c = column - lattice.moves[k][0]
        if r < 0 or c < 0 or r >= nodes.shape[0] or c >= nodes.shape[1]:
            continue
        if nodes[r, c]:  # noqa: SIM102 - Warp computes both sides of `and`
            if is_undetected(place_of(r, c, lattice), end, first, last, lattice):
                moves_out[row, column] = wp.int16(k + 1)
                return


def longest_path(played: PlayedEpisode) -> Path | None:
    """Return the longest path of an episode on which a rogue stays undetected; None if no rogue ever is.

    The rogues of the contamination stage state when the rogue appears. For each of them, finer lattices are
    searched until the path lasts as long as the stage reports, to the time in which a rogue crosses a cell. If no path
    does, rogues that appear at other steps are searched on the coarsest lattice, to the same tolerance.
    """
    longest, enough, rogues = None, crossing_steps(played.scenario) - 1, played.longest_rogues()
    with compile_quietly():
        wp.load_module(__name__, device="cpu")
    with wp.ScopedDevice("cpu"):
        for since, until in rogues[:_ROGUES]:
            for k, (fineness, least) in enumerate(LATTICES):
                search = _Search(played, fineness, least)
                is_large = k > 0 and search.nodes * (until - since) / search.period > _MOST
                if is_large or (longest is not None and longest.steps >= until - since - enough):
                    break
                longest = _longer(longest, search.path(since))
        return _with_later(longest, played, rogues, enough)


def _longer(*paths: Path | None) -> Path | None:
    """Return the longest of some paths; None is shorter than any."""
    return max(paths, key=lambda path: -1 if path is None else path.steps)


def _with_later(
    longest: Path | None, played: PlayedEpisode, rogues: Sequence[tuple[int, int]], enough: int
) -> Path | None:
    """Return the longest of a path and, where targets arrive, of those of rogues that appear at other steps.

    A target that is undetected when another one appears may be that one. So no rogue is detected before one that
    appeared earlier, and between two steps no path is longer than from the first of them to the end of the path that
    begins at the second. (Where targets appear on the edges alone, some may be longer, and are not found.)

    Args:
        longest: The longest path of the first of these rogues.
        played: The episode.
        rogues: The rogues of the contamination stage, the longest undetected first.
        enough: Tolerance [step].
    """
    search, ends, arrive = None, {played.steps: played.steps}, played.scenario.targets.arrival_rate > 0
    spans = [(min(since for since, _ in rogues) - 1, played.steps)] if rogues and arrive else []
    while spans:
        first, last = spans.pop()
        most = min(ends[last] - first - 1, rogues[0][1] - rogues[0][0]) - enough
        if last - first > 1 and (longest is None or longest.steps < most):
            search, middle = search or _Search(played, *LATTICES[0]), (first + last) // 2
            path = search.path(middle)
            ends[middle] = middle - 1 if path is None else middle + path.steps
            longest = _longer(longest, path)
            spans += [(middle, last), (first, middle)]
    return longest


class _Search:
    """Search of an episode on a lattice.

    Args:
        played: The episode.
        fineness: Nodes along a cell of the contamination grid.
        least: Least number of nodes in the distance of a move.
    """

    def __init__(self, played: PlayedEpisode, fineness: int, least: int):
        scenario, grid = played.scenario, played.scenario.spreading
        self.played, self.half = played, np.array([scenario.curve.half_width, scenario.curve.half_height])
        side = 2 * (self.half / (grid.columns, grid.rows)).min() / fineness
        columns, rows = np.ceil(2 * self.half / side - 1e-9).astype(int) + 1
        self.shape, self.nodes = (int(rows), int(columns)), int(rows * columns)
        self.spacing, self.moved = 2 * self.half / (columns - 1, rows - 1), scenario.rogue_speed * scenario.task.step
        self.period = 1
        """Control steps of a move."""
        if self.moved > 0:
            self.period = min(math.ceil(least * self.spacing.max() / self.moved), scenario.task.steps)
        self.lattice = Lattice()
        self.lattice.path = wp.array(np.where(played.works[..., None, None], played.path, NOWHERE), dtype=wp.vec2)
        self.lattice.half, self.lattice.spacing = wp.vec2(*self.half), wp.vec2(*self.spacing)
        self.lattice.radius = scenario.sensing_radius + _MARGIN * (self.half.sum() + scenario.sensing_radius)

    def path(self, since: int) -> Path | None:
        """Return the longest path of a rogue that appears at the end of step `since`; None if none is undetected."""
        played = self.played
        x, y = (np.linspace(-half, half, count) for half, count in zip(self.half, self.shape[::-1], strict=True))
        nodes = ~in_discs(x, y, played.path[since, played.works[since], -1][:, None], self.lattice.radius)[0]
        if played.scenario.targets.entry == "boundary":
            nodes[1:-1, 1:-1] = False
        if not nodes.any():
            return None
        ends, reached, steps = [since], [np.packbits(nodes, axis=1)], self.period
        while ends[-1] < played.steps and steps > 0:
            steps = min(steps, played.steps - ends[-1])
            after = self._first_moves(ends[-1], ends[-1] + steps, nodes, (0, 0), self.shape) > 0
            if not after.any():
                steps //= 2  # to 0 if the rogue is detected in a single step, too, wherever it goes
                continue
            ends.append(ends[-1] + steps)
            reached.append(np.packbits(after, axis=1))
            nodes, steps = after, self.period
        return self._traced(ends, reached)

    def _first_moves(
        self, first: int, last: int, nodes: np.ndarray, corner: tuple[int, int], dim: tuple[int, int]
    ) -> np.ndarray:
        """Return `moves_out` of `move` for `dim` nodes, from the end of step `first` to that of step `last`."""
        path = self.played.path[first + 1 : last + 1]
        middle = (path.max(axis=(0, 2)) + path.min(axis=(0, 2))) / 2
        away = np.linalg.norm(path - middle[:, None], axis=-1).max(axis=(0, 2))
        longest = (1 + _ROUNDING) * (last - first) * self.moved
        self.lattice.moves = wp.array(self._moves(last - first), dtype=wp.vec2i)
        self.lattice.middle = wp.array(middle, dtype=wp.vec2)
        self.lattice.near = wp.array(away + longest + 1.001 * self.lattice.radius, dtype=float)
        moves, before = wp.zeros(self.shape, dtype=wp.int16), wp.array(nodes, dtype=wp.bool)
        wp.launch(move, dim=dim, inputs=[first, last, wp.vec2i(*corner), self.lattice, before, moves])
        return moves.numpy()

    def _traced(self, ends: Sequence[int], reached: Sequence[np.ndarray]) -> Path:
        """Return the path to the node of the last moment that is farthest from all discs a step later."""

        def nodes_of(k: int) -> np.ndarray:
            return np.unpackbits(reached[k], axis=1, count=self.shape[1]).view(bool)

        nodes, after = np.argwhere(nodes_of(-1))[:, ::-1], min(ends[-1] + 1, self.played.steps)
        discs = self.played.path[after, self.played.works[after], -1]
        away = [np.linalg.norm(nodes * self.spacing - self.half - disc, axis=1) for disc in discs]
        path = [nodes[np.min(away, axis=0).argmax() if away else 0]]
        for k in range(len(ends) - 1, 0, -1):
            column, row = path[-1].tolist()
            number = self._first_moves(ends[k - 1], ends[k], nodes_of(k - 1), (row, column), (1, 1))[row, column]
            path.append(path[-1] - self._moves(ends[k] - ends[k - 1])[number - 1])
        places, steps = np.array(path[::-1]) * self.spacing - self.half, np.arange(ends[0], ends[-1] + 1)
        return Path(ends[0], np.stack([np.interp(steps, ends, places[:, axis]) for axis in range(2)], axis=1))

    def _moves(self, steps: int) -> np.ndarray:
        """Return moves (H, 2) [columns and rows]: that of length 0, and those of about the distance of some steps."""
        reach = steps * self.moved * (1 + _ROUNDING)
        columns, rows = (np.arange(-most, most + 1) for most in (reach / self.spacing).astype(int))
        moves = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        length = np.linalg.norm(moves * self.spacing, axis=1)
        is_ring = (length > max(reach - self.spacing.max(), 0)) & (length <= reach)
        return np.concatenate([np.zeros((1, 2), dtype=int), moves[is_ring]])
