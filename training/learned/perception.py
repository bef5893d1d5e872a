"""Inputs of the network of a team: numbers of the robot itself, and a set of tokens, one for each object it perceives.

A token is a track, a teammate or, where the observation has none of these, a target or a robot in sight. All numbers
are relative to the robot, in units of `sensing.sight` and of the top speed, and a network pools its tokens, so that one
network plays teams, rectangles and numbers of targets of any size. The token of a track has numbers that relate it to
teammates and to other tracks, so that the network needs no attention between tokens.

Where actions are velocities, a rectangle and its mirror images are the same task. The axes of each robot therefore
point from the middle of the rectangle towards its own quarter, so that a network does not have to learn it four times.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from baselines.policies.base import Policy
from baselines.policies.own_row import Rows
from baselines.policies.reacting import KEPT_FOR, Reacting, away_from_others
from lissajous_env.parameters.extensions import ObservationEntry
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.observation import NEIGHBOUR_ENTRIES

_BODY, _PHASE = ("cos_heading", "sin_heading", "speed", "works"), ("cos_phase", "sin_phase")
_NEIGHBOURS = tuple(f"neighbour_{k}_{name}" for k in (0, 1) for name, *_ in NEIGHBOUR_ENTRIES)
OWN = (
    *_BODY,
    *_PHASE,
    *("right", "upper", "left", "lower", "width", "height", "team", "pace"),
    *_NEIGHBOURS,
    *("first_base", "second_base"),
)
"""Numbers of the robot: its entries of the observation; distances to the walls [4 sights]; half of the width and of the
height [8 sights], number of robots [8], and the distance that it drives in a step at top speed [sight]; its ring
neighbours; and the first two components of the base's action, such as a velocity, zeros without a base.
Phases and neighbours are 0 where actions are velocities, for which the paper's curve has no meaning."""
TOKEN = (
    *("track", "teammate", "target", "robot", "x", "y", "distance", "near", "x_velocity", "y_velocity"),
    *("age", "own", "other", "leaves", "mate_distance", "closer_mates", "crowd", "x_crowd", "y_crowd"),
    *("away", "right", "upper", "left", "lower"),
)
"""Numbers of a token: its kind; direction, distance d as d / (1 + d) and as 1 - d [sight]; velocity [top speed]; age
and flags; of a track the distance d of the teammate nearest to it as d / (1 + d), the number of teammates that are
nearer to it than the robot [4], the number of tracks within sight of it [4], and their mean position relative to it
[sight]; its speed away from the robot [top speed]; and its distances to the walls [2 sights]."""


def columns_of(names: Sequence[str], first: str, last: str) -> slice:
    """Return the columns from one name to another, both included."""
    return slice(names.index(first), names.index(last) + 1)


BASE = columns_of(OWN, "first_base", "second_base")
"""Columns of the base's action among the numbers `OWN`."""
_DIRECTION, _VELOCITY = columns_of(TOKEN, "x", "y"), columns_of(TOKEN, "x_velocity", "y_velocity")
FAR = np.float32(1e4)
"""Distance of a robot that does not exist [sight]."""
_REST = np.float32(0.25)
"""Speed below which a car rests [top speed]."""


class Perception(NamedTuple):
    """Perception of W teams of N robots, as float32."""

    own: np.ndarray
    """(W, N, A) numbers `OWN`."""
    tokens: np.ndarray
    """(W, N, K, F) numbers `TOKEN` of each token."""
    present: np.ndarray
    """(W, N, K) 1 where there is a token, else 0."""


def unread_entries(scenario: Scenario) -> list[str]:
    """Return what an observation contains that no network of `perceive` reads: messages, cells and own entries."""
    sizes = {"messages.size": scenario.messages.size, "sensing.cells_seen": scenario.sensing.cells_seen}
    own = [extension.name for extension in scenario.extensions if isinstance(extension, ObservationEntry)]
    return [name for name, size in sizes.items() if size] + own


