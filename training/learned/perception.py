"""Inputs of the network of a team: numbers of the robot itself, and a set of tokens, one for each thing it perceives.

A token is a track, a teammate or, where the observation has none of these, a target or a robot in sight. All numbers
are relative to the robot, in units of `sensing.sight` and of the top speed, and a network pools its tokens, so that one
network plays teams, rectangles and numbers of targets of any size. The numbers of a track that relate it to teammates
and other tracks save the network attention between tokens.

Where actions are velocities, a rectangle and its mirror images are the same task. The axes of each robot therefore
point from the middle of the rectangle towards its own quarter, so that a network does not have to learn it four times.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baselines.policies.base import Policy
from baselines.policies.own_row import Rows
from baselines.policies.reacting import Reacting, kept_apart
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.observation import (
    NEIGHBOUR_ENTRIES,
    OWN_ENTRIES,
    ROBOT_ENTRIES,
    TARGET_ENTRIES,
    TEAMMATE_ENTRIES,
    TRACK_ENTRIES,
    track_start,
)

OWN = (
    *("cos_heading", "sin_heading", "speed", "works", "cos_phase", "sin_phase"),
    *("right", "upper", "left", "lower", "width", "height", "team", "pace"),
    *(f"neighbour_{k}_{name}" for k in (0, 1) for name, *_ in NEIGHBOUR_ENTRIES),
    *("first_base", "second_base"),
)
"""Numbers of the robot: its entries of the observation; distances to the walls [4 sights]; half of the width and of the
height [8 sights], robots [8], and the way that it drives in a step at top speed [sight]; its ring neighbours; and the
first two components of the action that the base wishes, such as a velocity, zeros without a base.
Phases and neighbours are 0 where actions are velocities, for which the paper's curve has no meaning."""
TOKEN = (
    *("track", "teammate", "target", "robot", "x", "y", "distance", "near", "x_velocity", "y_velocity"),
    *("age", "own", "other", "leaves", "mate_distance", "closer_mates", "crowd", "x_crowd", "y_crowd"),
    *("away", "right", "upper", "left", "lower"),
)
"""Numbers of a token: its kind; direction, distance d as d / (1 + d) and as 1 - d [sight]; velocity [top speed]; age
and flags; of a track the distance d of the teammate nearest to it as d / (1 + d), the teammates that are nearer to it
than the robot [4], the tracks within sight of it [4], and their mean place relative to it [sight]; its speed away from
the robot [top speed]; and its distances to the walls [2 sights]."""
_AWAY, _WALLS = TOKEN.index("away"), TOKEN.index("right")
_FAR = np.float32(1e4)
"""Distance of a teammate that is not there [sight]."""
_REST = np.float32(0.25)
"""Speed below which a car rests [top speed]."""
_MEMORY = 1.875
"""Time for which a target is assumed to keep its velocity, in units of sight over top speed."""


class Perception(NamedTuple):
    """Perception of W teams of N robots, as float32."""

    own: np.ndarray
    """(W, N, A) numbers `OWN`."""
    tokens: np.ndarray
    """(W, N, K, F) numbers `TOKEN` of each token."""
    present: np.ndarray
    """(W, N, K) 1 where there is a token, else 0."""


def wish_of(base: Policy, observation: np.ndarray) -> np.ndarray:
    """Return the actions (W, N, A) of a base; those of a `Reacting` one before its robots are steered apart."""
    if not isinstance(base, Reacting):
        return base.act(observation)
    wish = base.wish(base.rows(observation))
    return (wish / np.maximum(np.linalg.norm(wish, axis=-1, keepdims=True), 1.0)).astype(np.float32)


def commanded_velocity(velocity: np.ndarray, observation: np.ndarray, scenario: Scenario) -> np.ndarray:
    """Return the velocities (W, N, 2) [top speed] that cars are to have for those that a network wishes.

    They also lead away from robots that are near, as those of the classical policies do. Slow ones become
    zero, because a car that is to stay in its place cannot turn without leaving it.
    """
    fast = velocity * (_length(velocity) >= _REST)[..., None]
    return kept_apart(fast, Rows(observation, scenario)).astype(np.float32)


