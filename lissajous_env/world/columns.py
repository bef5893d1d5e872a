"""The columns of a score row: the computation of each, its allowed values, and its place in tables and pages."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from lissajous_env.parameters.extensions import ScoreColumn
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.episode import Episode


class Rule(NamedTuple):
    """The values that a stored entry may have."""

    words: str
    accepts: Callable[[Any], bool]


# A whole number in a file may exceed the range of floats.
FINITE = Rule("a finite number", lambda value: type(value) in (int, float) and abs(value) <= 1e300)
AT_LEAST_0 = Rule("a number of at least 0", lambda value: FINITE.accepts(value) and value >= 0)
SHARE = Rule("a number from 0 to 1", lambda value: FINITE.accepts(value) and 0 <= value <= 1)
WHOLE = Rule("a whole number of at least 0", lambda value: type(value) is int and 0 <= value < 2**63)
TEXT = Rule("a text", lambda value: isinstance(value, str))
FLAG = Rule("0 or 1", lambda value: type(value) in (int, float) and value in (0, 1))

INTERQUARTILE_MEAN, MEAN, LARGEST = "interquartile mean", "mean", "largest"
"""Estimates of a column over several episodes."""


@dataclass(frozen=True)
class Column:
    """A number of a score row, or one that is derived from a score row."""

    name: str
    meaning: str
    value: Callable[[Episode], Any] | None = None
    """Function that computes it; None for a column that is not computed from an `Episode`."""
    unit: str = ""
    rule: Rule = AT_LEAST_0
    empty: str = ""
    """Reason for a value of NaN (null in files); "" if the value is always a number."""
    title: str = ""
    """Title in tables, without the unit; "" for the name in words."""
    better: int = 0
    """1 if larger values are better, -1 if smaller ones are, 0 if neither."""
    summary: str = INTERQUARTILE_MEAN
    """Estimate over several episodes, in every table, picture and ranking: `INTERQUARTILE_MEAN`; `MEAN`, for rare
    events; or `LARGEST`, for a worst case, which no mean bounds."""
    order: int = 0
    """Position in tables of policies, from 1; narrow terminals omit the last ones. 0 omits the column everywhere."""
    main: bool = False
    """True for a column of the README's table, of tables for papers and of the report's list of episodes."""
    page: bool = True
    """True for a column of the report's tables of policies."""

    @property
    def short(self) -> str:
        """Return the title without its unit."""
        return self.title or self.name.replace("_", " ")

    @property
    def heading(self) -> str:
        """Return the title with its unit in brackets."""
        return self.short + self._bracketed

    @property
    def described(self) -> str:
        """Return the meaning with its unit in brackets."""
        return self.meaning + self._bracketed

    @property
    def _bracketed(self) -> str:
        return f" [{self.unit}]" if self.unit else ""

    def refusal(self, value: Any) -> str | None:
        """Return the rule that a stored value violates; None if it is allowed."""
        if (value is None and self.empty) or self.rule.accepts(value):
            return None
        return f"must be {self.rule.words}{self._bracketed}" + (f" or null ({self.empty})" if self.empty else "")


def _some(reduce: Callable[..., Any], values: np.ndarray, *more: Any) -> Any:
    """Return a statistic of values, or NaN if there are none."""
    return reduce(values, *more) if len(values) else math.nan


def _within_bound(episode: Episode) -> Any:
    """Return the column `detected_within_bound`."""
    if episode.scenario.targets.respawn:
        return math.nan
    detected = episode.targets.detected[episode.targets.appeared]
    within = episode.times <= episode.scenario.detection_time_bound * (1 + 1e-9)
    return _some(np.mean, (detected & within)[detected | ~within])


def _rate(episode: Episode) -> float:
    """Return the column `detection_rate`."""
    elapsed = episode.steps * episode.step
    return 60 * episode.targets.num_detected / elapsed if episode.scenario.targets.respawn and elapsed else math.nan


def _observed(episode: Episode) -> float:
    """Return the column `observed_fraction`."""
    stays = not episode.scenario.targets.leave and episode.steps_present
    return int(episode.totals["observed"]) / episode.steps_present if stays else math.nan


def _idleness(episode: Episode) -> float:
    """Return the column `idleness_mean`."""
    squares = episode.state["cells.idle_squares"].sum(dtype=float) + np.sum(episode.gaps.astype(float) ** 2)
    return squares * episode.step / (2 * max(episode.steps, 1) * episode.gaps.size)