def base_action(base: Policy, observation: np.ndarray) -> np.ndarray:
    """Return the actions (W, N, A) of a base; of a `Reacting` policy, the velocities before they keep robots apart."""
    if not isinstance(base, Reacting):
        return base.act(observation)
    velocity = base.wish(base.rows(observation))
    return (velocity / np.maximum(np.linalg.norm(velocity, axis=-1, keepdims=True), 1.0)).astype(np.float32)


def actions_of(outputs: np.ndarray, observation: np.ndarray, scenario: Scenario) -> np.ndarray:
    """Return the actions (W, N, A) for the outputs of a network (W, N, A), which are clipped to [-1, 1].

    Velocities among them, which are along the robots' axes, are also led away from robots that are near, as those of
    the classical policies are. Slow ones become zero, because a car that stays near a point cannot turn without leaving
    it.
    """
    actions = outputs.clip(-1.0, 1.0)
    if scenario.task.action == "velocity":
        velocity = actions[..., :2] * axes_of(observation, scenario)
        fast = velocity * (_length(velocity) >= _REST)[..., None]
        actions[..., :2] = away_from_others(fast, Rows(observation, scenario))
    return actions


def perceive(observation: np.ndarray, scenario: Scenario, of_base: np.ndarray | None = None) -> Perception:
    """Return the inputs of a network for observation rows.

    Args:
        observation: (W, N, D) rows; velocities in them are in 2 top speeds, places of tracks in widths and heights.
        scenario: The scenario, resolved.
        of_base: (W, N, A) `base_action`, if there is a base; its messages are not read.
    """
    rows, sensing = Rows(observation, scenario), scenario.sensing
    half, axes = half_of(scenario), axes_of(observation, scenario)
    here = observation[..., :2] * half * axes
    chosen = "track" if sensing.tracks_seen else "target", "teammate" if sensing.teammates_seen else "robot"
    counts = [getattr(sensing, f"{kind}s_seen") for kind in chosen]
    # At least one slot, so that a network of a team that observes no objects has something to pool.
    tokens = np.zeros((*here.shape[:2], max(sum(counts), 1), len(TOKEN)), np.float32)
    for kind, slots in zip(chosen, (slice(counts[0]), slice(counts[0], sum(counts))), strict=True):
        token, offset = tokens[:, :, slots], rows.entries_of(kind, "x", "y") * axes[:, :, None]
        token[..., TOKEN.index(kind)] = 1.0
        if kind in ("track", "robot"):
            token[..., _VELOCITY] = 2 * rows.entries_of(kind, "x_velocity", "y_velocity") * axes[:, :, None]
        if kind in ("track", "teammate"):
            token[..., TOKEN.index("age")] = rows.entries_of(kind, "age")[..., 0]
            offset *= 2 * half
        if kind == "track":
            offset = _fill_track_tokens(token, rows, offset, here, half, axes)
        distance = _length(offset)
        token[..., _DIRECTION] = offset / np.maximum(distance, np.float32(1e-6))[..., None]
        token[..., TOKEN.index("distance")] = distance / (1 + distance)
        token[..., TOKEN.index("near")] = np.maximum(1 - distance, 0)
        token[..., TOKEN.index("away")] = (token[..., _DIRECTION] * token[..., _VELOCITY]).sum(axis=-1)
        token[..., columns_of(TOKEN, "right", "lower")] = to_walls(here[:, :, None] + offset, half, 2)
        token *= rows.entries_of(kind, "present") > 0.5
    own = np.zeros((*here.shape[:2], len(OWN)), np.float32)
    for name in _BODY if scenario.task.action == "velocity" else _BODY + _PHASE + _NEIGHBOURS:
        own[..., OWN.index(name)] = rows.entry(name)
    own[..., columns_of(OWN, "cos_heading", "sin_heading")] *= axes
    own[..., columns_of(OWN, "right", "lower")] = to_walls(here, half, 4)
    own[..., columns_of(OWN, "width", "height")] = half / 8
    own[..., OWN.index("team")] = scenario.num_robots / 8
    own[..., OWN.index("pace")] = scenario.speed_unit * scenario.task.step / scenario.sight
    if of_base is not None:
        own[..., BASE][..., : of_base.shape[-1]] = of_base[..., :2] * axes[..., : of_base.shape[-1]]
    return Perception(own, tokens, tokens[..., :4].sum(axis=-1))


