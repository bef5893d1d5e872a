"""The parts of a scenario: frozen dataclasses that declare the meaning, unit and range of each field.

Sensing, messages, targets and the task are in `task.py`.

Units are SI, angles radians. The ranges are wide: they ensure that kernels stay within the range of float32, and reject
typing errors that would exhaust the memory. A field that is None by default is derived from others.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from lissajous_env.settings.checks import (
    Checked,
    as_robot,
    choice,
    number,
    row_of,
    rows,
    whole,
    whole_number,
    within,
    word,
)

SPREAD_MAX = 3.0
"""Standard deviations at which the spread of a car's constants is clipped."""
POINT_RATE_FACTOR = 3.0
"""Default phase rate of a point at action 1, as a multiple of that of the formation."""
FULL_THROTTLE = 0.25
"""Throttle of a car at action 1 where neither `robot.throttle_max` nor `robot.speed_max` is given, as in the paper."""

_as_time = within(0, 1e9)
"""Function that reads a time of a schedule [s]."""


def _as_fault(entry: Any) -> tuple | None:
    fault = row_of(as_robot, _as_time, within(0, 1e9, math.inf))(entry)
    return fault if fault is not None and fault[1] < fault[2] else None


@dataclass(frozen=True)
class Curve(Checked):
    """The Lissajous curve (3), or (10) where `half_depth` is above 0, and with it the rectangle [-A, A] x [-B, B]."""

    half_width: float = number(1.8, 1e-3, 1e4, "m")
    """Half of the rectangle's width, A [m]."""
    half_height: float = number(0.8, 1e-3, 1e4, "m")
    """Half of the rectangle's height, B [m]."""
    a: int = whole(3, 1, 1023, "odd")
    """Oscillations along x in one lap, a; odd."""
    b: int = whole(2, 1, 1023)
    """Oscillations along y in one lap, b; shares no factor with a."""
    half_depth: float = number(0.0, 0, 1e4, "m")
    """Half of the curve's extent along z, C of (10) [m]; 0 makes a plane curve."""
    c: int = whole(1, 1, 1023)
    """Oscillations along z in one lap, c of (10)."""
    harmonics: tuple[tuple[float, float, float, float], ...] = rows(
        (),
        "must contain at most 64 rows of four numbers from -10000 to 10000 [m]",
        row_of(*[within(-1e4, 1e4)] * 4),
        units=("m",) * 4,
        most=64,
    )
    """Fourier coefficients of another closed curve in place of (3): row k contains the factors of cos(k gamma) and
    sin(k gamma) in x, then in y [m]. The curve must stay in the rectangle. A circle of radius R is ((R, 0, 0, R),)."""
    inset: float | None = number(None, 0, 1e4, "m")
    """Distance from the edge of the rectangle within which nothing is driven [m]: the curve is scaled to the rectangle
    without a strip of this width, and all other paths stay in it. None means 0, or with `task.boundary = wall` the
    distance that robots need from a wall, `Scenario.inset`."""

    @classmethod
    def through(cls, position: Callable[[np.ndarray], Any], harmonics: int = 64, **fields: Any) -> "Curve":
        """Return the closed curve of a function, as a Fourier series.

        Args:
            position: Smooth periodic function that returns x and y [m], each (K,), for gamma (K,) in [0, 2 pi) [rad].
            harmonics: Number of harmonics, from 1 to 64; higher ones are dropped.
            **fields: `half_width` and `half_height` of the rectangle [m].

        Raises:
            ValueError: the function returns another shape, numbers that are not finite or only zeros, or the series
                deviates from it by more than a thousandth of its size.
        """
        whole_number("harmonics", harmonics, 1, 64)
        gamma = np.arange(1024) * (2 * np.pi / 1024)
        places = np.asarray(position(gamma), dtype=float)
        if (infinite := np.sum(~np.isfinite(places))) or places.shape != (2, len(gamma)):
            got = f"shape {places.shape}, with {infinite} numbers that are not finite"
            raise ValueError(f"position must return finite x and y for each gamma, got {got}")
        spectrum = np.fft.rfft(places, axis=1)
        spectrum[:, 0] = spectrum[:, harmonics + 1 :] = 0.0
        off = np.abs(np.fft.irfft(spectrum, len(gamma), axis=1) - places).max()
        if off > 1e-3 * np.abs(places).max():
            rule = f"must be smooth and around the middle of the rectangle, for {harmonics} harmonics"
            raise ValueError(f"position {rule}, got a curve that these miss by {off:.3g} m")
        waves = spectrum[:, 1 : harmonics + 1] * (2 / len(gamma))
        table = np.stack([waves[0].real, -waves[0].imag, waves[1].real, -waves[1].imag], axis=1)
        significant = np.abs(table) > 1e-9 * np.abs(table).max()
        last = max(np.flatnonzero(significant.any(axis=1)), default=0)  # of a point in the middle, which is refused
        table = np.where(significant, table, 0.0)[: last + 1]
        return cls(harmonics=tuple(map(tuple, table.tolist())), **fields)

    @property
    def driven(self) -> "Curve":
        """The curve that is driven, as the curve of the rectangle without the inset."""
        if not self.inset:
            return self
        half_width, half_height = self.half_width - self.inset, self.half_height - self.inset
        x, y = half_width / self.half_width, half_height / self.half_height
        scaled = tuple((p * x, q * x, r * y, s * y) for p, q, r, s in self.harmonics)
        return dataclasses.replace(self, half_width=half_width, half_height=half_height, harmonics=scaled, inset=0.0)

    @property
    def oscillations(self) -> int:
        """Number of oscillations in one lap: a + b, or twice the number of harmonics."""
        return 2 * len(self.harmonics) or self.a + self.b

    def _check_together(self) -> None:
        if self.harmonics:
            self._require(any(any(row) for row in self.harmonics), "harmonics", "must contain a number that is not 0")
            self._require(self.half_depth == 0, "half_depth", "must be 0 with harmonics [m]")
            return
        # The paper does not require it, but without it the formation collides: (3, 6) has a smallest distance of 0.
        self._require(math.gcd(self.a, self.b) == 1, "b", f"must share no factor with a = {self.a}")


