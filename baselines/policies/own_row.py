"""The entries of a robot's observation row, decoded: in kernels, and in NumPy and SI units by `Rows`."""

from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.curve import CurveStruct
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import require
from lissajous_env.world.observation import LINK_SIZE, OWN_SIZE, ROBOT_SIZE, cell_start, layout

Observation = wp.array3d(dtype=float)
"""(W, N, D) observation rows of W worlds of N robots."""
Actions = wp.array3d(dtype=float)
"""(W, N, A) actions of the robots, in [-1, 1]."""

# Indices of a robot's own entries, and within those of a ring neighbour and of a robot in sight, in the order of
# `OWN_ENTRIES`, `NEIGHBOUR_ENTRIES` and `ROBOT_ENTRIES` of `lissajous_env.world.observation`.
X, Y, COS_HEADING, SIN_HEADING, SPEED, COS_PHASE, SIN_PHASE, WORKS = (wp.constant(k) for k in range(OWN_SIZE))
HEARD, AGE, COS_LEAD, SIN_LEAD, X_AWAY, Y_AWAY = (wp.constant(k) for k in range(LINK_SIZE))
PRESENT, X_SEEN, Y_SEEN, X_VELOCITY, Y_VELOCITY = (wp.constant(k) for k in range(ROBOT_SIZE))


@wp.func
def own_position(w: int, i: int, curve: CurveStruct, observation: Observation) -> wp.vec2:
    """Return the measured x, y [m]."""
    return wp.vec2(observation[w, i, X] * curve.half_width, observation[w, i, Y] * curve.half_height)


@wp.func
def own_heading(w: int, i: int, observation: Observation) -> float:
    """Return the measured heading [rad]."""
    return wp.atan2(observation[w, i, SIN_HEADING], observation[w, i, COS_HEADING])


@wp.func
def own_speed(w: int, i: int, speed_unit: float, observation: Observation) -> float:
    """Return the measured speed [m/s]; `speed_unit` is `Scenario.speed_unit` [m/s]."""
    return observation[w, i, SPEED] * speed_unit


@wp.func
def own_phase(w: int, i: int, observation: Observation) -> float:
    """Return the measured phase theta in [-pi, pi] [rad]."""
    return wp.atan2(observation[w, i, SIN_PHASE], observation[w, i, COS_PHASE])


@wp.func
def own_works(w: int, i: int, observation: Observation) -> bool:
    """Return whether the robot itself works."""
    return observation[w, i, WORKS] > 0.5


@wp.func
def own_key(w: int, i: int, observation: Observation) -> int:
    """Return the key of a robot's random draws, computed from its position: the same in any batch, at any index."""
    x = int(observation[w, i, X] * 1.0e6)
    y = int(observation[w, i, Y] * 1.0e6)
    return randomness.step_key(x, y)


@wp.func
def has_ever_heard(w: int, i: int, observation: Observation) -> bool:
    """Return whether a ring neighbour has ever sent a message; the row of a removed robot contains none."""
    return observation[w, i, OWN_SIZE + HEARD] > 0.5 or observation[w, i, OWN_SIZE + LINK_SIZE + HEARD] > 0.5


@wp.func
def hears(w: int, i: int, side: int, observation: Observation) -> bool:
    """Return whether the latest message of a ring neighbour is recent enough to be used."""
    start = OWN_SIZE + LINK_SIZE * side
    return observation[w, i, start + HEARD] > 0.5 and observation[w, i, start + AGE] < 1.0


@wp.func
def message_age(w: int, i: int, side: int, unit: float, observation: Observation) -> float:
    """Return the time since a ring neighbour sent its message [s]; `unit` is `Scenario.time_unit` [s]."""
    return observation[w, i, OWN_SIZE + LINK_SIZE * side + AGE] * unit


@wp.func
def lead(w: int, i: int, side: int, observation: Observation) -> float:
    """Return the phase of a ring neighbour relative to the robot's own, theta_j - theta_i in [-pi, pi] [rad]."""
    start = OWN_SIZE + LINK_SIZE * side
    return wp.atan2(observation[w, i, start + SIN_LEAD], observation[w, i, start + COS_LEAD])


@wp.func
def sine_ahead(w: int, i: int, side: int, rate: float, unit: float, observation: Observation) -> float:
    """Return sin(theta_j - theta_i) of a ring neighbour, its phase extrapolated at `rate` [rad/s] since it was sent.

    It is zero for a neighbour without a recent message; `unit` is `Scenario.time_unit` [s].
    """
    if not hears(w, i, side, observation):
        return 0.0
    start = OWN_SIZE + LINK_SIZE * side
    ahead = rate * message_age(w, i, side, unit, observation)
    return observation[w, i, start + SIN_LEAD] * wp.cos(ahead) + observation[w, i, start + COS_LEAD] * wp.sin(ahead)


