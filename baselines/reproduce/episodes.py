"""Episodes of a batch of worlds as arrays over time; a batch that several parts of the paper need is played once."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from baselines.policies.settings import PolicySettings
from lissajous_env import scenario as make_scenario
from lissajous_env.episodes.evaluation import EpisodeRunner
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory import closed_forms
from lissajous_env.world.columns import Column
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import FAILED
from lissajous_env.world.tally import RECOVERED

SEEDS = 16
"""Default number of episodes for a claim about one run of the paper."""

BARE: dict[str, Any] = {
    "targets.count": 0,
    "targets.arrival_rate": 0.0,
    "task.grid": None,
    "faults.schedule": (),
    "robot.phase_rate_max": 10.0,
}
"""Overrides that leave only robots and dynamics (1), with points as fast as (1) may require."""


@dataclass(frozen=True, eq=False)
class EpisodeArrays:
    """W episodes of F frames: the reset, and the end of each control step."""

    scenario: Scenario
    scores: list[dict[str, Any]]
    """Score row of each world."""
    phase: np.ndarray
    """(F, W, N) theta [rad], in [0, 2 pi)."""
    position: np.ndarray
    """(F, W, N, 3) [m]."""
    heading: np.ndarray
    """(F, W, N) [rad]."""
    failed: np.ndarray
    """(F, W, N) True where a robot has failed."""
    deviation: np.ndarray
    """(F, W) largest deviation from the equilibrium of the scenario [rad], the common rotation removed."""
    detection_times: list[np.ndarray]
    """For each world, the time from each target's appearance until it was detected, or until the end (K,) [s]."""
    detected: list[np.ndarray]
    """For each world, True for each of these targets (K,) that was detected."""

    @property
    def time(self) -> np.ndarray:
        """Return the time of each frame (F,) [s]."""
        return np.arange(len(self.phase)) * self.scenario.task.step

    @property
    def ring_phases(self) -> np.ndarray:
        """Return the relative phase of the next robot (F, W, N) in [0, 2 pi) [rad], in the order of the ring."""
        ordered = self.phase[..., list(self.scenario.ring)]
        return (np.roll(ordered, -1, axis=-1) - ordered) % (2 * np.pi)

    @property
    def winding(self) -> np.ndarray:
        """Return the winding number of the phases along the ring (F, W): p in an equilibrium (2)."""
        return np.rint(self.ring_phases.sum(axis=-1) / (2 * np.pi)).astype(int)

    @property
    def largest_cosine(self) -> np.ndarray:
        """Return the largest cos(theta_j - theta_i) of ring neighbours while a robot has failed (W,).

        Theorem 4 requires it to be below 0; later, a formation on its way to another equilibrium always violates this.
        """
        return np.cos(self.ring_phases[self.failed.any(axis=(1, 2))]).max(axis=(0, 2))

    @property
    def returned(self) -> np.ndarray:
        """Return whether the formation is in its equilibrium at the end (W,)."""
        return self.deviation[-1] < RECOVERED

    def distance(self, one: Any, other: Any) -> np.ndarray:
        """Return the distance of two robots (F, W) [m], or of the pairs (P,) of robots (F, W, P)."""
        return np.linalg.norm(self.position[:, :, one] - self.position[:, :, other], axis=-1)

    def tracking_error(self, robot: int) -> np.ndarray:
        """Return the distance of a robot from the point of the curve at its own phase (F, W) [m]."""
        point = closed_forms.curve_point(self.scenario.driven, self.scenario.alpha * self.phase[:, :, robot])
        return np.linalg.norm(self.position[:, :, robot, :2] - point, axis=-1)

    def smallest_distance(self) -> np.ndarray:
        """Return the smallest distance of any two robots (F, W) [m]."""
        return self.distance(*np.triu_indices(self.scenario.num_robots, 1)).min(axis=-1)

    def score(self, column: Column) -> np.ndarray:
        """Return a column of the score (W,)."""
        return np.array([row[column.name] for row in self.scores])


def phase_distance(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the distance of phases on the circle, at most pi [rad]."""
    return np.abs(np.angle(np.exp(1j * (one - other))))


def first_times(time: np.ndarray, flags: np.ndarray) -> np.ndarray:
    """Return the first time of each world (W,) [s] at which its flag (F, W) is true; inf where it never is."""
    return np.where(flags.any(axis=0), time[flags.argmax(axis=0)], np.inf)


def spread_of_cars(scenario: Scenario) -> str:
    """Return the spread of the cars of a scenario in wheelbase and drive, in words."""
    assert scenario.noise.wheelbase_spread == scenario.noise.drive_spread
    return f"{100 * scenario.noise.drive_spread:g} %"


class Player:
    """Plays episodes on one device, with seeds that follow from one, and each of them once."""

    def __init__(self, seed: int = 0, device: Any = "cpu"):
        self.seed, self.device = seed, device
        self.play = cache(self._play)

    def _play(self, policy: str, scenario: str | Scenario, worlds: int = 1, **parameters: float) -> EpisodeArrays:
        """Play one episode in each world, from `seed` on.

        Args:
            policy: Name of the policy.
            scenario: Name of the scenario, or one that was made.
            worlds: Number of episodes.
            **parameters: Parameters of the policy.
        """
        task = make_scenario(scenario).resolve()
        acting = PolicySettings(policy, parameters).make(task, worlds, self.device)
        simulation = Simulation(task, worlds, self.device)
        robots, frames = simulation.robots, []

        def record(_: int) -> None:
            arrays = (robots.phase, robots.position, robots.heading, robots.status, simulation.tally.phase_error)
            frames.append([np.array(array.numpy()) for array in arrays])

        EpisodeRunner(acting, simulation).play(range(self.seed, self.seed + worlds), record)
        phase, position, heading, status, deviation = (np.stack(array) for array in zip(*frames, strict=True))
        times, detected = map(list, zip(*map(simulation.detection_times, range(worlds)), strict=True))
        arrays = phase, position, heading, status == FAILED, deviation, times, detected
        return EpisodeArrays(task, simulation.score(), *arrays)