@dataclass(frozen=True)
class Formation(Checked):
    """Coordination of the robots along the curve: dynamics (1) and its equilibrium (2)."""

    phase_rate: float = number(0.3, 1e-9, 1e3, "rad/s")
    """Rate of the robots along the curve's parameter in the equilibrium, omega of (1) [rad/s]."""
    coupling: float | None = number(None, 0, 1e4, "1/s")
    """Gain of the sum in (1), K [1/s]; None means omega / (0.3 rad), which is the paper's 1/s in its experiment."""
    p: int | None = whole(None, 0, 1024)
    """p of the equilibrium (2); None selects the least clustered stable one."""
    alpha: int | None = whole(None, 1, 1024)
    """alpha of Lemma 2: gamma = alpha theta; None makes neighbours on the ring neighbours on the ellipse (5)."""
    ring: tuple[int, ...] | None = rows(None, "must list robots as whole numbers from 0", as_robot)
    """Order of the robots around the communication ring; None means 0, 1 ... N - 1."""
    start: str = choice("equilibrium", "equilibrium", "rotated", "random")
    """Phases at reset: the equilibrium (2) with theta_0 = 0, the same rotated by a random angle, or all random."""
    start_noise: float = number(0.0, 0, 100, "rad")
    """Standard deviation of a random displacement of each robot's phase at reset [rad]."""
    displaced: tuple[tuple[int, float], ...] = rows(
        (),
        "must contain pairs of a robot and an angle from -100 to 100 [rad]",
        row_of(as_robot, within(-100, 100)),
        units=("", "rad"),
    )
    """Robots displaced along the phase at reset, each as (robot, angle [rad])."""
    start_headway: float = number(0.0, 0, 1e3, "s")
    """Time within which no two robots that go straight on from the start collide [s]: the random displacement of a
    robot that would is drawn again, up to 99 times. With 0, none is, and bodies may overlap at the start."""