def _in_scenarios(has: Callable[[Scenario], Any]) -> Callable[[Callable[[Episode], Any]], Callable[[Episode], Any]]:
    """Return a decorator of the functions of columns that are NaN in other scenarios."""
    return lambda value: lambda episode: value(episode) if has(episode.scenario) else math.nan


_on_grid = _in_scenarios(lambda scenario: scenario.task.grid)
_contaminated = _in_scenarios(lambda scenario: scenario.task.contamination)
_in_formation = _in_scenarios(lambda scenario: scenario.has_formation)
_NO_TARGET = "no target appeared"
_NO_GRID = "no grid"
_NO_CONTAMINATION = "contamination is not computed"
_NO_FORMATION = "actions are velocities"

# fmt: off
TARGETS = Column("targets", "number of targets that appeared", lambda e: e.targets.num_targets, rule=WHOLE)
DETECTED = Column(
    "detected_fraction", "share of the targets that were detected",
    lambda e: e.targets.num_detected / e.targets.num_targets if e.targets.num_targets else math.nan, rule=SHARE,
    empty=_NO_TARGET, title="detected", better=1,
)
DETECTION_TIME = Column(
    "detection_time_mean",
    "time from a target's appearance until it is first within a working robot's sensing disc, also between control "
    "steps, mean over targets; a target that is never detected counts with the time for which it was present",
    lambda e: e.targets.mean_detection_time(e.step), "s",
    empty=_NO_TARGET, title="detection", better=-1, order=1, main=True,
)
DETECTION_TIME_P95 = Column(
    "detection_time_p95", "95th percentile of the same time over targets",
    lambda e: math.nan if e.scenario.targets.respawn else _some(np.percentile, e.times, 95), "s",
    empty=f"{_NO_TARGET}, or targets appear anew", title="detection p95", better=-1, order=12, page=False,
)
LONGEST_DETECTION = Column(
    "detection_time_max", "longest of these times",
    lambda e: max(_some(np.max, e.times), float(e.state["targets.earlier_longest"].max(initial=0.0)) * e.step), "s",
    empty=_NO_TARGET, better=-1,
)
DETECTION_RATE = Column(
    "detection_rate", "detections in a minute, if detected targets appear anew (`targets.respawn`)", _rate, "1/min",
    empty="targets do not appear anew", better=1, order=15,
)
OBSERVED = Column(
    "observed_fraction",
    "share of the targets that are within `sensing.sight` of a working robot, mean over time, if targets stay when "
    "they are detected (`targets.leave = false`)",
    _observed, rule=SHARE, empty=f"targets leave, or {_NO_TARGET}", title="observed", better=1, order=14,
)
WITHIN_BOUND = Column(
    "detected_within_bound",
    "share of the targets that were detected within the detection-time bound T_max = (2 pi / omega) / (N / kappa), "
    "which holds only if r_s meets Eq. (8); targets that were present for at most T_max and not detected are "
    "excluded",
    _within_bound, rule=SHARE, empty="no target was present for T_max or detected, or targets appear anew",
    title="within T_max", better=1,
    order=8,
)
COLLISIONS = Column(
    "collisions",
    "pairs of robots that came closer than the sum of their radii, by the closest approach between sub-steps; a pair "
    "counts once until it parts by 5 % more; points that share a place of the formation (kappa > 1) overlap by design "
    "and are not counted",
    lambda e: int(e.totals["collisions"]), rule=WHOLE, better=-1, summary=MEAN, order=4, main=True,
)
CONTACT_TIME = Column(
    "contact_time", "time in contact, summed over the same pairs", lambda e: e.totals["contact_steps"] * e.step, "s",
    better=-1,
)
SEPARATION = Column(
    "min_separation", "smallest distance between the centres of two robots of such a pair",
    lambda e: e.totals["min_separation"] if e.totals["min_separation"] < 1e29 else math.nan, "m",
    empty="no such pair", title="least distance", better=1, order=9,
)
COVERAGE = Column(
    "coverage_time", "time until every cell was covered by some robot", lambda e: e.reached(e.totals["covered_at"]),
    "s", empty=f"never, or {_NO_GRID}", title="coverage", better=-1, order=11,
)
COVERAGE_EACH = Column(
    "coverage_time_each", "time until every cell was covered by every robot",
    lambda e: e.reached(e.totals["covered_each_at"]), "s", empty=f"never, or {_NO_GRID}", better=-1,
)
IDLENESS = Column(
    "idleness_mean", "time since a cell was last covered, mean over cells and time", _on_grid(_idleness), "s",
    empty=_NO_GRID, title="idleness", better=-1, order=7,
)
LONGEST_IDLENESS = Column(
    "idleness_max", "longest time for which a cell was not covered",
    _on_grid(lambda e: max(e.state["cells.idle_max"].max(initial=0), e.gaps.max()) * e.step), "s",
    empty=_NO_GRID, better=-1,
)
LATERAL_ERROR = Column(
    "lateral_error_mean", "distance of a robot from the nearest point of the curve, mean over robots and time",
    _in_formation(lambda e: e.totals["lateral_sum"] / max(e.totals["present_steps"], 1)), "m", empty=_NO_FORMATION,
)
LARGEST_LATERAL_ERROR = Column(
    "lateral_error_max", "largest distance of a robot from the curve",
    _in_formation(lambda e: e.totals["lateral_max"]), "m", empty=_NO_FORMATION,
)
TRACKING_ERROR = Column(
    "tracking_error_mean",
    "distance of a robot from the point of the curve at its own phase, mean over robots and time",
    _in_formation(lambda e: e.totals["tracking_sum"] / max(e.totals["present_steps"], 1)), "m", empty=_NO_FORMATION,
)
LARGEST_TRACKING_ERROR = Column(
    "tracking_error_max", "largest of these distances", _in_formation(lambda e: e.totals["tracking_max"]), "m",
    empty=_NO_FORMATION,
)
SPACING = Column(
    "spacing_factor", "largest distance of ring neighbours over 2 r_s of Eq. (8): eta_1 of the paper",
    _in_formation(lambda e: e.totals["spacing_max"] / e.scenario.neighbour_distance),
    empty=f"no Lissajous curve, or {_NO_FORMATION}", better=-1, order=13, page=False,
)
PHASE_ERROR = Column(
    "phase_error", "largest deviation from the equilibrium of Eq. (2), without the common rotation",
    _in_formation(lambda e: e.totals["phase_error_max"]), "rad", empty=_NO_FORMATION, better=-1,
)
RECOVERY = Column(
    "recovery_time",
    "time from the end of the last fault until the phase error stays, for at least 0.3 rad / omega, within 1.1 times "
    "its largest value before the first fault (at least 0.05 rad); empty if it never does, or if no fault disturbed "
    "the formation",
    _in_formation(lambda e: e.recovery(e.totals["off_at"])), "s",
    empty=f"never, never disturbed, or {_NO_FORMATION}", title="recovery", better=-1, order=10,
)
OUTSIDE = Column(
    "outside_time", "time that bodies were wholly outside the rectangle, summed over robots",
    lambda e: e.totals["outside_steps"] * e.step, "s", better=-1,
)
PARTLY_OUTSIDE = Column(
    "partly_outside_time", "time that some part of a body was outside the rectangle, summed over robots",
    lambda e: e.totals["partly_outside_steps"] * e.step, "s", title="partly outside", better=-1,
)
WALL_CONTACTS = Column(
    "wall_contacts",
    "number of times that a body came into contact with a wall; a contact lasts until the body is 5 % of its radius "
    "away; 0 without walls",
    lambda e: int(e.totals["wall_contacts"].sum()), rule=WHOLE, better=-1, summary=MEAN,
)
BLOCKED = Column(
    "blocked_time",
    "time that working robots were blocked, summed over robots: their policy drove them for task.blocked_after, at a "
    "speed that goes two radii in that time, and they did not move by their radius; 0 without walls",
    lambda e: int(e.totals["blocked_steps"].sum()) * e.step, "s", better=-1, summary=MEAN,
)
DISTANCE = Column(
    "distance_mean", "distance travelled, mean over robots",
    lambda e: e.totals["distance_sum"] / e.scenario.num_robots, "m", title="distance", order=6, main=True, page=False,
)
TOP_SPEED = Column("speed_max", "largest speed of any robot", lambda e: e.totals["speed_max"], "m/s")
SMOOTHNESS = Column(
    "smoothness", "mean square of the change of the action from step to step, mean over working robots; 0 is steady",
    lambda e: e.totals["change_sum"] / (e.totals["change_steps"] or math.nan), empty="no robot worked after one step",
)
SENSED = Column(
    "sensed_fraction", "share of the cells that some robot has covered",
    _on_grid(lambda e: e.totals["covered"] / e.gaps.size), rule=SHARE, empty=_NO_GRID,
    title="sensed", better=1, order=5, main=True,
)
WORST_CASE = Column(
    "guaranteed_detection_time",
    "worst-case undetected time: the longest time for which any target of the scenario's top speed can have stayed "
    "undetected, however it moved",
    _contaminated(lambda e: int(e.contamination["age_max"]) * e.step), "s", empty=_NO_CONTAMINATION,
    title="guaranteed", better=-1, summary=LARGEST, order=3, main=True,
)
AT_END = Column(
    "unseen_at_end",
    "the same at the end of the episode; if the two are equal, the worst-case undetected time was still growing, so "
    "that its value is a lower bound (right-censored)",
    _contaminated(lambda e: int(e.contamination["age"]) * e.step), "s", empty=_NO_CONTAMINATION, better=-1,
    summary=LARGEST,
)
OPEN = Column(
    "guarantee_open",
    "1 if the episode shows no bound of the worst-case undetected time: it was still growing at the end and was at "
    "least half of the episode, or no robot would work again while targets could be undetected or arrive; otherwise 0",
    _contaminated(lambda e: float(e.is_open)), rule=FLAG, empty=_NO_CONTAMINATION, better=-1, summary=MEAN,
)
AGE = Column(
    "contaminated_age_mean",
    "longest time for which a target that may be in a cell can have been undetected, 0 for a cleared cell, mean over "
    "cells and time",
    _contaminated(lambda e: e.contamination["mean_age_sum"] / max(e.steps, 1) * e.step), "s", empty=_NO_CONTAMINATION,
    better=-1,
)
GUARANTEE_RECOVERY = Column(
    "guarantee_recovery_time",
    "time from the end of the last fault until the time for which a target can have been undetected stays, for at "
    "least 0.3 rad / omega, within 1.1 times its largest value before the first fault",
    _contaminated(lambda e: e.recovery(e.contamination["high_at"])), "s",
    empty=f"never, never disturbed, or {_NO_CONTAMINATION}", better=-1,
)
RETURN = Column(
    "return_mean", "sum of the rewards, mean over robots", lambda e: e.totals["returns"].mean(), rule=FINITE,
    title="return", better=1,
)
# fmt: on

