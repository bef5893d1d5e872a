"""The paper's formation for a rectangle and a team: the curve with a + b = N that meets (6), (7) and (8) best."""

import math
from dataclasses import dataclass
from typing import Any

from lissajous_env.settings.parts import Curve, Robot
from lissajous_env.theory import closed_forms, geometry

HEADROOM = 0.1
"""Part of the top speed and of the grip that is reserved for robots that have to catch up."""
MOST_TIGHT = 0.1
"""Largest feasible share of the arc that turns tighter than the cars can.

Cars cut these corners. On `experiment` without faults, five cars with the package's controller maintain their formation
up to a share of 0.09 (spacing below 1.25 of (8), no collision), and lose it from 0.10 on.
"""


@dataclass(frozen=True)
class Design:
    """A curve with a + b = N, the formation on it, and what they require of bodies, sensors and cars."""

    curve: Curve
    """The curve (3), and with it the rectangle and its inset."""
    phase_rate: float
    """Phase rate along the curve, omega [rad/s]."""
    robot_radius_bound: float
    """Bound r_max of (6) [m], below which the bodies must be; 0 if robots share places in each stable equilibrium."""
    sensor_radius_bound: float
    """Least sensing radius by (7) and (8) [m]: those of the driven curve, and sqrt(2) times the inset."""
    tight_share: float
    """Share of the arc that turns tighter than the robots can."""

    def violations(self, robot_radius: float, sensor_radius: float) -> list[str]:
        """Return the conditions that robots of these radii [m] violate on the curve, each with its numbers."""
        rules = []
        if robot_radius >= self.robot_radius_bound:
            rules.append(f"bodies of {robot_radius:.4g} m must be below {self.robot_radius_bound:.4g} m by (6)")
        if sensor_radius < self.sensor_radius_bound:
            rules.append(f"sensors of {sensor_radius:.4g} m must reach {self.sensor_radius_bound:.4g} m by (7) and (8)")
        if self.tight_share > MOST_TIGHT:
            rules.append(f"{self.tight_share:.1%} of the arc is tighter than the cars turn, {MOST_TIGHT:.0%} may be")
        return rules

    @property
    def overrides(self) -> dict[str, Any]:
        """Fields of curve and formation that turn a scenario into this design."""
        halves = {"curve.half_width": self.curve.half_width, "curve.half_height": self.curve.half_height}
        p, alpha = best_formation(self.curve, self.curve.a + self.curve.b)
        return halves | formation_fields(self.curve, self.phase_rate, p, alpha)


def formation_fields(curve: Curve, phase_rate: float, p: int, alpha: int) -> dict[str, Any]:
    """Return the fields that put robots in equilibrium on a Lissajous curve of their rectangle, at a rate [rad/s]."""
    return {
        "curve.a": curve.a,
        "curve.b": curve.b,
        "curve.harmonics": (),
        "curve.half_depth": 0.0,
        "formation.phase_rate": phase_rate,
        "formation.coupling": phase_rate / (0.3 * alpha),
        "formation.p": p,
        "formation.alpha": alpha,
        "formation.ring": None,
        "formation.displaced": (),
    }


def best_formation(curve: Curve, num_robots: int) -> tuple[int, int]:
    """Return p and alpha of the stable equilibrium (2) that recovers fastest, its ring neighbours adjacent on (5).

    At a coupling that is proportional to omega / alpha, deviations along the curve vanish at a rate proportional to
    -cos(2 pi p / N) / alpha; alpha a p = 1 (mod N) by Lemma 2. If N shares a factor with a, which is not so for
    N = a + b, there is no such alpha, and the default p is returned with alpha = 1. Four and six robots share
    places in each stable equilibrium (Lemma 1): for them, return p = alpha = 1, equally spaced.
    """
    stable, rates = closed_forms.stable_equilibria(num_robots), {}
    for alpha in range(1, num_robots):
        p = closed_forms.alpha_for(num_robots, alpha * curve.a, 1)
        if p in stable:
            rates[p, alpha] = -math.cos(2 * math.pi * p / num_robots) / alpha
    has_places = closed_forms.has_unclustered_equilibrium(num_robots)
    return max(rates, key=rates.__getitem__, default=(closed_forms.default_p(num_robots) if has_places else 1, 1))


def largest_phase_rate(curve: Curve, speed: float, turning_radius: float = 0.0, grip: float = math.inf) -> float:
    """Return the largest omega at which robots can drive the plane curve, less the headroom [rad/s].

    (1 - HEADROOM) min(v / max ||r'||, sqrt(grip / max(||r'||^2 / radius))), where cars cut the bends that are tighter
    than they turn.

    Args:
        curve: The curve, as it is driven.
        speed: Top speed of the robots [m/s].
        turning_radius: Radius of the tightest circle of the robots [m]; 0 if they turn on the spot.
        grip: Largest lateral acceleration [m/s^2].
    """
    rate = (1 - HEADROOM) * speed / geometry.largest_speed(curve)
    return min(rate, (1 - HEADROOM) * math.sqrt(grip / geometry.needed_acceleration(curve, turning_radius)))


def best_design(
    half_width: float,
    half_height: float,
    num_robots: int,
    robot: Robot,
    sensor_radius: float,
    speed: float,
    turning_radius: float = 0.0,
    inset: float = 0.0,
) -> Design:
    """Return the design that meets the bounds: the one with the least T_max, else the one with the best margin.

    Args:
        half_width: A, half of the width of the rectangle [m].
        half_height: B, half of its height [m].
        num_robots: N, at least 2.
        robot: The robots, of which the body and the grip count.
        sensor_radius: r_s, radius of a robot's sensing disc [m].
        speed: Top speed of the robots [m/s].
        turning_radius: Radius of the tightest circle of the robots [m]; 0 if they turn on the spot.
        inset: Width of the strip along the edge in which nothing is driven [m].
    """

    def rank(design: Design) -> tuple[bool, float, float]:
        """Order the designs, the best one first."""
        bodies, sensors = design.robot_radius_bound / robot.radius, sensor_radius / design.sensor_radius_bound
        is_infeasible = bool(design.violations(robot.radius, sensor_radius))
        return is_infeasible, 0.0 if is_infeasible else -design.phase_rate, -min(bodies, sensors)

    designs, has_places = [], closed_forms.has_unclustered_equilibrium(num_robots)
    for a in (odd for odd in range(1, num_robots, 2) if math.gcd(odd, num_robots) == 1):
        whole = Curve(half_width, half_height, a, num_robots - a, inset=inset or None)
        curve = whole.driven
        reach = max(closed_forms.coverage_radius(curve), closed_forms.detection_radius(curve, num_robots))
        design = Design(
            curve=whole,
            phase_rate=largest_phase_rate(curve, speed, turning_radius, robot.lateral_acceleration_max),
            robot_radius_bound=closed_forms.robot_radius_bound(curve, num_robots) if has_places else 0.0,
            sensor_radius_bound=reach + math.sqrt(2) * inset,
            tight_share=geometry.tight_share(curve, turning_radius),
        )
        designs.append(design)
    return min(designs, key=rank)