@dataclass(frozen=True)
class Robot(Checked):
    """The robots: points on the curve, cars, that is, kinematic bicycles (12) with a motor, or differential drives."""

    kind: str = word("car", "must be the name of a robot model")
    """`car`: action = steering, throttle. `differential`: action = speed, yaw rate. `curve`: a point on the curve with
    action = phase rate. Or a registered model."""
    count: int | None = whole(None, 1, 1024)
    """Number of robots, N; None means a + b."""
    radius: float = number(0.125, 1e-6, 1e3, "m")
    """Radius of a robot's body, r_i [m]: a disc, or a ball in three dimensions. Bodies that overlap collide."""
    phase_rate_max: float | None = number(None, 1e-12, 1e4, "rad/s")
    """Phase rate of a `curve` robot at action 1 [rad/s]; None means 3 omega / alpha, three times that of the formation.

    The limit prevents policies from gaining by speed alone. (1), which can request omega / alpha + 2 K, needs
    2.7 omega / alpha to recover in Fig. 6.
    """
    wheelbase: float = number(0.175, 1e-6, 1e3, "m")
    """Distance between the axles, l [m]."""
    steering_max: float = number(math.pi / 9, 1e-3, 1.57, "rad")
    """Largest steering angle to either side [rad]."""
    throttle_min: float = number(0.1, 0, 1e3)
    """Throttle tau at action -1."""
    throttle_max: float | None = number(None, 1e-6, 1e3)
    """Throttle tau at action 1; None means the throttle that reaches `speed_max`, or 0.25 if that is None too."""
    speed_max: float | None = number(None, 1e-3, 1e4, "m/s")
    """Top speed, the steady speed of a car at full throttle [m/s]; None means (drive throttle_max - offset) / drag.

    Give this or `throttle_max`, not both: (drag speed_max + offset) / drive is the throttle that reaches it.
    """
    speed_min: float | None = number(None, -1e4, 0, "m/s")
    """Steady speed of a car in full reverse, at throttle action -1 [m/s]; None means 0: as in the paper, cars do not
    reverse. If it is below 0, throttle actions from 0 to 1 drive forwards and those from 0 to -1 backwards. For a
    differential drive, the speed at action -1; None means its top speed in reverse."""
    yaw_rate_max: float | None = number(None, 1e-6, 1e10, "rad/s")
    """Yaw rate of a differential drive at action 1 [rad/s]; None means that of wheels at the edge of its body, which
    turn at the top speed: `speed_max` / `radius`."""
    acceleration_max: float | None = number(None, 1e-6, 1e7, "m/s^2")
    """Largest acceleration and deceleration of a differential drive [m/s^2]; None means drag `speed_max`, with which a
    car begins at full throttle."""
    yaw_acceleration_max: float | None = number(None, 1e-9, 1e14, "rad/s^2", or_infinite=True)
    """Largest change of the yaw rate of a differential drive per time [rad/s^2]; None means 2 `acceleration_max` /
    `radius`, that of a uniform disc whose wheels push at its edge as much as for `acceleration_max`. That of cars is
    infinite."""
    stands_for_drive: ClassVar[bool] = False
    """True for cars that stand for differential drives, with the `yaw_acceleration_max` of these."""
    drag: float = number(0.945, 1e-3, 1e3, "1/s")
    """Damping of the speed, c [1/s].

    Differs from the paper: it prints 0.94, the authors' program has one digit more.
    """
    drive: float = number(36.81, 1e-6, 1e6, "m/s^2")
    """Acceleration per throttle, alpha of the motor [m/s^2]; unrelated to alpha of Lemma 2.

    Differs from the paper: it prints 36.8, the authors' program has one digit more.
    """
    offset: float = number(3.681, 0, 1e6, "m/s^2")
    """Deceleration of the motor, beta [m/s^2].

    Differs from the paper: it prints 0.94, with which the slowest car does 2.9 m/s and cannot follow the curve.
    """
    dead_zone: float = number(0.1, 0, 1e3)
    """Throttle up to which the motor does not drive and the car coasts."""
    model_offset: float | None = number(None, 0, 1e6, "m/s^2")
    """beta as assumed by model-based controllers [m/s^2]; None means `offset`."""
    lateral_acceleration_max: float = number(math.inf, 1e-6, 1e6, "m/s^2", or_infinite=True)
    """Largest lateral acceleration (grip) [m/s^2]; the yaw rate is limited to it divided by the speed."""
    drive_factors: tuple[tuple[int, float], ...] = rows(
        (), "must contain pairs of a robot and a factor from 0.01 to 10", row_of(as_robot, within(0.01, 10))
    )
    """Cars with a weaker or stronger motor, each as (robot, factor on `drive`), or differential drives with another
    `acceleration_max`; model-based controllers ignore it."""

    def _check_together(self) -> None:
        least, full = max(self.throttle_min, self.dead_zone), self.full_throttle
        name, rule = "throttle_max", f"must be above throttle_min and dead_zone, {least:g}"
        if self.throttle_max is None and self.speed_max is not None:
            rule = f"must need a throttle above {least:g} (throttle_min, dead_zone), to 1000, not {full:.4g} [m/s]"
            name = "speed_max"
        self._require(least < full <= 1e3, name, rule)
        if self.speed_max is None:
            rule = "must lead to a top speed, (drive throttle_max - offset) / drag, from 0.001 to 10000 m/s"
            self._require(1e-3 <= self.top_speed <= 1e4, "throttle_max", rule)
        elif self.throttle_max is not None:
            reached = (self.drive * self.throttle_max - self.offset) / self.drag
            fits = math.isclose(self.drive * self.throttle_max, self.drag * self.speed_max + self.offset, rel_tol=1e-9)
            rule = f"must be {reached:.6g} m/s for throttle_max = {self.throttle_max:g}, or one of the two must be None"
            self._require(fits, "speed_max", rule)
        if self.reverses and self.kind == "car":
            rule = f"must be at most dead_zone, {self.dead_zone:g}, for cars that reverse (speed_min)"
            self._require(self.throttle_min <= self.dead_zone, "throttle_min", rule)
            reached = (self.offset - self.drag * self.lowest_speed) / self.drive
            rule = f"must be reached at a throttle above dead_zone, {self.dead_zone:g}, not at {reached:.4g} [m/s]"
            self._require(reached > self.dead_zone, "speed_min", rule)

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

    @property
    def idle_speed(self) -> float:
        """Steady speed of a car at the least throttle, below which it cannot drive for long [m/s]."""
        if self.throttle_min <= self.dead_zone:
            return 0.0
        return max((self.drive * self.throttle_min - self.offset) / self.drag, 0.0)

    @property
    def lowest_speed(self) -> float:
        """Steady speed in full reverse: `speed_min`, or by default 0 or the top speed of a differential drive [m/s]."""
        if self.speed_min is not None:
            return self.speed_min
        return -self.top_speed if self.kind == "differential" else 0.0

    @property
    def reverses(self) -> bool:
        """True if a robot can drive backwards."""
        return self.lowest_speed < 0

    @property
    def top_yaw_rate(self) -> float:
        """Largest yaw rate of a differential drive: `yaw_rate_max`, or by default top speed / radius [rad/s]."""
        return self.top_speed / self.radius if self.yaw_rate_max is None else self.yaw_rate_max

    @property
    def top_acceleration(self) -> float:
        """Largest acceleration of a differential drive: `acceleration_max`, or by default drag top speed [m/s^2]."""
        return self.drag * self.top_speed if self.acceleration_max is None else self.acceleration_max

    @property
    def top_yaw_acceleration(self) -> float:
        """Largest yaw acceleration [rad/s^2]: by default 2 acceleration / radius for differential drives, else none."""
        if self.yaw_acceleration_max is not None:
            return self.yaw_acceleration_max
        return 2 * self.top_acceleration / self.radius if self.kind == "differential" else math.inf

    @property
    def factors(self) -> dict[int, float]:
        """Factor on `drive` of each robot in `drive_factors`; several factors of a robot are multiplied."""
        factors: dict[int, float] = {}
        for robot, factor in self.drive_factors:
            factors[robot] = factors.get(robot, 1.0) * factor
        return factors

    def steady_speed(self, drive: float) -> float:
        """Return the steady speed at action 1 of a robot with its own drive [m/s].

        For a car it is (drive tau - offset) / drag at full throttle, or 0 if its motor is too weak. A differential
        drive controls its speed: with a stronger motor it only reaches the same speed sooner.
        """
        if self.kind == "differential":
            return self.top_speed
        return max((drive * self.full_throttle - self.offset) / self.drag, 0.0)


