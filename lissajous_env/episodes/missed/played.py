"""Episodes as data for a rogue that knows the future, and paths of rogues, replayed in them as ordinary targets."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from lissajous_env.episodes.evaluation import ActingPolicy, EpisodeRunner
from lissajous_env.episodes.recording import Recorder, Recording
from lissajous_env.parameters import named
from lissajous_env.parameters.extensions import TargetMotion, target_motion
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import WORST_CASE
from lissajous_env.world.selection import fold_seed
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import HIDDEN, NEVER, NOWHERE, PRESENT

_TESTED = 10
"""Steps after which the tracks of the robots are compared."""


@dataclass(frozen=True, eq=False)
class PlayedEpisode:
    """A played episode. T steps, N robots, S sub-steps, A components of an action."""

    scenario: Scenario
    """The scenario."""
    seed: int
    """Seed of the world."""
    score: dict[str, Any]
    """Score row of the episode."""
    path: np.ndarray
    """(T + 1, N, S + 1, 2) positions of the robots through the step that led to a moment [m]."""
    works: np.ndarray
    """(T + 1, N) bool: robots that sense in that step."""
    action: np.ndarray
    """(T + 1, N, A) float32 actions of that step, zero at the reset."""
    introduced_at: np.ndarray
    """(T + 1,) earliest introduction of any target that can be undetected [step], NEVER if there is none."""

    @property
    def steps(self) -> int:
        """T."""
        return len(self.works) - 1

    def oldest_rogues(self) -> list[tuple[int, int]]:
        """Return (introduction, last step at which it is undetected) of the stage's rogues, the longest first."""
        last = {int(since): now for now, since in enumerate(self.introduced_at) if since < int(NEVER)}
        return sorted(last.items(), key=lambda rogue: rogue[0] - rogue[1])


class SensingRobots:
    """Robots that sense in the steps of a simulation, also those that a collision or the edge stops at a step's end."""

    def __init__(self) -> None:
        self._worked: Any = True

    def of_step(self, simulation: Simulation) -> np.ndarray:
        """Return (W, N) True for the robots that sensed in the latest step; called after the reset and each step."""
        robots, latest, task = simulation.robots, simulation.latest, simulation.scenario.task
        senses = robots.sensor.numpy()[..., 0] < 0.5 * NOWHERE
        stopped = (latest.collisions.numpy() > 0) & (task.on_collision != "count")
        stopped |= (latest.outside.numpy() == 1) & (task.boundary == "remove")
        resumed = robots.resumed_at.numpy() == simulation.clock.step.numpy()[:, None] - 1
        worked, self._worked = self._worked, senses
        return senses | (stopped & (worked | resumed))


def check_contamination(scenario: str | Scenario) -> None:
    """Raise ValueError if `task.contamination` of a scenario is None."""
    scenario = named.build(scenario)
    if scenario.task.contamination is None:
        raise ValueError(f"task.contamination of {scenario.name} must be (columns, rows), got None")


def play(
    policy: ActingPolicy, scenario: str | Scenario, seeds: Sequence[int], device: Any = "cpu"
) -> list[PlayedEpisode]:
    """Play an episode in each world of a policy and copy the tracks of the sensors.

    Raises:
        ValueError: `task.contamination` of the scenario is None.
    """
    scenario = named.build(scenario)
    check_contamination(scenario)
    scenario = replace(scenario, task=replace(scenario.task, conservative=False))
    simulation, folded = Simulation(scenario, policy.num_worlds, device=device), [fold_seed(seed) for seed in seeds]
    sensing = SensingRobots()
    moments: list[tuple[np.ndarray, ...]] = []

    def copy(taken: int) -> None:
        robots, action = simulation.robots, simulation.action.numpy()
        moments.append(
            (
                robots.path.numpy()[..., :2].copy(),
                sensing.of_step(simulation),
                action.copy() if taken else np.zeros_like(action),
                simulation.contamination.oldest.numpy().copy(),
            )
        )

    EpisodeRunner(policy, simulation).play(folded, copy)
    steps, rows = simulation.clock.step.numpy(), simulation.score()
    arrays = [np.stack(array, axis=1) for array in zip(*moments, strict=True)]
    return [
        PlayedEpisode(scenario, seed, row, *(array[w, : steps[w] + 1] for array in arrays))
        for w, (seed, row) in enumerate(zip(folded, rows, strict=True))
    ]


