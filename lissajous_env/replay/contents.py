"""Data of a recording for a page, thinned and quantised for display.

Positions, angles, speeds, rewards and observations are rounded to 1/65,535 of their range, times to a control step.
Long episodes are thinned in time, fine grids in space; the ground is stored every other control step. Arrays are
encoded as text: quantised, differenced in time, compressed by zlib, in base64. A page decodes `value = low +
scale * q`, where `q` is an unsigned integer of 8, 16 or 32 bits. Each series (the last axis) is stored as
differences between moments modulo 2^bits, with the lower bytes of all numbers first.
"""

import base64
import math
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from lissajous_env.episodes.missed import MissedRogue
from lissajous_env.episodes.recording import Recording
from lissajous_env.episodes.snapshot import thinned
from lissajous_env.render.ground import points_of_curve
from lissajous_env.render.targets import flash_time, has_sightings
from lissajous_env.render.team import MOST_CONTACTS, drawn_links, parts_of_body, trail_time
from lissajous_env.world.columns import task_score
from lissajous_env.world.state import NEVER

FORMAT = "lissajous replay 1"
LEVELS = 65_535
"""Number of steps between the smallest and the largest number of a quantised array."""
FARTHEST = 1e12
"""Limit on the numbers of a page; larger ones are clipped."""


@dataclass(frozen=True)
class Detail:
    """Limits on the data of an episode in a page."""

    moments: int = 6_000
    """Number of moments."""
    cells: tuple[int, int] = (128, 128)
    """Number of rows and columns of a grid."""
    ground_every: int = 2
    """Control steps between two pictures of the ground."""
    observed: int = 6_000_000
    """Total number of observed values; further robots have no observations in the page."""


WHOLE = Detail()
BRIEF = Detail(moments=400, cells=(40, 40), ground_every=10, observed=0)
"""Limits for a page with many episodes."""
_MOST_GROUND = 2**24
"""Limit on the total number of values of the ground."""
_MOST_PLACES = 6_000_000
"""Limit on the positions of all targets in all moments; further targets are omitted."""


def contents(recording: Recording, detail: Detail = WHOLE, missed: MissedRogue | None = None) -> dict[str, Any]:
    """Convert a recording, and a rogue that its policy misses, to JSON values."""
    scenario, every = recording.scenario, max(math.ceil(len(recording) / detail.moments), 1)
    moments, of_task = slice(None, None, every), task_score(scenario).name
    names = sorted(recording.score, key=lambda name: name != of_task)
    terms = np.cumsum(recording.reward_terms.mean(axis=1), axis=0, dtype=np.float64)[::every]
    return {
        "scenario": _about(recording),
        "policy": str(recording.score.get("policy", "")),
        "seed": recording.score["seed"],
        "score": {str(name): _plain(recording.score[name]) for name in names},
        "step": scenario.task.step,
        "every": every,
        "moments": len(recording.position[moments]),
        "curve": quantised(points_of_curve(scenario)),
        "robots": _robots(recording, moments, detail.observed),
        "targets": _targets(recording, moments),
        "ground": _ground(recording, every, detail),
        "contacts": _contacts(recording.contact, every),
        "collisions": counts(recording.collisions[moments], int(recording.collisions.max())),
        "reward": {
            "names": list(recording.reward_names),
            "terms": quantised_each(np.diff(terms, axis=0, prepend=0.0)),  # since the previous stored moment
        },
        "rogue": None if missed is None else _rogue(missed),
    }


def quantised_each(table: np.ndarray) -> list[dict[str, Any]]:
    """Pack each column of a table (F, ..., K) to 1/65,535 of its own range."""
    return [quantised(table[..., k]) for k in range(table.shape[-1])]


def _about(recording: Recording) -> dict[str, Any]:
    scenario, curve = recording.scenario, recording.scenario.curve
    return {
        "name": scenario.name,
        "description": scenario.description,
        "half": [curve.half_width, curve.half_height, curve.half_depth],
        "radius": scenario.robot.radius,
        "sensing": scenario.sensing_radius,
        "sight": scenario.sight,
        "bound": scenario.detection_time_bound,
        "bound_name": scenario.detection_time_label,
        "trail": 2 * trail_time(scenario),
        "flash": flash_time(scenario),
        "links": drawn_links(scenario),
        "places": list(scenario.places),
        "neighbours": scenario.neighbours.tolist(),
        "equilibrium": scenario.equilibrium.tolist(),
        "delay": scenario.delay_steps,
        "leave": scenario.targets.leave,
        "actions": list(scenario.action_names),
        "shape": [[np.round(outline, 3).tolist(), fill] for outline, fill in parts_of_body(scenario)],
    }