@dataclass(frozen=True)
class Faults(Checked):
    """Robots that fail.

    A failed robot stops (`stop`) and senses nothing, but sends its phase and repeats its last message; a removed one
    disappears.
    """

    schedule: tuple[tuple[int, float, float], ...] = rows(
        (),
        "must contain rows of a robot, a start from 0 to 1000000000 and a later end, or an infinite one [s]",
        _as_fault,
        units=("", "s", "s"),
    )
    """Robots that fail for a time, each as (robot, start [s], end [s]); with an infinite end, they never resume."""
    removed: tuple[tuple[int, float], ...] = rows(
        (),
        "must contain pairs of a robot and a time from 0 to 1000000000 [s]",
        row_of(as_robot, _as_time),
        units=("", "s"),
    )
    """Robots that are removed, each as (robot, time [s])."""
    rate: float = number(0.0, 0, 1e3, "1/s")
    """Rate at which each working robot fails at random [1/s]."""
    mean_duration: float = number(5.0, 1e-3, 1e6, "s")
    """Mean duration of a random fault, which is exponentially distributed [s]."""
    lost: int = whole(0, 0, 1024)
    """Number of random robots that are removed at a random time in the middle half of the episode."""
    stop: str = choice("dead", "dead", "coast")
    """Way in which a failed car stops: at once (`dead`), or coasting with its motor off and constant steering, until
    drag has stopped it (`coast`). Robots that collide stop at once, as points do."""


