"""The parts of a scenario: frozen dataclasses, each field with its meaning, its unit and its range beside it.

Units are SI, angles radians. The ranges are wide: they keep what the kernels compute within float32 and a slip of the
keyboard from asking for more memory than there is. A field that is None by default is derived from others.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lissajous_env.parameters.checks import Checked, as_robot, choice, flag, is_whole, number, odd, rows, whole, word

MOST_TARGETS = 2**21
"""Most targets of an episode."""
FULL_THROTTLE = 0.25
"""Throttle of a car at action 1 where neither `robot.throttle_max` nor `robot.speed_max` is given, as in the paper."""
SPRINT = 3.0
"""Phase rate of a point at action 1, where nothing else is said, as a multiple of the formation's own."""
_LONGEST = 1e9
"""Latest time that a schedule may name [s]."""


def _as_place(entry: Any) -> int | None:
    return entry if is_whole(entry) and 0 <= entry < 1024 else None


def _as_displacement(entry: Any) -> tuple[int, float] | None:
    robot, angle = entry
    return (as_robot(robot), float(angle)) if abs(float(angle)) <= 100 else None


def _as_fault(entry: Any) -> tuple[int, float, float] | None:
    robot, start, end = entry
    holds = 0 <= start < end and start <= _LONGEST and (end <= _LONGEST or end == math.inf)
    return (as_robot(robot), float(start), float(end)) if holds else None


def _as_removal(entry: Any) -> tuple[int, float] | None:
    robot, time = entry
    return (as_robot(robot), float(time)) if 0 <= time <= _LONGEST else None


def _as_harmonic(entry: Any) -> tuple[float, ...] | None:
    row = tuple(float(number) for number in entry)
    return row if len(row) == 4 and all(abs(number) <= 1e4 for number in row) else None


def _as_lines(entry: Any) -> int | None:
    return entry if is_whole(entry) and 1 <= entry <= 4096 else None


@dataclass(frozen=True)
class Curve(Checked):
    """The Lissajous curve (3), or (10) where `half_depth` is above 0, and with it the rectangle [-A, A] x [-B, B]."""

    half_width: float = number(1.8, 1e-3, 1e4, "m")
    """A, half of the rectangle's width [m]."""
    half_height: float = number(0.8, 1e-3, 1e4, "m")
    """B, half of the rectangle's height [m]."""
    a: int = odd(3, 1023)
    """a, oscillations along x in one lap; odd."""
    b: int = whole(2, 1, 1023)
    """b, oscillations along y in one lap; shares no factor with a."""
    half_depth: float = number(0.0, 0, 1e4, "m")
    """C of (10), half of the curve's extent along z [m]; 0 is the plane curve."""
    c: int = whole(1, 1, 1023)
    """c of (10), oscillations along z in one lap."""
    harmonics: tuple[tuple[float, float, float, float], ...] = rows(
        (), "must hold at most 64 rows of four numbers from -10000 to 10000 [m]", _as_harmonic, units=("m",) * 4
    )
    """Another closed curve, in place of (3): for k = 1, 2 ... a row of what multiplies cos(k gamma) and sin(k gamma) in
    x, then in y [m]. It has to stay in the rectangle; a circle of radius R is ((R, 0, 0, R),)."""

    @classmethod
    def through(cls, position: Callable[[np.ndarray], Any], harmonics: int = 64, **fields: Any) -> "Curve":
        """The closed curve of a function, as a Fourier series.

        Args:
            position: x and y [m], each (K,), of gamma (K,) in [0, 2 pi) [rad]; it is smooth and closes.
            harmonics: How many, at most 64; what is above them is left out.
            **fields: `half_width` and `half_height` of the rectangle [m].

        Raises:
            ValueError: it returns other shapes or numbers that are not finite, or is off the series by more than a
                thousandth of its size.
        """
        gamma = np.arange(1024) * (2 * np.pi / 1024)
        places = np.asarray(position(gamma), dtype=float)
        if places.shape != (2, len(gamma)) or not np.isfinite(places).all():
            raise ValueError(f"position must return finite x and y for each gamma, got shape {places.shape}")
        waves = np.fft.rfft(places, axis=1)[:, 1 : harmonics + 1] * (2 / len(gamma))
        table = np.stack([waves[0].real, -waves[0].imag, waves[1].real, -waves[1].imag], axis=1)
        k = np.arange(1, len(table) + 1)[:, None]
        series = np.einsum("kc,kg->cg", table[:, ::2], np.cos(k * gamma))
        series += np.einsum("kc,kg->cg", table[:, 1::2], np.sin(k * gamma))
        off = np.abs(series - places).max()
        if off > 1e-3 * np.abs(places).max():
            rule = f"must be smooth and around the middle of the rectangle, for {harmonics} harmonics"
            raise ValueError(f"position {rule}, got a curve that these miss by {off:.3g} m")
        told = np.abs(table) > 1e-9 * np.abs(table).max()
        table = table[: np.flatnonzero(told.any(axis=1))[-1] + 1]
        return cls(harmonics=tuple(map(tuple, np.where(told[: len(table)], table, 0.0).tolist())), **fields)

    @property
    def oscillations(self) -> int:
        """How finely the curve is woven: a + b, or twice the number of harmonics."""
        return 2 * len(self.harmonics) or self.a + self.b

    def _check_together(self) -> None:
        if self.harmonics:
            self._require(len(self.harmonics) <= 64, "harmonics", "must hold at most 64 rows")
            self._require(any(any(row) for row in self.harmonics), "harmonics", "must hold a number that is not 0")
            self._require(self.half_depth == 0, "half_depth", "must be 0 beside harmonics [m]")
            return
        # The paper does not ask for it, but without it the formation collides: (3, 6) has a smallest distance of 0.
        self._require(math.gcd(self.a, self.b) == 1, "b", f"must share no factor with a = {self.a}")