def perceive(observation: np.ndarray, scenario: Scenario, wish: np.ndarray | None = None) -> Perception:
    """Return what robots perceive according to their rows (W, N, D) in a resolved scenario.

    Args:
        observation: (W, N, D) rows.
        scenario: The scenario, resolved.
        wish: (W, N, A) actions that a base wishes, if there is one.
    """
    sensing, sight, top = scenario.sensing, scenario.sight, scenario.speed_unit
    half = half_of(scenario)
    axes = axes_of(observation, scenario)
    here = observation[..., :2] * half * axes
    parts = {}
    for start, kinds in (
        (len(OWN_ENTRIES) + 2 * len(NEIGHBOUR_ENTRIES), {"robot": ROBOT_ENTRIES, "target": TARGET_ENTRIES}),
        (track_start(scenario), {"track": TRACK_ENTRIES, "teammate": TEAMMATE_ENTRIES}),
    ):
        first = start
        for kind, entries in kinds.items():
            count, size = getattr(sensing, f"{kind}s_seen"), len(entries)
            part = observation[..., first : first + count * size].reshape(*here.shape[:2], count, size)
            parts[kind] = _along(axes, part, [name for name, *_ in entries])
            first += count * size
    chosen = ["track" if sensing.tracks_seen else "target", "teammate" if sensing.teammates_seen else "robot"]
    count = sum(parts[kind].shape[2] for kind in chosen)
    tokens = np.zeros((*here.shape[:2], count, len(TOKEN)), np.float32)
    first = 0
    for kind in chosen:
        part, token = parts[kind], tokens[:, :, first : first + parts[kind].shape[2]]
        first += part.shape[2]
        token[..., TOKEN.index(kind)] = 1.0
        offset = part[..., 1:3] * (2 * half if kind in ("track", "teammate") else np.float32(1.0))
        if kind == "track":
            offset = _describe_tracks(token, part, offset, here, half, parts["teammate"], sensing.memory * top / sight)
        elif kind == "teammate":
            token[..., 10] = part[..., 3]  # age
        elif kind == "robot":
            token[..., 8:10] = 2 * part[..., 3:5]  # x_velocity, y_velocity
        distance = _length(offset)
        token[..., 4:6] = offset / np.maximum(distance, np.float32(1e-6))[..., None]  # x, y
        token[..., 6] = distance / (1 + distance)
        token[..., 7] = np.maximum(1 - distance, 0)  # near
        token[..., _AWAY] = (token[..., 4:6] * token[..., 8:10]).sum(axis=-1)
        token[..., _WALLS:] = to_walls(here[:, :, None] + offset, half, 2)
        token *= part[..., :1] > 0.5
    own = np.zeros((*here.shape[:2], len(OWN)), np.float32)
    own[..., :4] = observation[..., [2, 3, 4, 7]]  # heading, speed, works
    own[..., :2] *= axes
    own[..., 6:10] = to_walls(here, half, 4)
    own[..., 10:12] = half / 8
    own[..., 12], own[..., 13] = scenario.num_robots / 8, top * scenario.task.step / sight
    if scenario.task.action != "velocity":
        own[..., 4:6] = observation[..., 5:7]  # phase
        own[..., 14:-2] = observation[..., len(OWN_ENTRIES) : len(OWN_ENTRIES) + len(OWN) - 16]
    if wish is not None:
        own[..., len(OWN) - 2 : len(OWN) - 2 + wish.shape[-1]] = wish[..., :2] * axes[..., : wish.shape[-1]]
    return Perception(own, tokens, tokens[..., :4].sum(axis=-1))


def _along(axes: np.ndarray, part: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Return entries (W, N, K, E) with these names whose vectors have components along the robots' axes (W, N, 2)."""
    signs, none = {"x": axes[..., :1], "y": axes[..., 1:]}, np.ones_like(axes[..., :1])
    return part * np.concatenate([signs.get(name[0], none) for name in names], axis=-1)[:, :, None]


def _describe_tracks(
    token: np.ndarray,
    part: np.ndarray,
    offset: np.ndarray,
    here: np.ndarray,
    half: np.ndarray,
    teammates: np.ndarray,
    memory: float,
) -> np.ndarray:
    """Write the numbers that tracks alone have, and return their expected offsets (W, N, K, 2) now [sight].

    Args:
        token: (W, N, K, F) tokens of the tracks.
        part: (W, N, K, 9) entries of the tracks.
        offset: (W, N, K, 2) places relative to the robot when they were last in sight [sight].
        here: (W, N, 2) places of the robots [sight].
        half: Half of the width and of the height [sight].
        teammates: (W, N, M, 4) entries of the teammates.
        memory: `sensing.memory` in units of sight over top speed.
    """
    age = np.minimum(part[..., 3] * np.float32(memory), np.float32(_MEMORY))
    token[..., 8:10] = 2 * part[..., 4:6]  # x_velocity, y_velocity
    token[..., 10] = part[..., 3]  # age
    token[..., 11:14] = part[..., 6:9]  # own, other, leaves
    here = here[:, :, None]
    offset = np.clip(here + offset + token[..., 8:10] * age[..., None], -half, half) - here
    there = part[..., 0] > 0.5
    mates = np.where(teammates[..., :1] > 0.5, teammates[..., 1:3] * (2 * half), _FAR)
    to_mates = _length(offset[:, :, :, None] - mates[:, :, None])
    nearest = to_mates.min(axis=-1, initial=_FAR)
    token[..., 14] = nearest / (1 + nearest)  # mate_distance
    token[..., 15] = (to_mates < _length(offset)[..., None]).sum(axis=-1) / np.float32(4)  # closer_mates
    between = offset[:, :, None] - offset[:, :, :, None]
    close = (_length(between) < 1) & there[:, :, None] & ~np.eye(offset.shape[2], dtype=bool)
    crowd = close.sum(axis=-1)
    token[..., 16] = crowd / np.float32(4)
    token[..., 17:19] = (between * close[..., None]).sum(axis=3) / np.maximum(crowd, 1)[..., None]  # x_crowd, y_crowd
    return offset


def axes_of(observation: np.ndarray, scenario: Scenario) -> np.ndarray:
    """Return the directions (W, N, 2) of the robots' axes, 1 or -1 along x and y; 1 where actions are no velocities.

    A component along an axis is that along x or y, multiplied by its direction; a network returns such components.
    """
    sides = observation[..., :2] if scenario.task.action == "velocity" else np.zeros((*observation.shape[:2], 2))
    return np.where(sides < 0, np.float32(-1), np.float32(1))


def half_of(scenario: Scenario) -> np.ndarray:
    """Return half of the width and of the height (2,) [sight]."""
    return np.array([scenario.curve.half_width, scenario.curve.half_height], np.float32) / np.float32(scenario.sight)


def to_walls(places: np.ndarray, half: np.ndarray, unit: float) -> np.ndarray:
    """Return the distances (..., 4) of places (..., 2) [sight] to the right, upper, left and lower wall, at most 1.

    Args:
        places: Places.
        half: Half of the width and of the height (2,) [sight].
        unit: Unit of the distances [sight].
    """
    return np.clip(np.concatenate([half - places, half + places], axis=-1) / np.float32(unit), 0, 1)


def _length(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths of vectors (..., 2)."""
    return np.sqrt(vectors[..., 0] ** 2 + vectors[..., 1] ** 2)