@dataclass(frozen=True)
class Noise(Checked):
    """Disturbances. Standard deviations apply to a normal draw in each step, spreads to one draw per episode."""

    actuator: float = number(0.0, 0, 100)
    """Standard deviation of the noise on each component of the action, in units of its range [-1, 1]."""
    position: float = number(0.0, 0, 1e4, "m")
    """Standard deviation of a measured coordinate [m]."""
    heading: float = number(0.0, 0, 100, "rad")
    """Standard deviation of a measured heading [rad]."""
    speed: float = number(0.0, 0, 1e4, "m/s")
    """Standard deviation of a measured speed [m/s]."""
    wheelbase_spread: float = number(0.0, 0, 0.3)
    """Relative standard deviation of the wheelbase between cars, and of the distance of the wheels of differential
    drives, which turn more slowly where it is larger."""
    drive_spread: float = number(0.0, 0, 0.3)
    """Relative standard deviation of the motor's drive between cars, and of the acceleration of differential drives."""
    message_loss: float = number(0.0, 0, 1)
    """Probability that a message to a ring neighbour is lost."""
    message_delay: float = number(0.0, 0, 1e5, "s")
    """Delay of a message, rounded to whole steps [s]."""

    @property
    def drive_range(self) -> tuple[float, float]:
        """Smallest and largest drive of a robot, as factors of the nominal one."""
        return 1 - SPREAD_MAX * self.drive_spread, 1 + SPREAD_MAX * self.drive_spread

    @property
    def wheelbase_range(self) -> tuple[float, float]:
        """Smallest and largest wheelbase of a car, or distance of the wheels of a drive, as factors."""
        return 1 - SPREAD_MAX * self.wheelbase_spread, 1 + SPREAD_MAX * self.wheelbase_spread
