"""Search for the way of a rogue that knows the robots' future and stays undetected for longest."""

from typing import NamedTuple

import numpy as np

from lissajous_env.episodes.witness.lattice import COARSE, FINE, Fineness, Window, lattice_of, packed, unpacked
from lissajous_env.episodes.witness.played import Played, Way, peaks, resolution

_ROUNDING = 2e-6
"""Share of all lengths by which discs are made larger, for numbers of 32 bits."""
_TOGETHER = 64
"""Number of moves that are tested together."""
_TRIED = {COARSE: 4, FINE: 2}
"""Number of the stage's worst rogues that are tried on each lattice before a search of all times."""


class Reached(NamedTuple):
    """Nodes in which a rogue is undetected that appeared at the first moment."""

    moments: list[int]
    """Ends of its moves [step]."""
    nodes: list[Window]
    """Nodes at these moments."""

    @property
    def time(self) -> int:
        """Time from the first moment to the last; -1 if it is detected at once [step]."""
        return self.moments[-1] - self.moments[0] if self.nodes[-1].bits.any() else -1


_NOBODY = Reached([0], [Window(0, 0, np.zeros((0, 0), dtype=np.uint64))])


class Search:
    """Nodes of a lattice in which a rogue can be undetected in an episode.

    A move lasts one or several steps, in which the rogue goes straight at one speed. Two rules allow moves:

    * Relative to a robot whose way is straight too, a rogue moves by at most L, its distance and the robot's. If it is
      at least sqrt(r^2 + L^2 / 4) from it at both ends, it is never nearer than r: half a chord and the distance from
      the centre make a right angle. The distance by which the robot's way is not straight is added to r.
    * Where robots are so fast that this wastes more than the spacing of the lattice, moves in 16 directions and none
      are tested one by one, by the least distance on the way.

    Both are safe, so that every way is undetected; moves that neither allows are lost.

    Args:
        played: The episode.
        fineness: Rules for the lattice.
    """

    def __init__(self, played: Played, fineness: Fineness = COARSE):
        scenario = played.scenario
        self.played = played
        self.moved = scenario.rogue_speed * scenario.task.step
        half = scenario.curve.half_width, scenario.curve.half_height
        cells = scenario.task.contamination or (1, 1)
        self.lattice, self.period = lattice_of(half, cells, self.moved, played.steps, fineness)
        entries = self.lattice.boundary if scenario.targets.entry == "boundary" else self.lattice.everywhere
        self.entries = Window(0, 0, entries)
        self.radius = scenario.sensing_radius + _ROUNDING * (sum(half) + scenario.sensing_radius)

    def ways(self, begin: int, end: int) -> np.ndarray:
        """Return the positions (robots, pieces + 1, 2) of the sensors in a move, at equal times [m]."""
        works = self.played.works[begin + 1 : end + 1].any(axis=0)
        track = self.played.track[begin + 1 : end + 1, works].astype(np.float64)
        pieces = track[:, :, 1:].transpose(1, 0, 2, 3).reshape(track.shape[1], -1, 2)
        return np.concatenate([track[0, :, :1], pieces], axis=1)

    def radii(self, ways: np.ndarray, distance: float) -> np.ndarray:
        """Return the radii of discs at the ends of ways outside of which any move of a rogue is undetected [m]."""
        share = np.linspace(0, 1, ways.shape[1])[:, None]
        straight = ways[:, :1] + share * (ways[:, -1:] - ways[:, :1])
        astray = np.linalg.norm(ways - straight, axis=-1).max(axis=1)
        length = np.linalg.norm(ways[:, -1] - ways[:, 0], axis=-1) + distance
        return np.hypot(self.radius + astray, length / 2)

    def undetected(self, before: np.ndarray, after: np.ndarray, ways: np.ndarray) -> np.ndarray:
        """Return whether straight moves (M, 2) to (M, 2) are undetected by sensors on their ways [m]."""
        if not len(before):
            return np.zeros(0, dtype=bool)
        low = np.minimum(before, after).min(axis=0) - self.radius
        high = np.maximum(before, after).max(axis=0) + self.radius
        ways = ways[((ways.max(axis=1) >= low) & (ways.min(axis=1) <= high)).all(axis=1)]
        share = np.linspace(0, 1, ways.shape[1])
        x, y = (before[:, k, None, None] + share * (after - before)[:, k, None, None] - ways[..., k] for k in range(2))
        across, up = np.diff(x, axis=2), np.diff(y, axis=2)  # (M, robots, pieces)
        x, y = x[..., :-1], y[..., :-1]
        share = np.clip(-(x * across + y * up) / np.maximum(across**2 + up**2, 1e-30), 0, 1)
        least = (x + share * across) ** 2 + (y + share * up) ** 2
        return np.all(least >= self.radius**2, axis=(1, 2))

    def entered(self, step: int) -> Window:
        """Return the nodes at which a rogue that appears at the end of a step is undetected."""
        played, targets = self.played, self.played.scenario.targets
        if (targets.arrival_rate if step > 0 else targets.count) == 0:
            return Window(0, 0, np.zeros_like(self.entries.bits))
        places = played.track[step, played.works[step], -1].astype(np.float64)
        return Window(0, 0, self.lattice.clear(self.entries, places, np.full(len(places), self.radius)))

    def ends(self, begin: int) -> int:
        """Return the step at which a move that begins in a step ends."""
        return min((begin // self.period + 1) * self.period, self.played.steps)

    def move(self, window: Window, begin: int, end: int) -> Window:
        """Return the nodes that a rogue reaches by a move over some steps."""
        lattice, distance, ways = self.lattice, (end - begin) * self.moved, self.ways(begin, end)
        radii, wide = self.radii(ways, distance), lattice.widened(window, distance)
        leaves = lattice.clear(wide, ways[:, 0], radii)
        reached = wide._replace(bits=lattice.inside(wide._replace(bits=lattice.spread(leaves, distance))))
        bits = lattice.clear(reached, ways[:, -1], radii)
        if (radii - self.radius).max(initial=0.0) > max(lattice.spacing):
            bits |= self._past_fast_robots(wide, bits, ways, distance)
        return lattice.widened(wide._replace(bits=bits), 0.0)

    def _past_fast_robots(self, wide: Window, known: np.ndarray, ways: np.ndarray, distance: float) -> np.ndarray:
        """Return the bits of further nodes of a window that moves in several directions reach undetected."""
        lattice, radii = self.lattice, np.full(len(ways), self.radius)
        leaves = lattice.clear(wide, ways[:, 0], radii)
        reached = lattice.inside(wide._replace(bits=lattice.spread(leaves, distance)))
        hoped = lattice.clear(wide._replace(bits=reached), ways[:, -1], radii) & ~known
        here, nodes, corner = unpacked(leaves), np.argwhere(unpacked(hoped)), np.array([wide.row, 64 * wide.word])
        found = np.zeros_like(here)
        for vector in lattice.vectors(distance):
            from_here = nodes - vector
            fits = ((from_here >= 0) & (from_here < here.shape)).all(axis=1)
            fits[fits] = here[tuple(from_here[fits].T)]
            before, after = (lattice.places(each[fits] + corner) for each in (from_here, nodes))
            fits[fits] = self.undetected(before, after, ways)
            found[tuple(nodes[fits].T)] = True
            nodes = nodes[~fits]
        return packed(found)

    def latest(self, since: int) -> Reached:
        """Return the nodes of a rogue that appears at the end of a step, until it is detected wherever it goes."""
        moments, nodes = [since], [self.lattice.widened(self.entered(since), 0.0)]
        while moments[-1] < self.played.steps and nodes[-1].bits.any():
            begin = moments[-1]
            end = self.ends(begin)
            new = self.move(nodes[-1], begin, end)
            while not new.bits.any() and end > begin + 1:
                end -= 1
                new = self.move(nodes[-1], begin, end)
            if not new.bits.any():
                break
            moments.append(end)
            nodes.append(new)
        return Reached(moments, nodes)

    def oldest(self) -> tuple[int, int]:
        """Return introduction and last undetected moment of the rogue that is undetected for longest in any moves."""
        lattice, steps = self.lattice, self.played.steps
        everywhere = Window(0, 0, lattice.everywhere)
        none = 2**15 - 1 if steps < 2**15 - 1 else 2**31 - 1
        labels = np.full((lattice.rows, lattice.columns), none, dtype=np.int16 if none < 2**15 else np.int32)
        labels[lattice.table(self.entered(0))] = 0
        best, now = (0, -1), 0
        while True:
            oldest = int(labels.min())
            if oldest < none and now - oldest > best[1] - best[0]:
                best = oldest, now
            if now == steps:
                return best
            end = self.ends(now)
            ways = self.ways(now, end)
            radii = self.radii(ways, (end - now) * self.moved)
            labels[~lattice.table(Window(0, 0, lattice.clear(everywhere, ways[:, 0], radii)))] = none
            labels = lattice.spread_least(labels, (end - now) * self.moved)
            labels[~lattice.table(Window(0, 0, lattice.clear(everywhere, ways[:, -1], radii)))] = none
            np.minimum(labels, end, out=labels, where=lattice.table(self.entered(end)))
            now = end

    def way(self, reached: Reached) -> Way:
        """Trace a way back from the last moment."""
        moments = reached.moments
        nodes = [self._last(moments[-1], reached.nodes[-1])]
        for k in range(len(moments) - 2, -1, -1):
            nodes.append(self._before(nodes[-1], reached.nodes[k], *moments[k : k + 2]))
        places = self.lattice.places(np.array(nodes[::-1], dtype=float))
        steps = np.arange(moments[0], moments[-1] + 1)
        return Way(moments[0], np.stack([np.interp(steps, moments, places[:, axis]) for axis in range(2)], axis=1))

    def _before(self, node: np.ndarray, window: Window, begin: int, end: int) -> np.ndarray:
        """Return the nearest node of a window from which a rogue can have moved to a node."""
        reach = self.lattice.widths((end - begin) * self.moved)
        top, bottom = window.row, window.row + len(window.bits)
        rows = np.arange(max(node[0] - len(reach) + 1, top), min(node[0] + len(reach), bottom))
        columns = np.arange(max(node[1] - reach[0], 64 * window.word), node[1] + reach[0] + 1)
        columns = columns[columns < 64 * (window.word + window.bits.shape[1])]
        words = window.bits[rows[:, None] - top, columns // 64 - window.word]
        can = words >> (columns % 64).astype(np.uint64) & np.uint64(1) == 1
        can &= abs(columns - node[1]) <= np.array(reach)[abs(rows - node[0])][:, None]
        found = np.argwhere(can) + np.array([rows[0], columns[0]])
        away = np.linalg.norm((found - node) * self.lattice.spacing[::-1], axis=1)
        found = found[np.argsort(away, kind="stable")]
        place, ways = self.lattice.places(node[None]), self.ways(begin, end)
        for first in range(0, len(found), _TOGETHER):
            some = found[first : first + _TOGETHER]
            fits = self.undetected(self.lattice.places(some), place, ways)
            if fits.any():
                return some[np.argmax(fits)]
        raise RuntimeError(
            "the path of a rogue must have a predecessor in each step, "
            f"but has none in step {end} of seed {self.played.seed}"
        )

    def _last(self, moment: int, window: Window) -> np.ndarray:
        """Return the node that is farthest from all sensors a step later."""
        nodes = np.argwhere(self.lattice.table(window))
        then = min(moment + 1, self.played.steps)
        away = np.full(len(nodes), np.inf)
        for place in self.played.track[then, self.played.works[then], -1].astype(np.float64):
            away = np.minimum(away, np.linalg.norm(self.lattice.places(nodes) - place, axis=1))
        return nodes[np.argmax(away)]


def longest_way(played: Played, thorough: bool = False) -> Way | None:
    """Return the longest way found, None if no target can be undetected at the end of any step.

    Args:
        played: The episode.
        thorough: True to search all times, also where the stage's rogue is undetected until its end.
    """
    coarse, worst = Search(played), peaks(played)
    search, longest = coarse, _NOBODY
    for fineness in (COARSE, FINE):
        trial = coarse if fineness is COARSE else Search(played, fineness)
        for since, until in worst[: _TRIED[fineness]]:
            if until - since <= longest.time + (resolution(played.scenario) if longest.time >= 0 else -1):
                break
            reached = trial.latest(since)
            if reached.time > longest.time:
                search, longest = trial, reached
        if worst and longest.time + resolution(played.scenario) >= worst[0][1] - worst[0][0] and not thorough:
            return search.way(longest)
    since, until = coarse.oldest()
    if until - since > longest.time:
        search, longest = coarse, coarse.latest(since)
    return search.way(longest) if longest.time >= 0 else None