@dataclass(frozen=True)
class Formation(Checked):
    """How robots coordinate along the curve: dynamics (1) and its equilibrium (2)."""

    phase_rate: float = number(0.3, 1e-9, 1e3, "rad/s")
    """omega of (1), the rate of the robots along the curve's parameter in the equilibrium [rad/s]."""
    coupling: float | None = number(None, 0, 1e3, "1/s")
    """K, the gain on the sum in (1) [1/s]; None is omega / (0.3 rad), which in the paper's experiment is the 1/s that
    the paper prints."""
    p: int | None = whole(None, 0, 1024)
    """p of the equilibrium (2); None takes the least clustered stable one."""
    alpha: int | None = whole(None, 1, 1024)
    """alpha of Lemma 2: gamma = alpha theta; None makes neighbours on the ring neighbours on the ellipse (5)."""
    ring: tuple[int, ...] | None = rows(None, "must list robots as whole numbers from 0", _as_place)
    """Order of the robots around the communication ring; None is 0, 1 ... N - 1."""
    start: str = choice("equilibrium", "equilibrium", "rotated", "random")
    """Phases at reset: the equilibrium (2) with theta_0 = 0, the same turned by a random angle, or all random."""
    start_noise: float = number(0.0, 0, 100, "rad")
    """Standard deviation of a random displacement of each robot's phase at reset [rad]."""
    displaced: tuple[tuple[int, float], ...] = rows(
        (), "must hold pairs of a robot and an angle from -100 to 100 [rad]", _as_displacement, units=("", "rad")
    )
    """Robots displaced along the phase at reset, each as (robot, angle [rad])."""


