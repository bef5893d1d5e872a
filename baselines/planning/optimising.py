"""Free-form periodic paths: Fourier coefficients of every robot's path, improved by CMA-ES from the best plans.

A population of teams is simulated together, each in a world of its own (`baselines.planning.teams`). What is minimised
is the worst-case undetected time, of whole episodes in one half of the time and of their second halves in the other,
with a part of its mean over time, by which teams of the same worst case differ, and penalties for collisions and for
paths that the cars cannot drive: above the top speed, tighter than their turns, too near to each other, or outside of
the rectangle.

Each search has two stages. The first moves, stretches and delays the paths of each of the first plans, five numbers a
robot, with several periods. The second improves all Fourier coefficients of the best of these.

N. Hansen, A. Ostermeier, "Completely derandomized self-adaptation in evolution strategies", Evolutionary Computation 9
(2001).
"""

import importlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.planning.families.lissajous import on_ellipse
from baselines.planning.plans import Plan
from baselines.planning.playing import EPISODES
from baselines.planning.teams import SETTLED, WHOLE, Limits, Teams, violation
from baselines.planning.tried import in_turn
from baselines.policies.partition import start_is_known
from baselines.policies.path_tables import FINE
from baselines.policies.periodic_paths import coefficients_of, places_of
from baselines.policies.settings import PolicySettings
from baselines.policies.timed_paths import TimedPaths
from lissajous_env.extras import missing
from lissajous_env.parameters.scenario import Scenario

NAME = "free paths"
_HARMONICS = 2, 5
"""Fewest and most harmonics: as few as describe the first paths."""
_DESCRIBED = 0.15
"""Largest error of that description, over the sensing radius."""
_PERIODS = (0.75, 0.85, 1.0)
"""Periods that are tried, over that of the plan from which the search begins."""
_MEAN = 0.5
"""Weight of the mean over time of the undetected time, against its largest value."""
_PENALTY, _COLLISION, _MOST_COLLISIONS = 20.0, 0.1, 20
"""Weight of the relative violation of a limit, in the time in which a car at top speed crosses its sensing disc; weight
of a collision, over that; and most collisions that count."""
_MOVES, _SIGMA = 0.05, 0.02
"""Standard deviations of the first changes: of moves, stretches and delays, and of coefficients in the smaller half
side of the rectangle."""
_TOLERANCE = 0.01
"""Largest relative violation of a team that becomes a plan: the limits of the cars have a reserve."""
_FAR = 0.1
"""Relative violation from which on no way from the start is sought."""
_STARTS = 1.0, 1.2, 0.8
"""Speeds of a start on an ellipse where it is fastest, over the largest speed on the paths."""
_WIDER = 1.03
"""Size of the first paths, over that of the plan: those of a partition often turn as tightly as cars can."""
_WORLDS = 24
_FIRST = 0.4
"""Share of the time for the first stage."""
_KEPT = 3
"""Results of the first stage that the second improves, and teams of a goal that become plans."""


@dataclass(frozen=True)
class _Team:
    """A team that meets the limits and did not collide."""

    value: float
    paths: np.ndarray
    """(N, 2 + 4 K) Fourier coefficients [m]."""
    period: int


def optimise(
    task: Scenario,
    starts: Mapping[str, Sequence[Plan]],
    seconds: float,
    stopped: Callable[[], bool] = lambda: False,
    seed: int = 0,
    fixed_start: bool = False,
) -> list[Plan]:
    """Return plans of free-form paths, the best of each goal in turn.

    Args:
        task: The task, of cars.
        starts: For each goal, the plans of timed paths from which the search begins; others are left out.
        seconds: Duration of the search [s].
        stopped: Returns whether to stop.
        seed: Seed of the search.
        fixed_start: True to begin where the task places the robots.

    Raises:
        MissingExtraError: the library `cma` is not installed.
    """
    require_cma()
    begin = time.monotonic()
    found: list[list[Plan]] = []
    for k, goal in enumerate((SETTLED, WHOLE)):
        search = _Search(task, goal, begin + seconds * (k + 1) / 2, stopped, seed, fixed_start)
        teams = search.run([loop for plan in starts.get(goal, ()) if (loop := loop_of(plan)) is not None])
        found.append([_plan(task, team, fixed_start) for team in teams[:_KEPT]])
    return list(in_turn(found))


def loop_of(plan: Plan) -> np.ndarray | None:
    """Return the loops (N, K, 2) of a plan of timed paths [m]; None for another plan."""
    policy = plan.settings.make(plan.scenario)
    if not isinstance(policy, TimedPaths):
        return None
    tables = policy.tables
    return tables.pose[0, :, FINE * tables.lead_in :: FINE, :2]


def require_cma() -> Any:
    """Return the library for CMA-ES.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return importlib.import_module("cma")
    except ImportError as error:
        raise missing("free-form paths (--optimise)", "plan", error) from None


def moved(paths: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Return paths (P, N, 2 + 4 K) [m] that are moved, stretched and delayed.

    Args:
        paths: (N, 2 + 4 K) Fourier coefficients [m].
        changes: (P, N, 5) moves along x and y [m], logarithms of the stretches of x and y, and delays [period].
    """
    count = (paths.shape[1] - 2) // 4
    waves = paths[:, 2:].reshape(len(paths), count, 2, 2)  # harmonic, coordinate, cosine and sine
    stretched = waves * np.exp(changes[:, :, None, 2:4, None])
    turn = 2 * np.pi * np.arange(1, count + 1) * changes[:, :, 4:]
    cos, sin = np.cos(turn)[..., None], np.sin(turn)[..., None]
    delayed = np.stack(
        [stretched[..., 0] * cos - stretched[..., 1] * sin, stretched[..., 0] * sin + stretched[..., 1] * cos], axis=-1
    )
    return np.concatenate([paths[:, :2] + changes[:, :, :2], delayed.reshape(*changes.shape[:2], 4 * count)], axis=-1)


