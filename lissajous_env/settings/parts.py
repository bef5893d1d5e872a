"""The parts of a scenario: frozen dataclasses that declare the meaning, unit and range of each field.

Robots are in `robot.py`, sensing and targets in `targets.py`, and the task is in `task.py`.

Units are SI, angles radians. The ranges are wide: they ensure that kernels stay within the range of float32, and reject
typing errors that would exhaust the memory. A field that is None by default is derived from others.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lissajous_env.settings.checks import Checked, as_robot, choice, is_whole, number, odd, robot_and, rows, whole

SPRINT = 3.0
"""Default phase rate of a point at action 1, as a multiple of that of the formation."""
_LONGEST = 1e9
"""Limit on the times of a schedule [s]."""


def _as_place(entry: Any) -> int | None:
    return entry if is_whole(entry) and 0 <= entry < 1024 else None


def _as_fault(entry: Any) -> tuple[int, float, float] | None:
    robot, start, end = entry
    holds = 0 <= start < end and start <= _LONGEST and (end <= _LONGEST or end == math.inf)
    return (as_robot(robot), float(start), float(end)) if holds else None


def _as_harmonic(entry: Any) -> tuple[float, ...] | None:
    row = tuple(float(number) for number in entry)
    return row if len(row) == 4 and all(abs(number) <= 1e4 for number in row) else None


@dataclass(frozen=True)
class Curve(Checked):
    """The Lissajous curve (3), or (10) where `half_depth` is above 0, and with it the rectangle [-A, A] x [-B, B]."""

    half_width: float = number(1.8, 1e-3, 1e4, "m")
    """Half of the rectangle's width, A [m]."""
    half_height: float = number(0.8, 1e-3, 1e4, "m")
    """Half of the rectangle's height, B [m]."""
    a: int = odd(3, 1023)
    """Oscillations along x in one lap, a; odd."""
    b: int = whole(2, 1, 1023)
    """Oscillations along y in one lap, b; shares no factor with a."""
    half_depth: float = number(0.0, 0, 1e4, "m")
    """Half of the curve's extent along z, C of (10) [m]; 0 makes a plane curve."""
    c: int = whole(1, 1, 1023)
    """Oscillations along z in one lap, c of (10)."""
    harmonics: tuple[tuple[float, float, float, float], ...] = rows(
        (), "must contain at most 64 rows of four numbers from -10000 to 10000 [m]", _as_harmonic, units=("m",) * 4
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
            harmonics: Number of harmonics, at most 64; higher ones are dropped.
            **fields: `half_width` and `half_height` of the rectangle [m].

        Raises:
            ValueError: the function returns another shape or numbers that are not finite, or the series deviates from
                it by more than a thousandth of its size.
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
    def driven(self) -> "Curve":
        """The curve that is driven, as the curve of the rectangle without the inset."""
        if not self.inset:
            return self
        half_width, half_height = self.half_width - self.inset, self.half_height - self.inset
        x, y = half_width / self.half_width, half_height / self.half_height
        rows = tuple((p * x, q * x, r * y, s * y) for p, q, r, s in self.harmonics)
        return dataclasses.replace(self, half_width=half_width, half_height=half_height, harmonics=rows, inset=0.0)

    @property
    def oscillations(self) -> int:
        """Number of oscillations in one lap: a + b, or twice the number of harmonics."""
        return 2 * len(self.harmonics) or self.a + self.b

    def _check_together(self) -> None:
        half = min(self.half_width, self.half_height)
        self._require((self.inset or 0.0) < half, "inset", f"must be below {half:g}, half of the rectangle's side [m]")
        if self.harmonics:
            self._require(len(self.harmonics) <= 64, "harmonics", "must contain at most 64 rows")
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
    coupling: float | None = number(None, 0, 1e3, "1/s")
    """Gain of the sum in (1), K [1/s]; None means omega / (0.3 rad), which is the paper's 1/s in its experiment."""
    p: int | None = whole(None, 0, 1024)
    """p of the equilibrium (2); None selects the least clustered stable one."""
    alpha: int | None = whole(None, 1, 1024)
    """alpha of Lemma 2: gamma = alpha theta; None makes neighbours on the ring neighbours on the ellipse (5)."""
    ring: tuple[int, ...] | None = rows(None, "must list robots as whole numbers from 0", _as_place)
    """Order of the robots around the communication ring; None means 0, 1 ... N - 1."""
    start: str = choice("equilibrium", "equilibrium", "rotated", "random")
    """Phases at reset: the equilibrium (2) with theta_0 = 0, the same rotated by a random angle, or all random."""
    start_noise: float = number(0.0, 0, 100, "rad")
    """Standard deviation of a random displacement of each robot's phase at reset [rad]."""
    displaced: tuple[tuple[int, float], ...] = rows(
        (),
        "must contain pairs of a robot and an angle from -100 to 100 [rad]",
        robot_and(-100, 100),
        units=("", "rad"),
    )
    """Robots displaced along the phase at reset, each as (robot, angle [rad])."""
    start_headway: float = number(0.0, 0, 1e3, "s")
    """Time within which no two robots that go straight on from the start collide [s]: the random displacement of a
    robot that would is drawn again, up to 99 times. With 0, none is, and bodies may overlap at the start."""


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
        robot_and(0, _LONGEST),
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
    def most_drive(self) -> float:
        """Largest drive of a robot, as a factor; draws of a spread are clipped at three deviations."""
        return 1 + 3 * self.drive_spread


@dataclass(frozen=True)
class Messages(Checked):
    """Messages of a policy: numbers that a robot sends to its ring neighbours beside its phase and position."""

    size: int = whole(0, 0, 32)
    """Number of components that an action has besides those that move the robot. Both ring neighbours observe them,
    with the delay and loss of the phase message. They have no actuator noise, and do not count as effort."""