@dataclass(frozen=True)
class Robot(Checked):
    """The robots: points on the curve, or kinematic bicycles (12) driven by a motor."""

    kind: str = word("car", "must be the name of a robot model")
    """`car`: action = steering, throttle. `curve`: a point on the curve, action = phase rate. Or one's own model."""
    count: int | None = whole(None, 1, 1024)
    """N; None is a + b."""
    radius: float = number(0.125, 1e-6, 1e3, "m")
    """r_i, radius of the disc (the ball, in three dimensions) that two robots must keep from sharing [m]."""
    phase_rate_max: float | None = number(None, 1e-12, 1e4, "rad/s")
    """Phase rate of a `curve` robot at action 1 [rad/s]; None is 3 omega / alpha, three times the formation's own.

    So nobody gains by racing; (1), which could ask for omega / alpha + 2 K, recovers from Fig. 6 at 2.7 omega / alpha.
    """
    wheelbase: float = number(0.175, 1e-6, 1e3, "m")
    """l, distance between the axles [m]."""
    steering_max: float = number(math.pi / 9, 1e-3, 1.57, "rad")
    """Largest steering angle to either side [rad]."""
    throttle_min: float = number(0.1, 0, 1e3)
    """tau at action -1."""
    throttle_max: float | None = number(None, 1e-6, 1e3)
    """tau at action 1; None is the throttle that reaches `speed_max`, or 0.25 where that is None too."""
    speed_max: float | None = number(None, 1e-3, 1e4, "m/s")
    """Top speed, the steady speed of a car at full throttle [m/s]; None is (drive throttle_max - offset) / drag.

    Give this or `throttle_max`, not both: (drag speed_max + offset) / drive is the throttle that reaches it.
    """
    drag: float = number(0.945, 1e-3, 1e3, "1/s")
    """c, damping of the speed [1/s].

    Differs from the paper: it prints 0.94, the authors' program has one digit more.
    """
    drive: float = number(36.81, 1e-6, 1e6, "m/s^2")
    """alpha of the motor, acceleration per throttle [m/s^2]; no relation to alpha of Lemma 2.

    Differs from the paper: it prints 36.8, the authors' program has one digit more.
    """
    offset: float = number(3.681, 0, 1e6, "m/s^2")
    """beta, deceleration of the motor [m/s^2].

    Differs from the paper: it prints 0.94, with which the slowest car does 2.9 m/s and cannot follow the curve.
    """
    dead_zone: float = number(0.1, 0, 1e3)
    """Throttle up to which the motor does not drive and the car coasts."""
    model_offset: float | None = number(None, 0, 1e6, "m/s^2")
    """beta as the designer of a controller measured it [m/s^2]; None is `offset`."""
    lateral_acceleration_max: float = number(math.inf, 1e-6, 1e6, "m/s^2", or_infinite=True)
    """Grip: the yaw rate is limited to this over the speed [m/s^2]."""

    def _check_together(self) -> None:
        if self.speed_max is None:
            self._require(self.full_throttle > self.throttle_min, "throttle_max", "must be above throttle_min")
            rule = "must lead to a top speed, (drive throttle_max - offset) / drag, from 0.001 to 10000 m/s"
            self._require(1e-3 <= self.top_speed <= 1e4, "throttle_max", rule)
            return
        if self.throttle_max is None:
            least = max(self.throttle_min, self.dead_zone)
            rule = "must be reached at a throttle above throttle_min and dead_zone"
            rule = f"{rule}, {least:g}, not at {self.full_throttle:.4g} [m/s]"
            self._require(self.full_throttle > least, "speed_max", rule)
            return
        reached = (self.drive * self.throttle_max - self.offset) / self.drag
        fits = math.isclose(self.drive * self.throttle_max, self.drag * self.speed_max + self.offset, rel_tol=1e-9)
        rule = f"must be the {reached:.6g} m/s of throttle_max = {self.throttle_max:g}, or one of the two be None [m/s]"
        self._require(fits, "speed_max", rule)

    @property
    def full_throttle(self) -> float:
        """tau at action 1: `throttle_max`, or (drag speed_max + offset) / drive where only `speed_max` is given."""
        if self.throttle_max is not None:
            return self.throttle_max
        return FULL_THROTTLE if self.speed_max is None else (self.drag * self.speed_max + self.offset) / self.drive

    @property
    def top_speed(self) -> float:
        """Steady speed of a car at full throttle: `speed_max`, or (drive throttle_max - offset) / drag [m/s]."""
        if self.speed_max is not None:
            return self.speed_max
        return (self.drive * self.full_throttle - self.offset) / self.drag


@dataclass(frozen=True)
class Sensing(Checked):
    """What a robot senses around itself: an omnidirectional disc on the ground."""

    radius: float | None = number(None, 1e-6, 1e5, "m")
    """r_s, within which targets, cells and other robots are sensed [m]; None is the smallest by (8)."""
    targets_seen: int = whole(4, 0, 32)
    """How many targets in the disc, nearest first, an observation lists."""
    robots_seen: int = whole(2, 0, 32)
    """How many robots in the disc, nearest first, an observation lists."""


