"""The robots of a scenario, with the limits of their motion; the other parts of a scenario are in `parts.py`."""

import math
from dataclasses import dataclass

from lissajous_env.settings.checks import Checked, number, robot_and, rows, whole, word

FULL_THROTTLE = 0.25
"""Throttle of a car at action 1 where neither `robot.throttle_max` nor `robot.speed_max` is given, as in the paper."""


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
    yaw_acceleration_max: float | None = number(None, 1e-9, 1e13, "rad/s^2", or_infinite=True)
    """Largest change of the yaw rate of a differential drive per time [rad/s^2]; None means 2 `acceleration_max` /
    `radius`, that of a uniform disc whose wheels push at its edge as much as for `acceleration_max`; infinite for cars,
    unless they stand for such drives."""
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
        (), "must contain pairs of a robot and a factor from 0.01 to 10", robot_and(0.01, 10), units=("", "")
    )
    """Cars with a weaker or stronger motor, each as (robot, factor on `drive`), or differential drives with another
    `acceleration_max`; model-based controllers ignore it."""

    def _check_together(self) -> None:
        self._check_forwards()
        if self.reverses and self.kind == "car":
            rule = f"must be at most dead_zone, {self.dead_zone:g}, for cars that reverse (speed_min)"
            self._require(self.throttle_min <= self.dead_zone, "throttle_min", rule)
            reached = (self.offset - self.drag * self.lowest_speed) / self.drive
            rule = f"must be reached at a throttle above dead_zone, {self.dead_zone:g}, not at {reached:.4g} [m/s]"
            self._require(reached > self.dead_zone, "speed_min", rule)

    def _check_forwards(self) -> None:
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
        rule = (
            f"must be {reached:.6g} m/s for throttle_max = {self.throttle_max:g}, or one of the two must be None [m/s]"
        )
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

    @property
    def lowest_speed(self) -> float:
        """Steady speed in full reverse: `speed_min`, or by default 0 or the top speed of a differential drive [m/s]."""
        if self.speed_min is not None:
            return self.speed_min
        return -self.top_speed if self.kind == "differential" else 0.0

    @property
    def reverses(self) -> bool:
        """Return True if a robot can drive backwards."""
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

    def steady_speed(self, drive: float) -> float:
        """Return the steady speed at action 1 of a robot with its own drive [m/s].

        For a car it is (drive tau - offset) / drag at full throttle. A differential drive controls its speed: with a
        stronger motor it only reaches the same speed sooner.
        """
        if self.kind == "differential":
            return self.top_speed
        return (drive * self.full_throttle - self.offset) / self.drag
