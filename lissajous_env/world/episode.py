"""The state and totals of an episode on the host, from which `lissajous_env.world.columns` computes its score row."""

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
    "robots": ("status", "failed_until"),
    "targets": ("appears_at", "found_at", "found_early", "earlier", "earlier_time", "earlier_longest"),
    "cells": ("sensed_at", "in_discs", "idle_squares", "idle_max"),
}
"""Arrays of the state from which a score is computed, besides the totals and the contamination."""


@dataclass(frozen=True, kw_only=True)
class Detections:
    """Targets of one world and their detections at one time. T target slots."""

    step: int
    """Number of control steps in the episode so far."""
    appears_at: np.ndarray
    """(T,) step in which a target appears."""
    found_at: np.ndarray
    """(T,) step in which it was detected; larger than `step` until then."""
    found_early: np.ndarray
    """(T,) share of that step that was left then."""
    earlier: int = 0
    """Number of detections after which targets appeared anew, which a recording counts as targets of their own."""
    earlier_time: float = 0.0
    """Sum of the times until these detections [step]."""

    @property
    def appeared(self) -> np.ndarray:
        """(T,) bool: targets that have appeared."""
        return self.appears_at <= self.step

    @property
    def detected(self) -> np.ndarray:
        """(T,) bool: detected targets."""
        return self.found_at <= self.step

    @property
    def num_targets(self) -> int:
        """Number of targets that have appeared."""
        return int(self.appeared.sum()) + self.earlier

    @property
    def num_detected(self) -> int:
        """Number of targets that were detected."""
        return int(self.detected.sum()) + self.earlier

    @cached_property
    def times(self) -> np.ndarray:
        """Times from the appearance of each target that has appeared until its detection or now [step].

        The time of an undetected target ends now: it is right-censored.
        """
        detected = self.found_at[self.appeared] - self.found_early[self.appeared].astype(float)
        return np.minimum(detected, self.step) - self.appears_at[self.appeared]

    def mean_detection_time(self, step: float) -> float:
        """Return the mean of `times` and of those before [s], for a control step [s]; NaN without targets."""
        total = float((self.times * step).sum() + self.earlier_time * step)
        return total / self.num_targets if self.num_targets else math.nan


@dataclass(frozen=True)
class Episode:
    """The latest episode of one world, up to now."""

    scenario: Scenario
    state: Mapping[str, np.ndarray]
    """Arrays of this world that `_READ` names, by keys such as `clock.step`."""
    totals: Mapping[str, Any]
    """`EpisodeTotals` of this world, by name."""
    contamination: Mapping[str, Any]
    """Numbers of this world in `Contamination`, by name."""

    @property
    def steps(self) -> int:
        """Number of control steps so far."""
        return int(self.state["clock.step"])

    @property
    def step(self) -> float:
        """Duration of a control step [s]."""
        return self.scenario.task.step

    @cached_property
    def targets(self) -> Detections:
        """Targets and their detections."""
        state = self.state
        slots = {name: state[f"targets.{name}"] for name in ("appears_at", "found_at", "found_early")}
        earlier, earlier_time = int(state["targets.earlier"].sum()), float(state["targets.earlier_time"].sum())
        return Detections(step=self.steps, earlier=earlier, earlier_time=earlier_time, **slots)

    @property
    def times(self) -> np.ndarray:
        """Times (K,) from each target's appearance until its detection or now [s]."""
        return self.targets.times * self.step

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
        """Return whether the episode shows no bound of the worst-case undetected time: `is_open` of this module."""
        at_end = int(self.contamination["age"])
        lost = (self.state["robots.status"] == REMOVED) | (self.state["robots.failed_until"] == NEVER)
        for robot, start, end in self.scenario.faults.schedule:
            lost[robot] |= math.isinf(end) and start < self.steps * self.step
        deserted = bool(lost.all()) and (at_end > 0 or self.scenario.targets.arrival_rate > 0)
        return is_open(int(self.contamination["age_max"]), at_end, self.steps, deserted)

    def reached(self, step: int) -> float:
        """Return the time of a step [s]; NaN for one that was never reached."""
        return math.nan if step == NEVER else step * self.step

    def recovery(self, last_off: Any) -> float:
        """Return the time from the end of the last fault until a quantity returned to its bounds [s].

        It is NaN without a fault and while one lasts, if the quantity never left its bounds, or if it returned less
        than `Scenario.time_unit` ago.

        Args:
            last_off: Latest step in which the quantity was outside its bounds; -1 for none.
        """
        fault_end, last_off = int(self.totals["fault_end"]), int(last_off)
        stays = math.ceil(self.scenario.time_unit / self.step - 1e-9)
        if fault_end < 0 or last_off < 0 or self.steps - last_off < stays:
            return math.nan
        return max(last_off + 1 - fault_end, 0) * self.step


def is_open(longest: float, at_end: float, elapsed: float, deserted: bool = False) -> bool:
    """Return whether an episode shows no bound of how long a target can stay undetected.

    Then a target may be undetected at the end for longer than any target before it, and for at least half of the
    episode. If no target can stay undetected for longer than B, no episode longer than 2 B is open, so an episode must
    be longer than twice a bound to show it. If a target that appears at t1 is never detected, and no older one is
    undetected after t1, every episode of at least 2 t1 is open.

    Args:
        longest: Worst-case undetected time of the episode, in any unit of time.
        at_end: That at the end of the episode.
        elapsed: Duration of the episode up to its end.
        deserted: True if no robot will ever detect a target again.
    """
    return deserted or (0 < longest == at_end and 2 * at_end >= elapsed)


def episodes_of(scenario: Scenario, structs: Mapping[str, Any], worlds: np.ndarray) -> Iterator[Episode]:
    """Yield the latest episode of each of the worlds with these indices; `structs` are those of the state, by name."""
    state = {f"{struct}.{name}": getattr(structs[struct], name) for struct in _READ for name in _READ[struct]}
    totals = {name: array for name, array in fields_of(structs["tally"]).items() if name != "contact"}
    contamination = {name: array for name, array in fields_of(structs["contamination"]).items() if array.ndim == 1}
    hosts = [{name: array.numpy() for name, array in arrays.items()} for arrays in (state, totals, contamination)]
    for w in worlds:
        yield Episode(scenario, *({name: array[w] for name, array in arrays.items()} for arrays in hosts))