class _Search:
    """A search with one goal."""

    def __init__(
        self, task: Scenario, goal: str, until: float, stopped: Callable[[], bool], seed: int, fixed_start: bool
    ):
        self.task, self.goal, self.until, self.stopped, self.seed = task, goal, until, stopped, seed
        self.fixed_start = fixed_start
        self.limits = Limits.of(task)
        self.weight = _PENALTY * task.sensing_radius / task.robot.top_speed

    def run(self, loops: Sequence[np.ndarray]) -> list[_Team]:
        """Return the best teams found from loops (N, K, 2) [m], one of each search of the second stage, best first."""
        begun = [(loop, max(round(loop.shape[1] * share), 4)) for share in _PERIODS for loop in loops]
        size = np.array([min(self.limits.half)] * 2 + [1.0] * 3)
        begin, first = time.monotonic(), []
        for k, (loop, period) in enumerate(begun):
            paths = self._described(loop)
            until = begin + _FIRST * (self.until - begin) * (k + 1) / len(begun)
            first += self._improved(
                lambda x, paths=paths: moved(paths, x.reshape(len(x), len(paths), 5) * size),
                np.zeros(5 * len(paths)), _MOVES, period, until,
            )  # fmt: skip
        kept = sorted(first, key=lambda team: team.value)[:_KEPT]
        begin, second = time.monotonic(), []
        for k, team in enumerate(kept):
            until = begin + (self.until - begin) * (k + 1) / len(kept)
            second += self._improved(
                lambda x, shape=team.paths.shape: x.reshape(len(x), *shape),
                team.paths.ravel(), _SIGMA * min(self.limits.half), team.period, until,
            )  # fmt: skip
        return sorted([*kept, *second], key=lambda team: team.value)

    def _described(self, loop: np.ndarray) -> np.ndarray:
        """Return the Fourier coefficients of loops, a little wider."""
        for count in range(_HARMONICS[0], _HARMONICS[1] + 1):
            paths = coefficients_of(loop, count)
            if np.abs(places_of(paths, loop.shape[1]) - loop).max() < _DESCRIBED * self.task.sensing_radius:
                break
        paths[:, 2:] *= _WIDER
        return paths

    def _improved(
        self, paths_of: Callable[[np.ndarray], np.ndarray], start: np.ndarray, sigma: float, period: int, until: float
    ) -> list[_Team]:
        """Return the best team of one run of CMA-ES, if there is one that meets the limits."""
        options = {"popsize": _WORLDS, "seed": self.seed + 1, "verbose": -9}
        search = require_cma().CMAEvolutionStrategy(start, sigma, options)
        teams, best, drawn = Teams(self.task, period, _WORLDS, self.goal), None, 0
        while time.monotonic() < until and not self.stopped() and not search.stop():
            asked = search.ask()
            paths = paths_of(np.array(asked))
            broken = violation(paths, period, self.limits)
            worst, mean, collisions = teams.scores(
                places_of(paths, period), self.seed + drawn % EPISODES, broken < _FAR
            )
            drawn += 1
            values = worst + _MEAN * mean
            values = values + self.weight * (broken + _COLLISION * np.minimum(collisions, _MOST_COLLISIONS))
            search.tell(asked, values.tolist())
            allowed = np.where((broken < _TOLERANCE) & (collisions == 0), values, np.inf)
            k = int(allowed.argmin())
            if allowed[k] < (np.inf if best is None else best.value) and self._can_begin(paths[k], period):
                best = _Team(float(allowed[k]), paths[k], period)
        return [] if best is None else [best]

    def _can_begin(self, paths: np.ndarray, period: int) -> bool:
        """Return whether the robots get from the start of the task into paths without collisions."""
        if not self.fixed_start or not start_is_known(self.task):
            return True
        return _settings(paths, period).make(self.task).communicates == "nothing"


def _plan(task: Scenario, team: _Team, fixed_start: bool) -> Plan:
    """Return the plan of some paths, with a start from which the cars can drive into them without collisions."""
    settings = _settings(team.paths, team.period)
    about = f"period {team.period * task.task.step:.3g} s, {(team.paths.shape[1] - 2) // 4} harmonics"
    moved_by = np.linalg.norm(np.diff(places_of(team.paths, team.period), axis=1), axis=2).max()
    fastest = [min(share * float(moved_by) / task.task.step, task.robot.top_speed) for share in _STARTS]
    for made in (task, *([] if fixed_start else [on_ellipse(task, speed) for speed in fastest])):
        if settings.make(made).communicates == "nothing":  # no collision filter is needed on the way
            return Plan(NAME, made, settings, about)
    return Plan(NAME, task, settings, about)


def _settings(paths: np.ndarray, period: int) -> PolicySettings:
    """Return the policy of some paths."""
    rows = [[float(f"{number:.5g}") for number in row] for row in paths]
    return PolicySettings("periodic-paths", {"period": period, "paths": rows})
