"""History of a training, written into each checkpoint and read when it is resumed."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from baselines.benchmark.statistics import interquartile_mean
from lissajous_env.world.columns import COLLISIONS, DETECTED, DETECTION_TIME, RETURN
from training.learned.card import require

SCORES = {
    "detection_time": DETECTION_TIME,
    COLLISIONS.name: COLLISIONS,
    "return": RETURN,
    DETECTED.name: DETECTED,
}
"""Scores of an evaluation, each a number, or None without one, and the column of which it is a statistic."""

RELATIVE = "relative_time"
"""Score of an evaluation on several scenarios: detection time relative to that of the first rival on the same scenario,
geometric mean over scenarios."""

LEARNING = ("approx_kl", "entropy_loss", "explained_variance")
"""Stored diagnostics of updates: divergence between the policies before and after, the negative entropy [nat], and the
fraction of the variance of the returns that the critic explains."""
MOST_UPDATES = 400
"""Largest number of stored updates, spread over the training."""

_WHEN = ("steps", "seconds")
_SHORTEST = 1e-9
"""Smallest value in a geometric mean, for targets that are detected when they appear."""
OFTEN = 0.02
"""Collisions per episode by which a policy may exceed a rival and still count as equally safe."""


def summarize_scores(rows: Sequence[Mapping[str, Any]]) -> dict[str, float | None]:
    """Return the interquartile mean of the detection time [s], and means of the other `SCORES`, over score rows."""
    summary: dict[str, float | None] = {}
    for name, column in SCORES.items():
        values = [row[column.name] for row in rows if math.isfinite(row[column.name])]
        if not values:
            summary[name] = None
        else:
            summary[name] = interquartile_mean(values) if name == "detection_time" else sum(values) / len(values)
    return summary


def summarize_scenarios(
    each: Mapping[str, Mapping[str, float | None]], rival: Mapping[str, Mapping[str, float | None]]
) -> dict[str, Any]:
    """Return the scores of an evaluation on several scenarios.

    Detection times are the geometric mean over scenarios, so that a ratio of two policies' does not depend on the
    units of the scenarios; other scores are means. Scenarios without any target are left out.

    Args:
        each: `summarize_scores` of each scenario, by name.
        rival: The same of the first rival.

    Returns:
        `SCORES`, `RELATIVE`, and `scenarios`: the argument `each`.
    """
    summary: dict[str, Any] = {}
    for name in SCORES:
        values = [value for scores in each.values() if (value := scores[name]) is not None]
        summary[name] = (_geometric_mean if name == "detection_time" else _mean)(values)
    times = [(scores["detection_time"], rival.get(made, scores)["detection_time"]) for made, scores in each.items()]
    summary[RELATIVE] = _geometric_mean([a / max(b, _SHORTEST) for a, b in times if a is not None and b is not None])
    return summary | {"scenarios": {made: dict(scores) for made, scores in each.items()}}


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None


def _geometric_mean(values: Sequence[float]) -> float | None:
    logarithms = [math.log(max(value, _SHORTEST)) for value in values]
    return math.exp(sum(logarithms) / len(logarithms)) if logarithms else None


@dataclass
class History:
    """Counters, evaluations and the best policy of a training."""

    steps: int = 0
    """Robot steps so far."""
    seconds: float = 0.0
    """Duration without evaluations [s]."""
    curve: list[dict[str, Any]] = field(default_factory=list)
    """Evaluations, in order: steps, seconds, and the scores of `SCORES`."""
    learning: list[dict[str, float]] = field(default_factory=list)
    """Diagnostics of updates: `steps` and values of `LEARNING`; at most `MOST_UPDATES`."""
    rivals: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Scores of the rivals, by name."""
    best: dict[str, Any] | None = None
    """Evaluation of the best policy according to `add`."""

    @classmethod
    def read(cls, text: Mapping[str, Any]) -> "History":
        """Return the history in a checkpoint; `text` is the result of `checkpoint.read_text`."""
        counters = text.get("counters") or {}
        return cls(
            **{name: counters.get(name, 0) for name in ("steps", "seconds")},
            curve=text.get("curve") or [],
            learning=text.get("learning") or [],
            rivals=text.get("rivals") or {},
            best=text.get("best"),
        )

    @property
    def counters(self) -> dict[str, Any]:
        """Steps and seconds so far."""
        return {"steps": self.steps, "seconds": round(self.seconds, 1)}

    @property
    def notes(self) -> dict[str, Any]:
        """Entries of a checkpoint of the current policy."""
        scores = self.curve[-1] if self.curve else None
        more = {"curve": self.curve, "learning": self.learning, "rivals": self.rivals}
        return {"counters": self.counters, "scores": scores, **more}

    def learned(self, values: Mapping[str, float]) -> None:
        """Store diagnostics of the latest update; when there are too many, every second update is dropped."""
        finite = {name: values[name] for name in LEARNING if name in values and math.isfinite(values[name])}
        if finite:
            self.learning.append({"steps": self.steps} | finite)
        if len(self.learning) > MOST_UPDATES:
            del self.learning[1::2]

    def add(self, point: dict[str, Any]) -> bool:
        """Add an evaluation to the curve; return True if it is the best so far, which is stored as `best`.

        A policy that exceeds the collisions of every rival by at most `OFTEN` is better than one that does not;
        otherwise the higher return decides or, on several scenarios, the smaller detection time relative to a rival's.
        """
        before = max(map(self._rank, self.curve), default=None)
        self.curve.append(point)
        is_best = point["return"] is not None if before is None else self._rank(point) > before
        if is_best:
            self.best = point
        return is_best

    def first_better(self, rival: str, after: int = -1) -> dict[str, Any] | None:
        """Return the first evaluation after a number of steps that detects faster than a rival and is equally safe."""
        theirs = self.rivals[rival]["detection_time"]
        for point in self.curve:
            ours, is_later = point["detection_time"], point["steps"] > after
            is_faster = None not in (ours, theirs) and ours < theirs
            if is_later and is_faster and self._is_careful(point, [self.rivals[rival]]):
                return point
        return None

    def losses(self, rival: str) -> list[str]:
        """Return the scores in which the best policy is worse than a rival, and by how much, in words."""
        ours, theirs = self.best or {}, self.rivals[rival]
        found, here, there = [], ours.get("detection_time"), theirs["detection_time"]
        if there is not None and (here is None or here > there):
            by = "none" if here is None else f"{here:.4g} s, {here - there:.2g} s more"
            found.append(f"detection time {by} (rival: {there:.4g} s)")
        here, there = ours.get(COLLISIONS.name) or 0.0, theirs[COLLISIONS.name] or 0.0
        if here > there + OFTEN:
            found.append(f"collisions {here:.3g} per episode, {here - there:.2g} more")
        return found

    def _rank(self, point: Mapping[str, Any]) -> tuple[bool, float]:
        if RELATIVE in point:
            worth = -math.inf if point[RELATIVE] is None else -point[RELATIVE]
        else:
            worth = -math.inf if point["return"] is None else point["return"]
        return self._is_careful(point, self.rivals.values()), worth

    def _is_careful(self, point: Mapping[str, Any], rivals: Iterable[Mapping[str, Any]]) -> bool:
        theirs = [scores[COLLISIONS.name] or 0.0 for scores in rivals]
        return not theirs or (point[COLLISIONS.name] or 0.0) <= min(theirs) + OFTEN