@wp.func
def offset_heard(w: int, i: int, side: int, curve: CurveStruct, observation: Observation) -> wp.vec2:
    """Return the place that a ring neighbour sent, relative to the robot's own x, y [m]."""
    start = OWN_SIZE + LINK_SIZE * side
    x = 2.0 * curve.half_width * observation[w, i, start + X_AWAY]
    y = 2.0 * curve.half_height * observation[w, i, start + Y_AWAY]
    return wp.vec2(x, y)


@wp.func
def sees(w: int, i: int, k: int, observation: Observation) -> bool:
    """Return whether there is a k-th nearest robot in sight."""
    return observation[w, i, OWN_SIZE + 2 * LINK_SIZE + ROBOT_SIZE * k + PRESENT] > 0.5


@wp.func
def offset_seen(w: int, i: int, k: int, radius: float, observation: Observation) -> wp.vec2:
    """Return the place of the k-th nearest robot within sight, of `radius` [m], relative to the robot's x, y [m]."""
    start = OWN_SIZE + 2 * LINK_SIZE + ROBOT_SIZE * k
    return wp.vec2(radius * observation[w, i, start + X_SEEN], radius * observation[w, i, start + Y_SEEN])


@wp.func
def velocity_seen(w: int, i: int, k: int, speed_unit: float, observation: Observation) -> wp.vec2:
    """Return the relative velocity of the k-th nearest robot in sight [m/s]; `speed_unit` as for `own_speed`."""
    start = OWN_SIZE + 2 * LINK_SIZE + ROBOT_SIZE * k
    relative = wp.vec2(observation[w, i, start + X_VELOCITY], observation[w, i, start + Y_VELOCITY])
    return relative * (2.0 * speed_unit)


def _quantity(kind: str, *names: str, unit: str = "") -> cached_property[np.ndarray]:
    """Return a property of `Rows`: entries times a unit of `_decoded`; without a unit, True for those above 0.5.

    They are those of the K things of a kind, (W, N, K) for one name and (W, N, K, len(names)) for several, or, for the
    kind "own", those of the robot itself, without the axis K.
    """

    def values(rows: "Rows") -> np.ndarray:
        own = kind == "own"
        entries = np.stack([*map(rows.entry, names)], axis=-1) if own else rows.entries_of(kind, *names)
        entries = entries if len(names) > 1 else entries[..., 0]
        return entries * rows._units[unit] if unit else entries > 0.5

    return cached_property(values)