def _fill_track_tokens(
    token: np.ndarray, rows: Rows, offset: np.ndarray, here: np.ndarray, half: np.ndarray, axes: np.ndarray
) -> np.ndarray:
    """Write the numbers that only tracks have, and return their expected offsets now (W, N, K, 2) [sight].

    Args:
        token: (W, N, K, F) tokens of the tracks, with their velocities and ages.
        rows: Rows of the robots.
        offset: (W, N, K, 2) positions relative to the robot when they were last in sight [sight].
        here: (W, N, 2) positions of the robots [sight].
        half: Half of the width and of the height [sight].
        axes: (W, N, 2) directions of the robots' axes.
    """
    memory = rows.scenario.sensing.memory * rows.scenario.speed_unit / rows.scenario.sight
    age = np.minimum(token[..., TOKEN.index("age")] * np.float32(memory), np.float32(KEPT_FOR))
    token[..., columns_of(TOKEN, "own", "leaves")] = rows.entries_of("track", "own", "other", "leaves")
    here = here[:, :, None]
    offset = np.clip(here + offset + token[..., _VELOCITY] * age[..., None], -half, half) - here
    places = rows.entries_of("teammate", "x", "y") * axes[:, :, None] * (2 * half)
    mates = np.where(rows.teammates[..., None], places, FAR)
    to_mates = _length(offset[:, :, :, None] - mates[:, :, None])
    nearest = to_mates.min(axis=-1, initial=FAR)
    token[..., TOKEN.index("mate_distance")] = nearest / (1 + nearest)
    closer_mates = (to_mates < _length(offset)[..., None]).sum(axis=-1)
    token[..., TOKEN.index("closer_mates")] = closer_mates / np.float32(4)
    between = offset[:, :, None] - offset[:, :, :, None]
    close = (_length(between) < 1) & rows.tracks[:, :, None] & ~np.eye(offset.shape[2], dtype=bool)
    crowd = close.sum(axis=-1)
    token[..., TOKEN.index("crowd")] = crowd / np.float32(4)
    mean = (between * close[..., None]).sum(axis=3) / np.maximum(crowd, 1)[..., None]
    token[..., columns_of(TOKEN, "x_crowd", "y_crowd")] = mean
    return offset


def axes_of(observation: np.ndarray, scenario: Scenario) -> np.ndarray:
    """Return the directions (W, N, 2) of the robots' axes, 1 or -1 along x and y; 1 where actions are no velocities.

    A network reads and returns components along these axes: those along x and y, multiplied by the directions.
    """
    sides = observation[..., :2] if scenario.task.action == "velocity" else np.zeros((*observation.shape[:2], 2))
    return np.where(sides < 0, np.float32(-1), np.float32(1))


def half_of(scenario: Scenario) -> np.ndarray:
    """Return half of the width and of the height (2,) [sight]."""
    return np.array([scenario.curve.half_width, scenario.curve.half_height], np.float32) / np.float32(scenario.sight)


def to_walls(positions: np.ndarray, half: np.ndarray, unit: float) -> np.ndarray:
    """Return the distances (..., 4) to the right, upper, left and lower wall [unit], at most 1.

    Args:
        positions: (..., 2) x, y [sight].
        half: Half of the width and of the height (2,) [sight].
        unit: Unit of the distances [sight].
    """
    return np.clip(np.concatenate([half - positions, half + positions], axis=-1) / np.float32(unit), 0, 1)


def _length(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths of vectors (..., 2)."""
    return np.sqrt(vectors[..., 0] ** 2 + vectors[..., 1] ** 2)
