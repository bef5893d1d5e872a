"""The totals of an episode on the host, from which `lissajous_env.world.columns` computes its score row."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lissajous_env.device.warp_abi import fields_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.coverage import last_sensed
from lissajous_env.world.state import NEVER, REMOVED

_READ = {
    "clock": ("seed", "step"),
    "robots": ("status",),
    "targets": ("appears_at", "found_at", "found_early", "earlier", "earlier_time", "earlier_longest"),
    "cells": ("sensed_at", "in_discs", "idle_squares", "idle_max"),
}
"""Arrays of the state of which an episode's score is computed, besides its totals."""


@dataclass(frozen=True)
class Episode:
    """The latest episode of one world, up to now."""

    scenario: Scenario
    state: Mapping[str, np.ndarray]
    """The values of this world that `_READ` names, such as `clock.step`."""
    totals: Mapping[str, Any]
    """`EpisodeTotals` of this world, by name."""
    contamination: Mapping[str, Any]
    """One number of each per-world array of `Contamination`, by name."""

    @property
    def seed(self) -> int:
        """Seed of the world."""
        return int(self.state["clock.seed"])

    @property
    def steps(self) -> int:
        """Number of control steps so far."""
        return int(self.state["clock.step"])

    @property
    def step(self) -> float:
        """Duration of a control step [s]."""
        return self.scenario.task.step

    @property
    def has_grid(self) -> bool:
        """Return whether the scenario has a coverage grid."""
        return self.scenario.task.grid is not None

    @cached_property
    def detections(self) -> tuple[np.ndarray, np.ndarray]:
        """Time from each target's appearance until it was detected, or until now [s], and whether it was."""
        times = (self.state[f"targets.{name}"] for name in ("appears_at", "found_at", "found_early"))
        times, detected = detection_times(*times, now=self.steps)
        return times * self.step, detected

    @property
    def times(self) -> np.ndarray:
        """Times of `detections` [s]."""
        return self.detections[0]

    @property
    def earlier(self) -> int:
        """Number of targets that were detected and appeared anew."""
        return int(self.state["targets.earlier"].sum())

    @property
    def earlier_time(self) -> float:
        """Sum of their times [s]."""
        return float(self.state["targets.earlier_time"].sum()) * self.step

    @property
    def num_targets(self) -> int:
        """Number of targets that appeared."""
        return len(self.times) + self.earlier

    @property
    def num_detected(self) -> int:
        """Number of targets that were detected."""
        return int(np.count_nonzero(self.detections[1])) + self.earlier

    @property
    def steps_present(self) -> int:
        """Steps for which targets were present, summed over targets; detected ones count if they stay."""
        since = np.maximum(self.state["targets.appears_at"], 1)
        return int(np.maximum(self.steps + 1 - since, 0).sum(dtype=np.int64))

    @cached_property
    def gaps(self) -> np.ndarray:
        """Time since each cell was last sensed [step]."""
        return self.steps - last_sensed(self.state["cells.sensed_at"], self.state["cells.in_discs"], self.steps)

    @property
    def is_open(self) -> bool:
        """Return `is_open` of this episode."""
        at_end = int(self.contamination["age"])
        deserted = bool((self.state["robots.status"] == int(REMOVED)).all())
        deserted = deserted and (at_end > 0 or self.scenario.targets.arrival_rate > 0)
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


def episodes_of(scenario: Scenario, structs: Mapping[str, Any], worlds: np.ndarray) -> Iterator[Episode]:
    """Yield the latest episode of each of some worlds; `structs` are those of the state, by name."""
    state = {f"{struct}.{name}": getattr(structs[struct], name) for struct in _READ for name in _READ[struct]}
    totals = {name: array for name, array in fields_of(structs["tally"]).items() if name != "contact"}
    unseen = {name: array for name, array in fields_of(structs["contamination"]).items() if array.ndim == 1}
    hosts = [{name: array.numpy() for name, array in arrays.items()} for arrays in (state, totals, unseen)]
    for w in worlds:
        yield Episode(scenario, *({name: array[w] for name, array in arrays.items()} for arrays in hosts))


def detection_times(
    appears_at: np.ndarray, found_at: np.ndarray, found_early: np.ndarray, now: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the time from each target's appearance until it was detected, or until now [step], and whether it was.

    Targets that have not appeared are left out. The time of one that was not detected is censored: it is at least so.
    """
    there = appears_at <= now
    detected = found_at[there] - found_early[there].astype(float)
    return np.minimum(detected, now) - appears_at[there], found_at[there] <= now
