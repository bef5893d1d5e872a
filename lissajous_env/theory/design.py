"""Designs for a rectangle: a curve, a number of robots and a speed, checked against (6) to (8) and the robots."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lissajous_env.device.locks import with_own_locks
from lissajous_env.settings.checks import is_finite, whole_number
from lissajous_env.settings.parts import Curve
from lissajous_env.theory import closed_forms, geometry
from lissajous_env.wording import shown

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
    """The curve (3), and with it the rectangle and its inset."""
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
    """Bound (7), which the sensing radius must exceed [m]: that of the driven curve and sqrt(2) times the inset."""
    detection_radius: float
    """Bound (8), the least sensing radius [m], likewise."""
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
        return geometry.curve_length(self.curve.driven) / self.lap_time

    @property
    def turning_radius(self) -> float | None:
        """Radius of the tightest circle of the cars [m]; None for robots that turn on the spot."""
        return None if self.wheelbase is None else geometry.turning_radius(self.wheelbase, self.steering_max)

    @cached_property
    def tight_share(self) -> float | None:
        """Share of the arc that turns tighter than the cars can; None for robots that turn on the spot."""
        return None if self.turning_radius is None else geometry.tight_share(self.curve.driven, self.turning_radius)

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


HEADROOM = 0.1
"""Part of the top speed and of the grip that is reserved for robots that have to catch up."""
_MOST_ROBOTS = 200
_MOST_MEASURED = 200
"""Limit on the infeasible designs that are measured, those with the best margin first."""
_RANGE = 1e-6, 1e6
"""Range of valid lengths [m]."""


def design(
    half_width: float,
    half_height: float,
    robot_radius: float,
    sensor_radius: float,
    speed_max: float,
    num_robots: int | None = None,
    phase_rate: float | None = None,
    wheelbase: float | None = None,
    steering_max: float = math.pi / 9,
    lateral_acceleration_max: float = math.inf,
    headroom: float = HEADROOM,
    inset: float = 0.0,
) -> list[Candidate]:
    """List every design for a rectangle [-A, A] x [-B, B]: all N, a odd, b with a + b = N and gcd(a, b) = 1.

    The phase rate omega of a design is the largest at which its robots can drive the curve, less the headroom:
    (1 - headroom) min(v / max ||r'||, sqrt(grip / max(||r'||^2 / radius))).

    Args:
        half_width: A [m].
        half_height: B [m].
        robot_radius: r_i, radius of a robot's body [m].
        sensor_radius: r_s, radius of a robot's sensing disc [m].
        speed_max: v, top speed of the robots [m/s].
        num_robots: N; None tries all numbers from 2 to the largest useful one, at most 200.
        phase_rate: omega, rate of the robots along the curve's parameter [rad/s]; None selects the largest, as above.
        wheelbase: distance between a car's axles [m]; None for robots that turn on the spot.
        steering_max: largest steering angle of a car [rad].
        lateral_acceleration_max: grip of a car [m/s^2].
        headroom: part of the top speed and of the grip that is reserved for robots that have to catch up.
        inset: width of the strip along the edge in which nothing is driven [m].

    Returns:
        The feasible designs by T_max and margin, then the infeasible ones by margin.

    Raises:
        ValueError: an invalid value.
    """
    _require_positive(half_width=half_width, half_height=half_height, robot_radius=robot_radius)
    _require_positive(sensor_radius=sensor_radius)
    _require_positive("m/s", speed_max=speed_max)
    if phase_rate is not None:
        _require_positive("rad/s", phase_rate=phase_rate)
    if wheelbase is not None:
        _require_positive(wheelbase=wheelbase)
    if lateral_acceleration_max != math.inf:
        _require_positive("m/s^2", lateral_acceleration_max=lateral_acceleration_max)
    if not is_finite(steering_max) or not 0 < steering_max < math.pi / 2:
        raise ValueError(f"steering_max must be between 0 and pi / 2, both excluded [rad], got {shown(steering_max)}")
    if not is_finite(headroom) or not 0 <= headroom < 1:
        raise ValueError(f"headroom must be at least 0 and below 1, got {shown(headroom)}")
    if num_robots is not None:
        whole_number("num_robots", num_robots, 2, 1024)

    turning_radius = 0.0 if wheelbase is None else geometry.turning_radius(wheelbase, steering_max)
    largest = _largest_num_robots(half_width, half_height, robot_radius, sensor_radius)
    candidates = []
    for n in range(2, largest + 1) if num_robots is None else [num_robots]:
        for a in range(1, n, 2):
            if math.gcd(a, n) > 1:
                continue
            whole = Curve(half_width, half_height, a, n - a, inset=inset or None)
            curve, corner = whole.driven, math.sqrt(2) * inset
            p, alpha = best_formation(curve, n)
            kappa = closed_forms.cluster_size(n, p, alpha)
            fastest = geometry.largest_speed(curve)
            rate = phase_rate or (1 - headroom) * speed_max / fastest
            if phase_rate is None and lateral_acceleration_max < math.inf:
                grip = lateral_acceleration_max / geometry.needed_acceleration(curve, turning_radius)
                rate = min(rate, (1 - headroom) * math.sqrt(grip))
            candidates.append(
                Candidate(
                    curve=whole,
                    num_robots=n,
                    phase_rate=rate,
                    robot_radius=robot_radius,
                    sensor_radius=sensor_radius,
                    speed_max=speed_max,
                    wheelbase=wheelbase,
                    steering_max=steering_max,
                    lateral_acceleration_max=lateral_acceleration_max,
                    p=p,
                    alpha=alpha,
                    clusters=kappa,
                    robot_radius_bound=closed_forms.robot_radius_bound(curve, n) if kappa == 1 else 0.0,
                    coverage_radius=closed_forms.coverage_radius(curve) + corner,
                    detection_radius=closed_forms.detection_radius(curve, n, kappa) + corner,
                    detection_time_bound=closed_forms.detection_time_bound(rate, n, kappa),
                    top_speed=rate * fastest,
                )
            )
    return sorted(candidates, key=_rank)


def what_fails(candidates: list[Candidate]) -> str:
    """Return a phrase with the conditions that no design meets."""
    rules = [
        ("(6), robots must not collide,", [each.avoids_collisions for each in candidates]),
        ("(7), a lap must leave no gap,", [each.covers for each in candidates]),
        ("(8), sensing discs must overlap,", [each.detects for each in candidates]),
        ("the top speed", [each.is_fast_enough for each in candidates]),
        ("the turning circle", [each.can_follow for each in candidates[:_MOST_MEASURED]]),
    ]
    for_all = [name for name, met in rules if not any(met)]
    if for_all:
        return f"{' and '.join(for_all)} fail{'s' if len(for_all) == 1 else ''} for every one"
    return "each condition can be met, but not all by one design"


def what_would_help(candidates: list[Candidate]) -> str:
    """Return a sentence with the required speed, turning circle, sensors and number of robots."""
    any_one = candidates[0]
    words = []
    if not any(each.is_fast_enough for each in candidates):
        slowest = min(candidates, key=lambda each: each.top_speed)
        words.append(f"at this phase rate robots must reach {slowest.top_speed:.4g} m/s ({in_words(slowest)})")
    followed = candidates[:_MOST_MEASURED]
    if not any(each.can_follow for each in followed):
        gentle = min(followed, key=lambda each: each.tight_share or 0.0)
        share = f"{gentle.tight_share:.1%} of the arc is tighter than the cars' {gentle.turning_radius:.3g} m"
        words.append(f"cars must turn tighter: on the gentlest curve {share} ({in_words(gentle)})")
    clear = [each for each in candidates if each.avoids_collisions]
    if clear:
        best = min(clear, key=lambda each: max(each.coverage_radius, each.detection_radius))
        needed = max(best.coverage_radius, best.detection_radius)
        if needed > best.sensor_radius:
            words.append(f"with these bodies sensors must reach above {needed:.4g} m ({in_words(best)})")
    elif (best := max(candidates, key=lambda each: each.robot_radius_bound)).clusters > 1:
        words.append(f"{best.num_robots} robots always share places, another number of robots does not")
    else:
        words.append(f"bodies must be below {best.robot_radius_bound:.4g} m for any ({in_words(best)})")
    curve = any_one.curve
    robots, a, b = closed_forms.fewest_robots(curve.half_width, curve.half_height, any_one.sensor_radius)
    body = closed_forms.robot_radius_limit(curve.half_width, curve.half_height, robots)
    fewest = f"with these sensors it takes at least {robots} robots (a of {a}, b of {b} or more by (7))"
    words = f"{'; '.join([*words, fewest])}, whose bodies must be below {body:.4g} m."
    return words[0].upper() + words[1:]


def in_words(each: Candidate) -> str:
    """Return a phrase with the robots and the curve of a design."""
    return f"{each.num_robots} robots on a = {each.curve.a}, b = {each.curve.b}"


def _largest_num_robots(half_width: float, half_height: float, robot_radius: float, sensor_radius: float) -> int:
    """Return the largest useful number of robots, limited by their bodies and required by their sensors."""
    needed = closed_forms.fewest_robots(half_width, half_height, sensor_radius)[0]
    roomy = (
        n
        for n in range(_MOST_ROBOTS, 2, -1)
        if closed_forms.robot_radius_limit(half_width, half_height, n) > robot_radius
    )
    return min(max(needed, next(roomy, 2)), _MOST_ROBOTS)


def _rank(each: Candidate) -> tuple:
    return (0, each.detection_time_bound, -each.margin) if each.feasible else (1, -each.margin, each.num_robots)


def _require_positive(unit: str = "m", **values: float) -> None:
    for name, value in values.items():
        if not is_finite(value) or value <= 0:
            raise ValueError(f"{name} must be positive [{unit}], got {shown(value)}")
        if not _RANGE[0] <= value <= _RANGE[1]:
            raise ValueError(f"{name} must be from {_RANGE[0]:g} to {_RANGE[1]:g} [{unit}], got {shown(value)}")