class Rows:
    """The observation (W, N, D) of W worlds of N robots as named quantities in SI units.

    Neighbour 0 precedes the robot on the ring, neighbour 1 follows it. Values are 0 for a neighbour without a message
    (`lead` also without a recent one), and for robots and targets beyond those in sight.

    Args:
        observation: Observation as a policy receives it, of float32.
        scenario: Scenario of the observation.

    Attributes:
        position: (W, N, 2) measured x, y [m].
        speed: (W, N) measured speed [m/s].
        works: (W, N) True if the robot itself works.
        age: (W, N, 2) time since each neighbour's message was sent [s].
        neighbour_offset: (W, N, 2, 2) relative x, y of each neighbour's message [m].
        robots_seen: (W, N, R) True for a robot in sight; the nearest is the first.
        robot_offset: (W, N, R, 2) relative x, y of the robots in sight [m].
        robot_velocity: (W, N, R, 2) relative velocity of the robots in sight [m/s].
        targets_seen: (W, N, T) True for a target in sight; the nearest is the first.
        target_offset: (W, N, T, 2) relative x, y of the targets in sight [m].
        tracks: (W, N, K) True for a track; the nearest is the first.
        track_offset: (W, N, K, 2) relative x, y of the tracks when they were last in sight [m].
        track_velocity: (W, N, K, 2) velocity of the tracks then [m/s]; 0 if unknown.
        track_age: (W, N, K) time since the tracks were last in sight [s].
        track_of_other: (W, N, K) True if another robot had the track in sight according to the latest messages.
        track_leaves: (W, N, K) True for the track of a target that was detected and leaves.
        teammates: (W, N, M) True for a teammate whose place is known; the nearest is the first.
        teammate_offset: (W, N, M, 2) relative x, y of the teammates in their last messages [m].

    Raises:
        ValueError: the rows are not as long as those of the scenario.
    """

    position = _quantity("own", "x", "y", unit="half sides")
    speed = _quantity("own", "speed", unit="speed")
    works = _quantity("own", "works")
    age = _quantity("neighbour", "age", unit="time")
    neighbour_offset = _quantity("neighbour", "x", "y", unit="sides")
    robots_seen = _quantity("robot", "present")
    robot_offset = _quantity("robot", "x", "y", unit="sight")
    robot_velocity = _quantity("robot", "x_velocity", "y_velocity", unit="relative speed")
    targets_seen = _quantity("target", "present")
    target_offset = _quantity("target", "x", "y", unit="sight")
    tracks = _quantity("track", "present")
    track_offset = _quantity("track", "x", "y", unit="sides")
    track_velocity = _quantity("track", "x_velocity", "y_velocity", unit="relative speed")
    track_age = _quantity("track", "age", unit="memory")
    track_of_other = _quantity("track", "other")
    track_leaves = _quantity("track", "leaves")
    teammates = _quantity("teammate", "present")
    teammate_offset = _quantity("teammate", "x", "y", unit="sides")

    def __init__(self, observation: np.ndarray, scenario: str | Scenario):
        self.scenario, self._indices, self._columns, self._units = _decoded(named.build(scenario))
        self.values = np.asarray(observation)
        if self.values.shape[-1:] != (len(self._indices),):
            rule = f"observation must have rows of {len(self._indices)} numbers for {self.scenario.name}"
            raise ValueError(f"{rule}, got shape {self.values.shape}")

    def entry(self, name: str) -> np.ndarray:
        """Return the raw values (W, N) of an entry, by its name in the layout of the observation."""
        rule = f"must be one of the {len(self._indices)} of the layout of the observation of {self.scenario.name}"
        require(name in self._indices, "entry", rule, name, self._indices)
        return self.values[..., self._indices[name]]

    def entries_of(self, kind: str, *names: str) -> np.ndarray:
        """Return the raw values (W, N, K, len(names)) of entries of the K things of a kind, such as `track`."""
        if (kind, names) not in self._columns:
            count = 2 if kind == "neighbour" else getattr(self.scenario.sensing, f"{kind}s_seen")
            indices = [self._indices[f"{kind}_{k}_{name}"] for k in range(count) for name in names]
            self._columns[kind, names] = np.array(indices, dtype=int).reshape(count, len(names))
        return self.values.take(self._columns[kind, names], axis=-1)

    @cached_property
    def heading(self) -> np.ndarray:
        """Return the measured heading (W, N) [rad]."""
        return self._angle("heading")

    @cached_property
    def phase(self) -> np.ndarray:
        """Return the measured phase theta (W, N) in [-pi, pi] [rad]."""
        return self._angle("phase")

    @cached_property
    def heard(self) -> np.ndarray:
        """Return whether each neighbour's latest message is recent enough (W, N, 2)."""
        ever, age = np.moveaxis(self.entries_of("neighbour", "heard", "age"), -1, 0)
        return (ever > 0.5) & (age < 1)

    @cached_property
    def lead(self) -> np.ndarray:
        """Return the relative phase of each neighbour's message (W, N, 2), theta_j - theta_i in [-pi, pi] [rad]."""
        sine, cosine = (self.entries_of("neighbour", f"{part}_phase")[..., 0] for part in ("sin", "cos"))
        return np.where(self.heard, np.arctan2(sine, cosine), 0.0)

    @cached_property
    def message(self) -> np.ndarray:
        """Return the last message of each neighbour's policy (W, N, 2, k), k = `messages.size`; zeros if none."""
        return self.entries_of("neighbour", *(f"message_{m}" for m in range(self.scenario.messages.size)))

    @cached_property
    def cell_age(self) -> np.ndarray:
        """Return the time since each cell was covered, as far as the robot knows, at most the memory (W, N, Y, X) [s].

        Row 0 of the Y rows is the lowest of the rectangle, and column 0 of the X columns its left one.
        """
        columns, rows = self.scenario.sensing.cells_seen or (0, 0)
        start = cell_start(self.scenario)
        ages = self.values[..., start : start + columns * rows] * self.scenario.sensing.memory
        return ages.reshape(*ages.shape[:-1], rows, columns)

    def _angle(self, name: str) -> np.ndarray:
        return np.arctan2(self.entry(f"sin_{name}"), self.entry(f"cos_{name}"))


@lru_cache(maxsize=64)
def _decoded(scenario: Scenario) -> tuple[Scenario, dict[str, int], dict[tuple, np.ndarray], dict[str, Any]]:
    """Return a scenario with every field filled in, indices of entries by name, those that were read, and units."""
    scenario = scenario.resolve()
    half = np.array([scenario.curve.half_width, scenario.curve.half_height])
    units = {
        "time": scenario.time_unit,
        "half sides": half,
        "sides": 2 * half,
        "sight": scenario.sight,
        "speed": scenario.speed_unit,
        "relative speed": 2 * scenario.speed_unit,
        "memory": scenario.sensing.memory,
    }
    return scenario, {name: k for k, name in enumerate(layout(scenario).names)}, {}, units