@dataclass(frozen=True)
class Targets(Checked):
    """Rogue targets: how many, when and where they appear, how they move. What is not said to move stands still."""

    count: int = whole(20, 0, MOST_TARGETS)
    """Targets present from the start."""
    arrival_rate: float = number(0.0, 1e-9, 1e6, "1/s", or_zero=True)
    """Rate of the Poisson process by which further targets appear [1/s]."""
    entry: str = choice("inside", "inside", "boundary", "unseen")
    """Where a target appears: anywhere in the rectangle, on its boundary, or anywhere that no working robot senses at
    that moment. Where 64 places drawn at random are all sensed, as where discs cover the rectangle, it takes the last
    one: it is then seen at once, as inside."""
    drifting: float = number(0.0, 0, 1)
    """Share of targets that go straight on and bounce off the boundary."""
    wandering: float = number(1.0, 0, 1)
    """Share of targets whose heading walks at random."""
    fleeing: float = number(0.0, 0, 1)
    """Share of targets that run from the nearest robot in `flee_radius` and otherwise wander."""
    custom: float = number(0.0, 0, 1)
    """Share of targets that move as the scenario's own motion says."""
    speed: float = number(0.2, 0, 1e4, "m/s")
    """Speed of drifting and wandering targets [m/s]."""
    turn_rate: float = number(1.0, 0, 1e3, "rad/sqrt(s)")
    """Standard deviation of a wandering target's change of heading in one second [rad/sqrt(s)]."""
    flee_radius: float = number(0.9, 1e-6, 1e5, "m")
    """Distance to a robot below which a fleeing target runs [m]."""
    flee_speed: float = number(0.6, 0, 1e4, "m/s")
    """Speed of a running target [m/s]; the boundary can make it slower."""
    speed_limit: float | None = number(None, 0, 1e4, "m/s")
    """Speed that no rogue is above, seen or unseen, for the guaranteed detection time [m/s]; None is the highest that
    these targets move at, and has to be given where they move as the scenario's own motion says."""
    leave: bool = flag(True)
    """Whether a target leaves once it was detected."""

    def _check_together(self) -> None:
        total = self.drifting + self.wandering + self.fleeing + self.custom
        self._require(total < 1 + 1e-9, "fleeing", "must leave drifting + wandering + fleeing + custom at 1 or below")
        rule = f"must be None or at least what these targets move at, {self.speed_max:g} m/s"
        self._require(self.speed_limit is None or self.speed_limit >= self.speed_max, "speed_limit", rule)

    @property
    def speed_max(self) -> float:
        """Highest speed at which they drift, wander and flee [m/s]."""
        roaming = self.drifting + self.wandering + self.fleeing > 0
        return max(self.speed if roaming else 0.0, self.flee_speed if self.fleeing > 0 else 0.0)


@dataclass(frozen=True)
class Faults(Checked):
    """Robots that fail. A stuck robot stops, senses nothing and still sends its phase; a removed one is gone."""

    schedule: tuple[tuple[int, float, float], ...] = rows(
        (),
        "must hold rows of a robot, a start from 0 to 1000000000 and a later end, or an infinite one [s]",
        _as_fault,
        units=("", "s", "s"),
    )
    """Robots stuck for a time, each as (robot, start [s], end [s]); an infinite end lasts for good."""
    removed: tuple[tuple[int, float], ...] = rows(
        (), "must hold pairs of a robot and a time from 0 to 1000000000 [s]", _as_removal, units=("", "s")
    )
    """Robots removed for good, each as (robot, time [s])."""
    rate: float = number(0.0, 0, 1e3, "1/s")
    """Rate at which each working robot gets stuck at random [1/s]."""
    mean_duration: float = number(5.0, 1e-3, 1e6, "s")
    """Mean of the exponential time that a random fault lasts [s]."""
    lost: int = whole(0, 0, 1024)
    """Robots, chosen at random, that are removed at a random time in the middle half of the episode."""