def check_notes(text: Mapping[str, Any]) -> None:
    """Validate the entries of a checkpoint about its history.

    Raises:
        ValueError: a value has another type.
    """
    for name, kind in {"counters": dict, "curve": list, "learning": list, "rivals": dict, "best": dict}.items():
        rule = "must be an object" if kind is dict else "must be a list"
        require(name, text.get(name) is None or isinstance(text[name], kind), rule, text.get(name))
    if text.get("counters") is not None:
        _check_numbers("counters", text["counters"], ("steps",))
    for point in text.get("learning") or ():
        _check_numbers("learning", point, ("steps",), [name for name in LEARNING if name in point])
    for k, point in enumerate(text.get("curve") or ()):
        _check_numbers(f"point {k} of the curve", point, _WHEN, SCORES)
    for name, scores in (text.get("rivals") or {}).items():
        _check_numbers(f"rival {name[:40]}", scores, (), SCORES)
    if text.get("best") is not None:
        _check_numbers("best", text["best"], _WHEN, SCORES)


def _check_numbers(name: str, values: Any, counts: Iterable[str], numbers: Iterable[str] = ()) -> None:
    """Validate an object with `counts`, which are at least 0, and `numbers` or null, also those of its scenarios."""
    require(name, isinstance(values, dict), "must be an object", values)
    for key in counts:
        value = values.get(key)
        number = type(value) in (int, float) and value >= 0
        require(f"{key} of {name}", number, "must be a number of at least 0", value)
    for key in (*numbers, *([RELATIVE] if RELATIVE in values else [])):
        number = key in values and (values[key] is None or type(values[key]) in (int, float))
        require(f"{key} of {name}", number, "must be a number or null", values.get(key))
    scenarios = values.get("scenarios", {})
    require(f"scenarios of {name}", isinstance(scenarios, dict), "must be an object", scenarios)
    for scenario, scores in scenarios.items():
        _check_numbers(f"{name} on {scenario[:60]}", scores, (), numbers)
