"""One design: a curve and a formation for given bodies, sensors and speeds, and its feasibility."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lissajous_env.device.locks import with_own_locks
from lissajous_env.settings.parts import Curve
from lissajous_env.theory import closed_forms, geometry

MOST_TIGHT = 0.1
"""Largest feasible share of the arc that turns tighter than the cars can.

Cars cut these corners. On `experiment` without faults, five cars with the package's controller maintain their formation
up to a share of 0.09 (spacing below 1.25 of (8), no collision), and lose it from 0.10 on.
"""


@with_own_locks
@dataclass(frozen=True)
class Candidate:
    """One design: a curve with a + b = N, its formation, and what they require of bodies, sensors and speeds."""

    curve: Curve
    """The curve (3), and with it the rectangle."""
    num_robots: int
    """Number of robots, N = a + b."""
    phase_rate: float
    """Phase rate along the curve, omega [rad/s]."""
    robot_radius: float
    """Radius of a robot's body, r_i [m]."""
    sensor_radius: float
    """Sensing radius, r_s [m]."""
    speed_max: float
    """Top speed of the robots [m/s]."""
    wheelbase: float | None
    """Distance between the axles of the cars, l [m]; None for robots that turn on the spot."""
    steering_max: float
    """Largest steering angle of the cars [rad]."""
    lateral_acceleration_max: float
    """Grip of the cars [m/s^2]; may be infinite."""
    p: int
    """p of the stable equilibrium (2) that recovers fastest."""
    alpha: int
    """alpha of Lemma 2, which makes ring neighbours neighbours on the ellipse (5)."""
    clusters: int
    """Number of robots that share a place, kappa (Lemma 1): 1 except for N = 4 and 6."""
    robot_radius_bound: float
    """Bound r_max of (6) [m], below which the bodies must be; 0 if robots share a place."""
    coverage_radius: float
    """Bound (7), which the sensing radius must exceed [m]."""
    detection_radius: float
    """Bound (8), the least sensing radius [m]."""
    detection_time_bound: float
    """Detection-time bound T_max [s]."""
    top_speed: float
    """Speed on the fastest stretch of the curve, omega max ||r'|| [m/s]."""

    @property
    def avoids_collisions(self) -> bool:
        """True if the bodies satisfy (6)."""
        return self.robot_radius < self.robot_radius_bound

    @property
    def covers(self) -> bool:
        """True if the sensing radius satisfies (7)."""
        return self.sensor_radius > self.coverage_radius

    @property
    def detects(self) -> bool:
        """True if the sensing radius satisfies (8)."""
        return self.sensor_radius >= self.detection_radius

    @property
    def is_fast_enough(self) -> bool:
        """True if the robots reach the speed of the fastest stretch."""
        return self.top_speed <= self.speed_max * (1 + geometry.SLACK)

    @property
    def can_follow(self) -> bool:
        """True if at most `MOST_TIGHT` of the arc turns tighter than the robots can."""
        return self.tight_share is None or self.tight_share <= MOST_TIGHT

    @property
    def is_drivable(self) -> bool:
        """True if the robots are fast enough and turn tightly enough for the curve."""
        return self.is_fast_enough and self.can_follow

    @property
    def feasible(self) -> bool:
        """True if (6), (7) and (8) are satisfied and the robots can drive the curve."""
        return self.avoids_collisions and self.covers and self.detects and self.is_drivable

    @property
    def margin(self) -> float:
        """Relative margin of the tightest of (6), (7) and (8); negative if it is violated."""
        required = max(self.coverage_radius, self.detection_radius)
        return min(self.robot_radius_bound / self.robot_radius, self.sensor_radius / required) - 1

    @property
    def lap_time(self) -> float:
        """Time of one lap, 2 pi / omega [s]."""
        return 2 * math.pi / self.phase_rate

    @cached_property
    def mean_speed(self) -> float:
        """Mean speed along the curve [m/s]."""
        return geometry.curve_length(self.curve) / self.lap_time

    @property
    def turning_radius(self) -> float | None:
        """Radius of the tightest circle of the cars [m]; None for robots that turn on the spot."""
        return None if self.wheelbase is None else geometry.turning_radius(self.wheelbase, self.steering_max)

    @cached_property
    def tight_share(self) -> float | None:
        """Share of the arc that turns tighter than the cars can; None for robots that turn on the spot."""
        return None if self.turning_radius is None else geometry.tight_share(self.curve, self.turning_radius)

    @property
    def overrides(self) -> dict[str, Any]:
        """Overrides that turn a scenario into this design, without faults."""
        car = {
            "robot.speed_max": self.speed_max,
            "robot.wheelbase": self.wheelbase,
            "robot.steering_max": self.steering_max,
            "robot.lateral_acceleration_max": self.lateral_acceleration_max,
        }
        # A point is as fast at action 1 as the robots are where the curve is fastest.
        point = {"robot.phase_rate_max": self.phase_rate / self.alpha * self.speed_max / self.top_speed}
        return {
            "curve.half_width": self.curve.half_width,
            "curve.half_height": self.curve.half_height,
            "curve.a": self.curve.a,
            "curve.b": self.curve.b,
            "formation.phase_rate": self.phase_rate,
            "formation.coupling": None if self.alpha == 1 else self.phase_rate / (0.3 * self.alpha),
            "formation.p": self.p,
            "formation.alpha": self.alpha,
            "formation.ring": None,
            "formation.displaced": (),
            "robot.kind": "curve" if self.wheelbase is None else "car",
            "robot.count": None,
            **(point if self.wheelbase is None else car),
            "robot.radius": self.robot_radius,
            "sensing.radius": self.sensor_radius,
            "faults.schedule": (),
            "faults.removed": (),
            "faults.rate": 0.0,
            "faults.lost": 0,
        }


def best_formation(curve: Curve, num_robots: int) -> tuple[int, int]:
    """Return p and alpha of the stable equilibrium (2) that recovers fastest, its ring neighbours adjacent on (5).

    At a coupling that is proportional to omega / alpha, deviations along the curve vanish at a rate proportional to
    -cos(2 pi p / N) / alpha; alpha a p = 1 (mod N) by Lemma 2. If no p gives each robot a place of its own, return
    the default of a scenario.
    """
    best, rate = None, 0.0
    for alpha in range(1, num_robots):
        if rate >= 1 / alpha:
            break
        if math.gcd(alpha * curve.a, num_robots) > 1:
            continue
        p = pow(alpha * curve.a, -1, num_robots)
        found = -math.cos(2 * math.pi * p / num_robots) / alpha
        if found > rate and num_robots < 4 * p < 3 * num_robots:
            best, rate = (p, alpha), found
    if best is None:
        p = closed_forms.default_p(num_robots)
        return p, closed_forms.default_alpha(curve, num_robots, p)
    return best