@dataclass(frozen=True)
class Noise(Checked):
    """Disturbances. Standard deviations are of independent normal draws in each step, spreads of one in an episode."""

    actuator: float = number(0.0, 0, 100)
    """Standard deviation added to each component of the action, in units of the action's range [-1, 1]."""
    position: float = number(0.0, 0, 1e4, "m")
    """Standard deviation of a measured coordinate [m]."""
    heading: float = number(0.0, 0, 100, "rad")
    """Standard deviation of a measured heading [rad]."""
    speed: float = number(0.0, 0, 1e4, "m/s")
    """Standard deviation of a measured speed [m/s]."""
    wheelbase_spread: float = number(0.0, 0, 0.3)
    """Relative standard deviation of the wheelbase between robots."""
    drive_spread: float = number(0.0, 0, 0.3)
    """Relative standard deviation of the motor's drive between robots."""
    message_loss: float = number(0.0, 0, 1)
    """Probability that a message to a ring neighbour is lost."""
    message_delay: float = number(0.0, 0, 1e5, "s")
    """Time that a message is on its way, rounded to whole steps [s]."""


@dataclass(frozen=True)
class Task(Checked):
    """Time, grid, what a collision and the edge of the rectangle do, and the weights of the reward."""

    duration: float = number(60.0, 1e-3, 1e8, "s")
    """Time after which an episode is truncated [s]."""
    step: float = number(0.1, 1e-4, 100, "s")
    """Control step [s]."""
    substeps: int = whole(2, 1, 64)
    """Integration steps in a control step."""
    grid: tuple[int, int] | None = rows(
        (36, 16),
        "must be (columns, rows), each from 1 to 4096, or None",
        _as_lines,
        optional=True,
    )
    """Columns and rows of the coverage grid; None leaves coverage and idleness out."""
    contamination: tuple[int, int] | None = rows(
        None,
        "must be (columns, rows), each from 1 to 4096, or None",
        _as_lines,
        optional=True,
    )
    """Columns and rows of the grid on which is followed where a rogue may be that was never seen, for the guaranteed
    detection time; None leaves it out. Places are known to about half a cell: halve the cells to halve the error."""
    conservative: bool = flag(False)
    """Whether that error is on the safe side: a rogue may be anywhere in its cell and go any way at the speed limit,
    and a sensor clears a cell only where it covers all of it at the end of a step. No rogue is unseen for longer than
    the figure; `lissajous_env.world.contamination.conservative` has the proof. Smaller cells bring it closer to the
    plain figure."""
    on_collision: str = choice("count", "count", "stop", "remove")
    """What a collision does to the two robots: nothing but count, stops them for good, or removes (terminates) them."""
    boundary: str = choice("open", "open", "wall", "remove")
    """What the edge of the rectangle does to cars: nothing; a wall stops their centres there, and takes the part of
    their velocity that goes into it; or they are removed (terminated) once their whole body is outside."""
    reward_detection: float = number(1.0, -1e6, 1e6)
    """Reward of a robot for each target that it is the first to detect."""
    reward_waiting: float = number(-0.05, -1e6, 1e6, "1/s")
    """Reward of every robot per second and undetected target present: the time of detection, as it passes."""
    reward_collision: float = number(-1.0, -1e6, 1e6)
    """Reward of a robot for each collision that it is in."""
    reward_idleness: float = number(0.0, -1e6, 1e6, "1/s")
    """Reward of every robot per second of idleness that it ends, averaged over the cells of the grid."""
    reward_effort: float = number(0.0, -1e6, 1e6)
    """Reward of a robot per step and mean square of its action."""
    reward_formation: float = number(0.0, -1e6, 1e6, "1/s")
    """Reward of every robot per second and radian of phase error: the largest deviation from the equilibrium (2)."""
    reward_outside: float = number(0.0, -1e6, 1e6, "1/s")
    """Reward of a robot per second that its whole body is outside the rectangle."""
    reward_contamination: float = number(0.0, -1e6, 1e6, "1/s")
    """Reward of every robot per second by which the mean age of contamination becomes less."""

    def _check_together(self) -> None:
        self._require(self.duration >= self.step, "duration", f"must be at least one step of {self.step} s")
        self._require(self.grid is None or len(self.grid) == 2, "grid", "must be (columns, rows) or None")
        fits = self.contamination is None or len(self.contamination) == 2
        self._require(fits, "contamination", "must be (columns, rows) or None")
        self._require(self.duration <= self.step * 2**20, "duration", f"must be at most {2**20} steps")

    @property
    def steps(self) -> int:
        """Control steps in an episode."""
        return round(self.duration / self.step)
