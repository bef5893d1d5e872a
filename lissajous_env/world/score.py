"""The totals of an episode on the host, from which `lissajous_env.world.columns` computes its score row."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lissajous_env.device.warp_abi import fields_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.coverage import last_sensed
from lissajous_env.world.state import NEVER, REMOVED


@dataclass(frozen=True)
class Episode:
    """The latest episode of one world, up to now."""

    scenario: Scenario
    seed: int
    """Seed of the world."""
    steps: int
    """Number of control steps so far."""
    totals: Mapping[str, Any]
    """`EpisodeTotals` of this world, by name."""
    contamination: Mapping[str, Any]
    """One number of each per-world array of `Contamination`, by name."""
    times: np.ndarray
    """Time from each target's appearance until it was detected, or until now [s]."""
    detected: np.ndarray
    """True for each of these targets that was detected."""
    earlier: int
    """Number of targets that were detected and appeared anew."""
    earlier_time: float
    """Sum of their times [s]."""
    earlier_longest: float
    """Longest of their times [s]."""
    steps_present: int
    """Steps for which targets were present, summed over targets; detected ones count if they stay."""
    gaps: np.ndarray
    """Time since each cell was last sensed [step]."""
    idle_squares: int
    """Sum over cells and visits of the squared time since the visit before [step^2]."""
    idle_max: int
    """Longest time between two visits of a cell [step]."""
    is_deserted: bool
    """True if every robot was removed."""

    @property
    def step(self) -> float:
        """Duration of a control step [s]."""
        return self.scenario.task.step

    @property
    def has_grid(self) -> bool:
        """Return whether the scenario has a coverage grid."""
        return self.scenario.task.grid is not None

    @property
    def has_contamination(self) -> bool:
        """Return whether the scenario computes contamination."""
        return self.scenario.task.contamination is not None

    @property
    def num_targets(self) -> int:
        """Number of targets that appeared."""
        return len(self.times) + self.earlier

    @property
    def num_detected(self) -> int:
        """Number of targets that were detected."""
        return int(np.count_nonzero(self.detected)) + self.earlier

    @property
    def is_open(self) -> bool:
        """Return `is_open` of this episode."""
        at_end = int(self.contamination["age"])
        deserted = self.is_deserted and (at_end > 0 or self.scenario.targets.arrival_rate > 0)
        return is_open(int(self.contamination["age_max"]), at_end, self.steps, deserted)

    def reached(self, step: int) -> float:
        """Return the time of a step [s]; NaN for one that was never reached."""
        return math.nan if step == int(NEVER) else step * self.step

    def per_step(self, total: Any) -> Any:
        """Return the mean over the steps of what was summed over them."""
        return total / max(self.steps, 1)

    def recovery(self, last_off: Any) -> float:
        """Return the time from the end of the last fault until a quantity was back within its bounds [s].

        It is NaN without a fault, if the quantity was never outside, or if it has been inside for less than
        `Scenario.time_unit`.

        Args:
            last_off: latest step in which the quantity was outside; -1 for none.
        """
        fault_end, last_off = int(self.totals["fault_end"]), int(last_off)
        stays = math.ceil(self.scenario.time_unit / self.step - 1e-9)
        if fault_end < 0 or last_off < 0 or self.steps - last_off < stays:
            return math.nan
        return max(last_off + 1 - fault_end, 0) * self.step


def is_open(longest: float, at_end: float, elapsed: float, deserted: bool = False) -> bool:
    """Return whether an episode shows no bound of how long a target can stay undetected.

    Some target that can be undetected at the end has then been so for longer than any before it, and for at least half
    of the episode. To show a bound, an episode must be longer than twice that bound: if no target can ever stay
    undetected for longer than B, no episode longer than 2 B is open. If one is never detected, and from t1 on none has
    been present for longer, every episode of 2 t1 or longer is open; while it stays undetected, an open episode stays
    open.

    Args:
        longest: worst-case undetected time, in any unit of time.
        at_end: the same at the end of the episode.
        elapsed: duration of the episode up to its end.
        deserted: whether no robot is left to detect anything.
    """
    return deserted or (0 < longest == at_end and 2 * at_end >= elapsed)


def episodes_of(
    scenario: Scenario,
    clock: Any,
    robots: Any,
    targets: Any,
    cells: Any,
    contamination: Any,
    tally: Any,
    worlds: np.ndarray,
) -> Iterator[Episode]:
    """Yield the latest episode of each of some worlds; the arguments are the structs of the state."""
    totals = {name: array.numpy() for name, array in fields_of(tally).items() if name != "contact"}
    unseen = {name: array.numpy() for name, array in fields_of(contamination).items() if array.ndim == 1}
    steps, seeds = clock.step.numpy(), clock.seed.numpy()
    appears_at, found_at, found_early = (
        each.numpy() for each in (targets.appears_at, targets.found_at, targets.found_early)
    )
    earlier, earlier_time, earlier_longest = (
        each.numpy() for each in (targets.earlier, targets.earlier_time, targets.earlier_longest)
    )
    sensed_at, in_discs, idle_squares, idle_max = (
        each.numpy() for each in (cells.sensed_at, cells.in_discs, cells.idle_squares, cells.idle_max)
    )
    deserted = (robots.status.numpy() == int(REMOVED)).all(axis=1)
    for w in worlds:
        now = int(steps[w])
        times, detected = detection_times(appears_at[w], found_at[w], found_early[w], now)
        yield Episode(
            scenario=scenario,
            seed=int(seeds[w]),
            steps=now,
            totals={name: array[w] for name, array in totals.items()},
            contamination={name: array[w] for name, array in unseen.items()},
            times=times * scenario.task.step,
            detected=detected,
            earlier=int(earlier[w].sum()),
            earlier_time=float(earlier_time[w].sum()) * scenario.task.step,
            earlier_longest=float(earlier_longest[w].max(initial=0.0)) * scenario.task.step,
            steps_present=int(np.maximum(now + 1 - np.maximum(appears_at[w], 1), 0).sum(dtype=np.int64)),
            gaps=now - last_sensed(sensed_at[w], in_discs[w], now),
            idle_squares=idle_squares[w].sum(dtype=float),
            idle_max=idle_max[w].max(initial=0),
            is_deserted=bool(deserted[w]),
        )


def detection_times(
    appears_at: np.ndarray, found_at: np.ndarray, found_early: np.ndarray, now: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the time from each target's appearance until it was detected, or until now [step], and whether it was.

    Targets that have not appeared are left out. The time of one that was not detected is censored: it is at least so.
    """
    there = appears_at <= now
    detected = found_at[there] - found_early[there].astype(float)
    return np.minimum(detected, now) - appears_at[there], found_at[there] <= now