COLUMNS = {column.name: column for column in tuple(vars().values()) if isinstance(column, Column)}
"""The columns of every score row, by name and in their order."""
IDENTITY = {
    "scenario": Column("scenario", "name of the scenario", rule=TEXT),
    "policy": Column("policy", "name of the policy", rule=TEXT),
    "episode": Column("episode", "number of the episode, from 0", rule=WHOLE),
    "seed": Column("seed", "seed of the world", rule=WHOLE),
}
"""Entries that identify the episode of a score row, by name; they stand before the columns."""
NAMES = (*IDENTITY, *COLUMNS)
"""All entries of a score row."""
MEANINGS = {name: column.described for name, column in (IDENTITY | COLUMNS).items()}
"""The meaning of each of them, with its unit in brackets."""


def task_score(scenario: Scenario) -> Column:
    """Return the score of a scenario's task, by which policies are ranked and compared.

    It is the share of the targets in sight if targets stay when they are detected, the detections in a minute if they
    appear anew, and the mean detection time otherwise.
    """
    if not scenario.targets.leave:
        return OBSERVED
    return DETECTION_RATE if scenario.targets.respawn else DETECTION_TIME


def extension_columns(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the columns that a scenario's extensions add after `NAMES`."""
    return tuple(extension.name for extension in scenario.extensions if isinstance(extension, ScoreColumn))


def number_names(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the numbers of a scenario's score rows, in their order: `seed`, then the columns."""
    return ("seed", *(column.name for column in COLUMNS.values() if column.value), *extension_columns(scenario))


def score_of(episode: Episode) -> dict[str, Any]:
    """Return the score row of an episode so far, without `policy` and `episode`; a time not reached is NaN."""
    row: dict[str, Any] = {"scenario": episode.scenario.name, "seed": int(episode.state["clock.seed"])}
    return row | {column.name: plain(column.value(episode)) for column in COLUMNS.values() if column.value}


def plain(value: Any) -> int | float:
    """Return a Python number, rounded to remove errors such as that of 4.6000000000000005, 46 steps of 0.1 s."""
    return value if isinstance(value, int) else round(float(value), 12)
