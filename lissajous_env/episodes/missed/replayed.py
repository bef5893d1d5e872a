"""Paths of rogues, replayed in the same worlds as ordinary targets, which the simulation detects."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from lissajous_env.episodes.missed.played import Played
from lissajous_env.episodes.missed.search import Path
from lissajous_env.episodes.recording import Recorder, Recording
from lissajous_env.parameters.extensions import TargetMotion, target_motion
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import WORST_CASE
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import HIDDEN, NEVER, PRESENT

_TESTED = 10
"""Steps after which the tracks of the robots are compared."""


class Replayed(NamedTuple):
    """A rogue as the simulation detected it."""

    undetected: float
    """Time from its appearance to its detection, or to the end of the episode [s]."""
    detected: bool
    proved: float
    """Worst-case undetected time of `task.conservative`, which no rogue exceeds [s]."""


def replay(pairs: Sequence[tuple[Played, Path]], device: Any = "cpu") -> list[Replayed]:
    """Repeat episodes of one scenario by their actions, each with its rogue as the only target.

    Args:
        pairs: Episodes and the path of the rogue in each of them; after its end the rogue does not move.
        device: Warp device of the simulation.

    Raises:
        RuntimeError: the robots do not move as they did.
    """
    episodes, paths = zip(*pairs, strict=True)
    steps = max(each.steps for each in episodes)
    table = np.stack([_places(path, steps) for path in paths])

    def follow(world: Any) -> np.ndarray:
        """Move the first target of each world along its table."""
        places = world.targets.position.copy()
        places[:, 0] = table[np.arange(len(table)), np.minimum(world.clock.step, steps)]
        return places

    scenario = _with_rogue(episodes[0].scenario, target_motion(follow))
    simulation = Simulation(scenario, len(episodes), device=device)
    simulation.reset(seeds=[each.seed for each in episodes])
    _introduce(simulation, paths)
    for now in range(1, steps + 1):
        simulation.step(np.stack([each.action[min(now, each.steps)] for each in episodes]))
        _check_same_track(simulation, episodes, now)
    rows = simulation.score()
    replays = []
    for w, row in enumerate(rows):
        times, detected = simulation.detection_times(w)
        replays.append(Replayed(float(times[0]), bool(detected[0]), float(row[WORST_CASE.name])))
    return replays


def _check_same_track(simulation: Simulation, episodes: Sequence[Played], now: int) -> None:
    """Raise a RuntimeError if a robot does not move as in the first run in a step, up to the end of its episode.

    A robot that has moved otherwise does not come back to its track, so every tenth step is tested.
    """
    if now % _TESTED:
        return
    recorded = np.stack([each.track[min(now, each.steps)] for each in episodes])
    same = (simulation.robots.track.numpy()[..., :2] == recorded).all(axis=(1, 2, 3))
    same |= np.array([now > each.steps for each in episodes])
    if not same.all():
        seed = episodes[int(np.argmin(same))].seed
        raise RuntimeError(f"robots must move as in the first run, but do not in step {now} of seed {seed}")


def record_again(played: Played, policy: str) -> Recording:
    """Record an episode by its actions."""
    simulation = Simulation(played.scenario)
    simulation.reset(seeds=[played.seed])
    recorder = Recorder(simulation)
    recorder.take()
    for action in played.action[1:]:
        simulation.step(action[None])
        recorder.take()
    return recorder.recording(policy)


def _with_rogue(scenario: Scenario, motion: TargetMotion) -> Scenario:
    """Return a scenario whose targets move along a table, with the proved bound of its worst case."""
    inside = scenario.targets.entry if scenario.targets.entry == "boundary" else "inside"
    moved = {"drifting": 0.0, "wandering": 0.0, "fleeing": 0.0, "custom": 1.0, "speed_limit": scenario.rogue_speed}
    targets = replace(scenario.targets, entry=inside, rogues=None, **moved)
    return replace(scenario, targets=targets, task=replace(scenario.task, conservative=True), extensions=(motion,))


def _places(path: Path, steps: int) -> np.ndarray:
    """Return the place of a rogue (steps + 1, 2) at each moment; it waits before and after its path."""
    return path.places[np.clip(np.arange(steps + 1) - path.appears_at, 0, path.steps)]


def _introduce(simulation: Simulation, paths: Sequence[Path]) -> None:
    """Let the first target of each world be its rogue, and no other target appear."""
    targets = simulation.targets
    shape = targets.stage.shape
    first = np.array([path.places[0] for path in paths], dtype=np.float32)
    appears, stage = np.full(shape, int(NEVER), dtype=np.int32), np.full(shape, int(HIDDEN), dtype=np.int32)
    appears[:, 0] = [path.appears_at for path in paths]
    stage[appears[:, 0] == 0, 0] = int(PRESENT)
    targets.appears_at.assign(appears)
    targets.stage.assign(stage)
    targets.found_at.assign(np.full(shape, int(NEVER), dtype=np.int32))
    targets.found_early.zero_()
    targets.in_sight.zero_()
    position = targets.position.numpy().copy()
    position[:, 0] = first
    targets.position.assign(position)
    targets.before.assign(position)
