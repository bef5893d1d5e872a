"""Episodes whose contamination is computed with larger discs: a lower bound of the worst case.

A rogue of the stage is on a node until it hops, so its position is right to about a cell. Where the worst case depends
on whether it passes a gap that is narrower, the stage may be wrong by any time. Discs that are larger by
`certain_increase` close such gaps, so the time that the stage computes with them is a lower bound of the worst case:

* The nodes of a rogue of the stage make a way at the speed limit u, of straight hops whose length is at most h, sqrt(5)
  times the spacing of nodes. Let a rogue follow it later by a constant time h / 2 u. While the stage's rogue is on a
  node, the other is at most h / 2 from it: it comes to it within this time, and leaves it when at most h / 2 of the
  next hop is left for the stage's rogue.
* Labels are rounded to 1/255 tick for each hop, so the stage has a speed limit that is lower by as much. A rogue that
  appears between two ticks counts from the first one: it is later by a tick. Those of the beginning may be on a hop
  then: they are later by the longest.
* At the end of each step, no disc covers the node. Between two steps, the stage's rogue may change from one node to the
  next, so a place of the rogue in that step is at most h / 2 and a step's way of the rogue from nodes that are free at
  the beginning and at the end of the step. A disc that leaves a place free at both ends of its way comes nearer to it
  within the step by at most c^2 / 8 r, with c the length of its way, and by as much as the way is not straight. A robot
  that resumes stood still before.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lissajous_env.episodes.witness.played import Played, Watcher
from lissajous_env.episodes.witness.replayed import check_same_track
from lissajous_env.parameters.spreading import TICK_FRACTIONS
from lissajous_env.world.simulation import Simulation

_STILL = {"drifting": 0.0, "wandering": 0.0, "fleeing": 0.0, "custom": 0.0}
_LONGEST = 5**0.5
"""Length of the longest hop, in spacings of nodes."""


def certain_increase(episodes: Sequence[Played]) -> float:
    """Return by how much larger discs must be for a lower bound of the worst case of episodes of one scenario [m]."""
    scenario = episodes[0].scenario
    hops, moved = scenario.spreading, scenario.rogue_speed * scenario.task.step
    track = np.stack([each.track for each in episodes]).astype(float)
    share = np.linspace(0, 1, track.shape[3])[:, None]
    way = track[..., -1:, :] - track[..., :1, :]
    astray = np.linalg.norm(track - track[..., :1, :] - share * way, axis=-1).max(axis=-1)
    nearer = np.linalg.norm(way[..., 0, :], axis=-1) ** 2 / (8 * scenario.sensing_radius) + astray
    works = np.stack([each.works for each in episodes])
    longest = _LONGEST * spacing_of(episodes[0])
    late = hops.period * moved if hops.period > 1 else 0.0
    late += longest if scenario.targets.count > 0 else 0.0
    return longest / 2 + late + moved / hops.ticks + float(nearer.max(where=works, initial=0.0))


def with_larger_discs(episodes: Sequence[Played], more: float) -> list[Played]:
    """Repeat episodes of one scenario by their actions, with discs that are larger by some length [m].

    Raises:
        RuntimeError: the robots do not move as they did.
    """
    scenario = episodes[0].scenario
    speed = scenario.rogue_speed * (1 - 1 / TICK_FRACTIONS)
    larger = replace(
        scenario,
        sensing=replace(scenario.sensing, radius=scenario.sensing_radius + more),
        targets=replace(scenario.targets, rogues=None, speed_limit=speed, **_STILL),
    )
    simulation = Simulation(larger, len(episodes))
    watcher = Watcher(simulation)
    simulation.reset(seeds=[each.seed for each in episodes])
    watcher.keep(0)
    for now in range(1, episodes[0].steps + 1):
        simulation.step(np.stack([each.action[now] for each in episodes]))
        check_same_track(simulation, episodes, now)
        watcher.keep(now)
    return watcher.episodes([each.seed for each in episodes])


def spacing_of(played: Played) -> float:
    """Return the distance between nodes of the contamination grid [m]."""
    hops, curve = played.scenario.spreading, played.scenario.curve
    between = hops.columns - 1 + 2 * hops.inset, hops.rows - 1 + 2 * hops.inset
    return 2 * max(curve.half_width / between[0], curve.half_height / between[1])