def resolution(scenario: Scenario) -> int:
    """Return the time in which a rogue crosses a cell of the contamination grid, at least a step [step]."""
    columns, rows = scenario.task.contamination or (1, 1)
    side = 2 * max(scenario.curve.half_width / columns, scenario.curve.half_height / rows)
    moved = scenario.rogue_speed * scenario.task.step
    return max(min(math.ceil(side / moved), scenario.task.steps), 1) if moved > 0 else 1


class Path(NamedTuple):
    """A rogue's path: it appears at the end of a step and is undetected at the end of all steps until the last."""

    appears_at: int
    """Step at whose end it appears."""
    places: np.ndarray
    """(K + 1, 2) its positions at the ends of the steps from then on [m]."""

    @property
    def steps(self) -> int:
        """K, the number of control steps for which it is undetected."""
        return len(self.places) - 1


class Replayed(NamedTuple):
    """A rogue as the simulation detected it."""

    undetected: float
    """Time from its appearance to its detection, or to the end of the episode [s]."""
    detected: bool
    upper_bound: float
    """Worst-case undetected time of `task.conservative`, which no rogue exceeds [s]."""


def replay(pairs: Sequence[tuple[PlayedEpisode, Path]], device: Any = "cpu") -> list[Replayed]:
    """Repeat episodes of one scenario by their actions, each with its rogue as the only target.

    Args:
        pairs: Episodes and the path of the rogue in each of them; after its end the rogue does not move.
        device: Warp device of the simulation.

    Raises:
        RuntimeError: the robots do not move as they did.
    """
    episodes, paths = zip(*pairs, strict=True)
    steps = max(episode.steps for episode in episodes)
    table = np.stack([_places(path, steps) for path in paths])

    def follow(world: Any) -> np.ndarray:
        """Move the first target of each world along its table."""
        places = world.targets.position.copy()
        places[:, 0] = table[np.arange(len(table)), np.minimum(world.clock.step, steps)]
        return places

    scenario = _with_rogue(episodes[0].scenario, target_motion(follow))
    simulation = Simulation(scenario, len(episodes), device=device)
    simulation.reset(seeds=[episode.seed for episode in episodes])
    _introduce(simulation, paths)
    for now in range(1, steps + 1):
        simulation.step(np.stack([episode.action[min(now, episode.steps)] for episode in episodes]))
        _check_same_track(simulation, episodes, now)
    rows = simulation.score()
    replays = []
    for w, row in enumerate(rows):
        times, detected = simulation.detection_times(w)
        replays.append(Replayed(float(times[0]), bool(detected[0]), float(row[WORST_CASE.name])))
    return replays


def _check_same_track(simulation: Simulation, episodes: Sequence[PlayedEpisode], now: int) -> None:
    """Raise a RuntimeError if a robot does not move as in the first run in a step, up to the end of its episode.

    A robot that has moved otherwise does not come back to its path, so every tenth step is tested.
    """
    if now % _TESTED:
        return
    recorded = np.stack([episode.path[min(now, episode.steps)] for episode in episodes])
    same = (simulation.robots.path.numpy()[..., :2] == recorded).all(axis=(1, 2, 3))
    same |= np.array([now > episode.steps for episode in episodes])
    if not same.all():
        seed = episodes[int(np.argmin(same))].seed
        raise RuntimeError(f"robots must move as in the first run, but do not in step {now} of seed {seed}")


def record_again(played: PlayedEpisode, policy: str) -> Recording:
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
    targets = replace(scenario.targets, entry=inside, rogues=None, respawn=False, **moved)
    return replace(scenario, targets=targets, task=replace(scenario.task, conservative=True), extensions=(motion,))


def _places(path: Path, steps: int) -> np.ndarray:
    """Return the place of a rogue (steps + 1, 2) at each moment; it waits before and after its path."""
    return path.places[np.clip(np.arange(steps + 1) - path.appears_at, 0, path.steps)]


def _introduce(simulation: Simulation, paths: Sequence[Path]) -> None:
    """Let the first target of each world be its rogue, and no other target appear."""
    targets = simulation.targets
    shape = targets.status.shape
    first = np.array([path.places[0] for path in paths], dtype=np.float32)
    appears, status = np.full(shape, int(NEVER), dtype=np.int32), np.full(shape, int(HIDDEN), dtype=np.int32)
    appears[:, 0] = [path.appears_at for path in paths]
    status[appears[:, 0] == 0, 0] = int(PRESENT)
    targets.appears_at.assign(appears)
    targets.status.assign(status)
    targets.found_at.assign(np.full(shape, int(NEVER), dtype=np.int32))
    targets.found_early.zero_()
    targets.in_sight.zero_()
    position = targets.position.numpy().copy()
    position[:, 0] = first
    targets.position.assign(position)
    targets.before.assign(position)
