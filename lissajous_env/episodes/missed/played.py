"""Episodes as data for a rogue that knows the future, and paths of rogues, replayed in them as ordinary targets."""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from lissajous_env.episodes.evaluation import ActingPolicy, EpisodeRunner
from lissajous_env.parameters import named
from lissajous_env.parameters.extensions import TargetMotion, target_motion
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import WORST_CASE
from lissajous_env.world.selection import of_world
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import HIDDEN, NEVER, PRESENT


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
    oldest: np.ndarray
    """(T + 1,) earliest introduction of any target that can be undetected [step], NEVER if there is none."""

    @property
    def steps(self) -> int:
        """T."""
        return len(self.works) - 1

    def longest_rogues(self) -> list[tuple[int, int]]:
        """Return (introduction, last step at which it is undetected) of the stage's rogues, the longest first."""
        last = {int(since): now for now, since in enumerate(self.oldest) if since < NEVER}
        return sorted(last.items(), key=lambda rogue: rogue[0] - rogue[1])


def sensing_robots(simulation: Simulation) -> np.ndarray:
    """Return (W, N) True for the robots that sensed in the latest step; none in a world without that step."""
    return (simulation.latest.sensed.numpy() == 1) & (simulation.clock.active.numpy() == 1)[:, None]


def check_contamination(scenario: str | Scenario) -> None:
    """Raise ValueError if `task.contamination` of a scenario is None."""
    scenario = named.build(scenario)
    if scenario.task.contamination is None:
        raise ValueError(f"task.contamination of {scenario.name} must be (columns, rows), got None")


def play(policy: ActingPolicy, scenario: str | Scenario, seed: int = 0, device: Any = "cpu") -> PlayedEpisode:
    """Play an episode and copy the tracks of the sensors; a policy for several worlds plays it in each of them.

    Raises:
        ValueError: `task.contamination` of the scenario is None, or the seed is invalid.
    """
    scenario = named.build(scenario)
    check_contamination(scenario)
    scenario = replace(scenario, task=replace(scenario.task, conservative=False))
    simulation = Simulation(scenario, policy.num_worlds, device=device)
    moments: list[tuple[np.ndarray, ...]] = []

    def copy(taken: int) -> None:
        path, action = of_world(simulation.robots.path, 0)[..., :2], of_world(simulation.action, 0)
        works, oldest = sensing_robots(simulation)[0], of_world(simulation.contamination.oldest, 0)
        moments.append((path, works, action if taken else np.zeros_like(action), oldest))

    EpisodeRunner(policy, simulation).play([seed], copy)
    steps = int(of_world(simulation.clock.step, 0))
    arrays = [np.stack(array)[: steps + 1] for array in zip(*moments, strict=True)]
    return PlayedEpisode(scenario, seed, simulation.score([0])[0], *arrays)


def crossing_steps(scenario: Scenario) -> int:
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


def replay(played: PlayedEpisode, path: Path, device: Any = "cpu") -> tuple[float, bool, float]:
    """Repeat an episode by its actions, with a rogue as the only target; after the end of its path it does not move.

    Returns:
        Time from its appearance to its detection, or to the end of the episode [s], whether it was detected, and the
        worst-case undetected time of `task.conservative`, which no rogue exceeds [s].

    Raises:
        RuntimeError: the robots do not move as they did.
    """
    moments = np.arange(played.steps + 1)
    table = path.places[np.clip(moments - path.appears_at, 0, path.steps)]  # it waits before its path, too

    def follow(world: Any) -> np.ndarray:
        """Move the first target along its table."""
        places = world.targets.position.copy()
        places[:, 0] = table[np.minimum(world.clock.step, played.steps)]
        return places

    simulation = Simulation(_with_rogue(played.scenario, target_motion(follow)), device=device)
    simulation.reset(seeds=[played.seed])
    _introduce(simulation, path)
    for now in moments[1:].tolist():
        simulation.step(played.action[now][None])
        if (of_world(simulation.robots.path, 0)[..., :2] != played.path[now]).any():
            raise RuntimeError(f"robots must move as in the first run, but do not in step {now} of seed {played.seed}")
    (row,), (times, detected) = simulation.score(), simulation.detection_times(0)
    return float(times[0]), bool(detected[0]), float(row[WORST_CASE.name])


def _with_rogue(scenario: Scenario, motion: TargetMotion) -> Scenario:
    """Return a scenario whose targets move along a table, with the proved bound of its worst case."""
    inside = scenario.targets.entry if scenario.targets.entry == "boundary" else "inside"
    moved = {"drifting": 0.0, "wandering": 0.0, "fleeing": 0.0, "custom": 1.0, "speed_limit": scenario.rogue_speed}
    targets = replace(scenario.targets, entry=inside, rogues=None, respawn=False, **moved)
    return replace(scenario, targets=targets, task=replace(scenario.task, conservative=True), extensions=(motion,))


def _introduce(simulation: Simulation, path: Path) -> None:
    """Let the first target be a rogue, and no other target appear."""
    targets = simulation.targets
    is_rogue = np.arange(targets.status.size)[None] == 0
    targets.appears_at.assign(np.where(is_rogue, path.appears_at, NEVER))
    targets.status.assign(np.where(is_rogue & (path.appears_at == 0), PRESENT, HIDDEN))
    targets.found_at.fill_(NEVER)
    targets.found_early.zero_()
    targets.in_sight.zero_()
    position = targets.position.numpy().copy()
    position[:, 0] = path.places[0]
    targets.position.assign(position)
    targets.before.assign(position)
