"""Conditions (6), (7) and (8), and T_max, also against rogues that know what the robots will do.

Closed forms beside what is measured and simulated.
"""

import math

import numpy as np

from baselines.reproduce.claims import Part, all_of, at_most, near
from baselines.reproduce.episodes import Player
from lissajous_env import scenario
from lissajous_env.episodes.guarantee import IdealFormation
from lissajous_env.parameters.scenario import Curve
from lissajous_env.theory import closed_forms, geometry

_SHAPES = ((1.8, 0.8), (5.0, 5.0), (5.0, 3.0))
"""Half width and half height [m] of the rectangles."""
_FEWEST, _MOST = 3, 21
"""N of the curves, without those that have no equilibrium with one robot to a place."""
_LEFT_OUT = [n for n in range(_FEWEST, _MOST + 1) if not closed_forms.has_unclustered_equilibrium(n)]
_SPEEDS = (0.2, 1.0, 5.0)
"""Speeds of the evading targets [m/s]."""


def bounds(player: Player) -> Part:
    """Compare conditions (6), (7), (8) and T_max with measurements, on curves with a odd, a + b = N and co-prime."""
    curves = [
        Curve(A, B, a, n - a)
        for A, B in _SHAPES
        for n in range(_FEWEST, _MOST + 1)
        for a in range(1, n, 2)
        if n not in _LEFT_OUT and math.gcd(a, n) == 1
    ]
    ratios: list[tuple[float, float, float]] = []
    for curve in curves:
        n = curve.a + curve.b
        p = closed_forms.default_p(n)
        reach = geometry.largest_neighbour_distance(curve, n, p, closed_forms.default_alpha(curve, n, p))
        ratios.append((
            geometry.smallest_distance(curve, n) / 2 / closed_forms.robot_radius_bound(curve, n),
            geometry.measured_coverage_radius(curve, precision=2e-3) / closed_forms.coverage_radius(curve),
            reach / 2 / closed_forms.detection_radius(curve, n),
        ))  # fmt: skip
    bodies, sensors, links = np.array(ratios).T
    robots = np.array([curve.a + curve.b for curve in curves])
    fewest, count = robots == _FEWEST, f"{len(curves)} curves, N = {_FEWEST} ... {_MOST}"
    larger, paper = bodies[~fewest], scenario("experiment")
    name = f"T_max of the experiment, N = {paper.num_robots}, omega = {paper.formation.phase_rate:g} rad/s"
    claims = [
        near(name, 4.189, paper.detection_time_bound, 5e-4, "s", "by the formula"),
        all_of(
            "(6): bodies below r_max never collide in formation",
            "always",
            bodies >= 1,
            "curves",
            f"conservative: the measured radius is {larger.min():.2f} to {larger.max():.2f} times r_max for N >= "
            f"{robots[~fewest].min()}, from {bodies[fewest].min():.2f} times on for N = {_FEWEST}",
        ),
        all_of(
            "(7): a sensor of that radius covers in one lap",
            "always",
            sensors <= 1,
            "curves",
            f"the radius that is needed is {sensors.min():.2f} to {sensors.max():.2f} times that of (7); {count}",
        ),
        at_most(
            "(8): largest distance of ring neighbours / 2 r_s, alpha by the rule",
            "at most 1",
            links.max(),
            1 + 1e-9,
            digits=".6f",
            why=f"exactly 1 for odd N (smallest {links[robots % 2 == 1].min():.6f}); {count}",
        ),
    ]
    return Part(claims)


def rogues(player: Player) -> Part:
    """Compute the worst-case undetected time of the formation with the sensing radius of (8)."""
    claims = []
    for name in ("experiment", "ideal"):
        formation = scenario(name)
        words = f"N = {formation.num_robots}, a = {formation.curve.a}, b = {formation.curve.b}"
        points = IdealFormation(formation, formation.detection_radius)
        times = [points.guaranteed_time(speed) for speed in _SPEEDS]
        claims.append(
            at_most(
                f"{words}, r_s of (8): longest time unseen, rogues of 0.2, 1 and 5 m/s",
                f"T_max = {formation.detection_time_bound:.3g} s",
                max(times),
                formation.detection_time_bound,
                "s",
                why="the paper shows random walkers; this is the worst of all motions, detection between steps with it",
            )
        )
    return Part(claims)