def _robots(recording: Recording, moments: slice, most: int) -> dict[str, Any]:
    observed = recording.observation[moments]
    f, n, d = observed.shape
    watched = min(n, most // (f * d))
    # An observation is followed by the action of the next step.
    answers = np.concatenate([recording.action[1:], recording.action[-1:]])[moments]
    now = np.arange(len(recording))[:, None, None]
    return {
        "count": n,
        **{name: quantised(recording.position[moments, :, k]) for k, name in enumerate("xyz")},
        **{name: quantised(getattr(recording, name)[moments]) for name in ("heading", "speed", "phase")},
        "status": counts(recording.status[moments], 2),
        "silent": counts(np.where(recording.heard_at < 0, -1, now - recording.heard_at)[moments], 253),
        "watched": watched,
        "names": list(recording.observation_names),
        "observation": quantised_each(observed[:, :watched]),
        "action": quantised_each(answers[:, :watched]),
        "reward": quantised(recording.reward_terms.sum(axis=-1)[moments]),
    }


def _targets(recording: Recording, moments: slice) -> dict[str, Any]:
    places = recording.target_position[moments]
    # A slot in which nothing appeared until the end is no target.
    every_target = np.flatnonzero(recording.appears_at < len(recording))
    most = max(_MOST_PLACES // (2 * len(places)), 1)
    appeared = every_target[:: max(math.ceil(len(every_target) / most), 1)]
    found_at = recording.found_at[appeared]
    return {
        "count": len(appeared),
        "x": quantised(places[:, appeared, 0]),
        "y": quantised(places[:, appeared, 1]),
        "seen": counts(_in_sight(recording, moments)[:, appeared], 1),
        "motion": recording.motion[appeared].tolist(),
        "appears": recording.appears_at[appeared].tolist(),
        "found": np.where(found_at < len(recording), found_at - recording.found_early[appeared], -1.0)
        .round(4)
        .tolist(),
    }


def _in_sight(recording: Recording, moments: slice) -> np.ndarray:
    """Return (F, T) 1 for targets in sight in the stored moments; 0 where nothing is drawn for them."""
    steps, sight = range(len(recording))[moments], recording.scenario.sight
    if not has_sightings(recording.scenario):
        return np.zeros(recording.target_position[moments].shape[:2], np.uint8)
    return np.stack([recording.snapshot(step).in_sight(sight) for step in steps])


def _rogue(missed: MissedRogue) -> dict[str, Any]:
    """Return the step at whose end a rogue appears, and its places [m] then and after every few steps."""
    path, step = missed.path, missed.played.scenario.task.step
    every = max(math.ceil(len(path.places) / WHOLE.moments), 1)
    return {
        "begin": path.appears_at,
        "every": every,
        "places": np.round(path.places, 3)[::every].tolist(),
        "until": round(path.appears_at + missed.undetected / step, 3),
        "detected": missed.detected,
    }


def _ground(recording: Recording, every: int, detail: Detail) -> dict[str, Any]:
    """Return when cells were last sensed, and since when a target can be undetected in them."""
    task, ground = recording.scenario.task, {}
    stride = every * max(round(detail.ground_every / every), 1)
    for grid, since, name, age in (
        (task.grid, recording.sensed_at, "sensed", "idle"),
        (task.contamination, recording.introduced_at, "unseen", "age"),
    ):
        if grid is not None:
            cells = np.stack([thinned(cells_then, detail.cells) for cells_then in since[::stride]])
            fewer = max(math.ceil(cells.size / _MOST_GROUND), 1)
            ground[name] = {"stride": stride * fewer, "cells": counts(cells[::fewer], len(recording))}
            ground[age] = _worst_and_mean(since, every, task.step)
    return ground


def _worst_and_mean(since: np.ndarray, every: int, step: float) -> list[dict[str, Any]]:
    """Return the largest and the mean age over all cells in the stored moments [s]."""
    stored = since[::every]
    ages = np.where(stored >= NEVER, 0, every * np.arange(len(stored), dtype=np.int32)[:, None, None] - stored)
    return [quantised(step * ages.max(axis=(1, 2))), quantised(step * ages.mean(axis=(1, 2)))]


def _contacts(contact: np.ndarray, every: int) -> list[list[int]]:
    """Return contacts as [robot, robot, first moment, last moment] in stored moments."""
    order = contact[np.lexsort((contact[:, 0], contact[:, 2], contact[:, 1]))].astype(np.int64)
    apart = np.diff(order, axis=0, prepend=-2)
    begins = np.flatnonzero((apart[:, 0] != 1) | apart[:, 1:].any(axis=1))
    ends = np.append(begins[1:], len(order))[: len(begins)] - 1
    spans = np.stack([order[begins, 1], order[begins, 2], order[begins, 0] // every, order[ends, 0] // every], axis=1)
    return spans[np.argsort(spans[:, 2], kind="stable")][:MOST_CONTACTS].tolist()


def _plain(value: Any) -> Any:
    """Convert a value of a score row to JSON."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, str) or value is None else min(max(value, -FARTHEST), FARTHEST)


def quantised(values: np.ndarray) -> dict[str, Any]:
    """Encode numbers (F, ...), time first, to 1/65,535 of their range; decoded they are (..., F)."""
    values = np.clip(np.asarray(values, dtype=np.float64), -FARTHEST, FARTHEST)
    low = float(values.min()) if values.size else 0.0
    scale = (float(values.max()) - low) / LEVELS if values.size else 0.0
    whole = np.rint((values - low) / (scale or 1.0)).astype(np.uint16)
    return _packed(whole, low, scale)


def counts(values: np.ndarray, most: int) -> dict[str, Any]:
    """Encode whole numbers (F, ...); numbers below 0 or above `most` become `most` + 1."""
    values = np.asarray(values, dtype=np.int64)
    values = np.where((values < 0) | (values > most), most + 1, values)
    dtype = next(candidate for candidate in (np.uint8, np.uint16, np.uint32) if most + 1 <= np.iinfo(candidate).max)
    return _packed(values.astype(dtype), 0.0, 1.0) | {"none": most + 1}


def _packed(whole: np.ndarray, low: float, scale: float) -> dict[str, Any]:
    series = np.ascontiguousarray(np.moveaxis(whole, 0, -1))
    changes = np.diff(series, axis=-1, prepend=series.dtype.type(0))
    size = series.dtype.itemsize
    planes = np.ascontiguousarray(changes).astype(series.dtype.newbyteorder("<")).view(np.uint8).reshape(-1, size).T
    text = base64.b64encode(zlib.compress(planes.tobytes(), 6)).decode()
    return {"shape": list(series.shape), "bits": 8 * size, "low": low, "scale": scale, "data": text}
