"""Theorem 1 and 2, Lemma 1 and 2, conditions (6), (7) and (8), and T_max: closed forms beside simulations."""

import math

import numpy as np

from baselines.reproduce.claims import Claim, Part, all_of, at_most, near, span
from baselines.reproduce.episodes import BARE, EpisodeArrays, Player, phase_distance
from lissajous_env import scenario
from lissajous_env.episodes.guarantee import IdealFormation
from lissajous_env.parameters.scenario import Curve
from lissajous_env.theory import closed_forms, geometry
from lissajous_env.world.tally import RECOVERED

_NUMBERS = (5, 6, 7, 8, 10, 15)
_STARTS = 300
_SHAPES = ((1.8, 0.8), (5.0, 5.0), (5.0, 3.0))
"""Half width and half height [m] of the rectangles."""
_FEWEST, _MOST = 3, 21
"""N of the curves, without those that have no equilibrium with one robot to a place."""
_SPEEDS = (0.2, 1.0, 5.0)
"""Speeds of the rogues [m/s]."""


def theorem1(player: Player) -> Part:
    """Test Theorem 1: equilibria reached from random starts."""
    for n in _NUMBERS:
        played = _random_starts(player, n)
        reached = played.winding[-1]
        share = np.bincount(reached, minlength=n)[:n] / _STARTS
        # In an equilibrium (2), all ring neighbours are equally far apart in phase.
        off = phase_distance(played.ring_phases[-1], 2 * np.pi * reached[:, None] / n).max(axis=-1)
        inside = np.isin(reached, closed_forms.stable_equilibria(n)) & (off < RECOVERED)
        reached_p = [p for p in np.argsort(-share) if share[p] > 0]
        yield all_of(
            f"N = {n}: random starts converge to p in (N/4, 3N/4) = ({n / 4:g}, {3 * n / 4:g})",
            "all",
            inside,
            "starts",
            ", ".join(f"p = {p} {100 * share[p]:.2g} %" for p in reached_p),
        )


def theorem2(player: Player) -> Part:
    """Test Theorem 2: stable equilibria with one robot at each place."""
    # By the eigenvalues of (1) at equilibrium (2), and not by the rule of Theorem 1.
    exists = {
        n: any(closed_forms.equilibrium_eigenvalues(n, p)[1:].max() < -1e-9 for p in range(n) if math.gcd(n, p) == 1)
        for n in range(3, 41)
    }
    exceptions = [exists.pop(n) for n in (4, 6)]
    yield all_of(
        "a stable 1-clustered equilibrium exists, by the eigenvalues of the Jacobian, N = 3 ... 40 without 4 and 6",
        "always",
        exists.values(),
        "numbers of robots",
    )
    yield Claim(
        "none for N = 4 and 6",
        "excluded",
        f"{sum(exceptions)} of 2",
        "0",
        not any(exceptions),
        "robots always share places: p = 2 is the only one of 4, p = 2, 3, 4 none co-prime to 6",
    )


def lemmas(player: Player) -> Part:
    """Test Lemma 1 and 2: clusters, and equilibria made of others."""
    shared = []
    for n in _NUMBERS:
        played = _random_starts(player, n)
        for reached, phases in zip(played.winding[-1], played.phase[-1], strict=True):
            apart = phase_distance(phases[:, None], phases)
            # Where kappa robots share a place, each has kappa robots within 0.02 rad, itself included.
            shared.append(bool(np.all((apart < 0.02).sum(axis=1) == math.gcd(n, reached))))
    odd = range(3, 102, 2)
    reached_by_alpha = []
    for n in odd:
        base = closed_forms.equilibrium_phases(n, (n - 1) // 2, range(n))
        for wanted in range(n):
            alpha = closed_forms.alpha_for(n, (n - 1) // 2, wanted)
            phases = closed_forms.equilibrium_phases(n, wanted, range(n))
            reached_by_alpha.append(alpha is not None and phase_distance(alpha * base, phases).max() < 1e-6)
    yield all_of(
        "Lemma 1: gcd(N, p) robots share a place in the equilibrium reached",
        "always",
        shared,
        "starts",
        "the end states of theorem1",
    )
    yield all_of(
        "Lemma 2: alpha times equilibrium (N - 1) / 2 is any equilibrium, N odd up to 101",
        "always",
        reached_by_alpha,
        "equilibria",
        "alpha = p / ((N - 1) / 2) modulo N; the paper does not state which",
    )


def _random_starts(player: Player, n: int) -> EpisodeArrays:
    """Return episodes of N points that start at uniform random phases, long enough to settle."""
    bare = BARE | {"formation.start": "random", "formation.alpha": 1, "formation.p": None, "robot.count": n}
    bare |= {"task.step": 0.25, "task.duration": 150.0}
    # Theorem 1 is of (1) as it is, without a bound on the speed: omega + 2 K is the highest rate that (1) requires.
    bare |= {"robot.phase_rate_max": 0.3 + 2 * 1.0}
    bare |= {"sensing.radius": 1.0, "sensing.robots_seen": 0, "sensing.targets_seen": 0}
    return player.play("kuramoto", scenario("failure", **bare), worlds=_STARTS)


def bounds(player: Player) -> Part:
    """Compare conditions (6), (7), (8) and T_max with measurements, on curves with a odd, a + b = N and co-prime."""
    curves = [
        Curve(A, B, a, n - a)
        for A, B in _SHAPES
        for n in range(_FEWEST, _MOST + 1)
        for a in range(1, n, 2)
        if closed_forms.has_unclustered_equilibrium(n) and math.gcd(a, n) == 1
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
    yield near(name, 4.189, paper.detection_time_bound, 5e-4, "s", "by the formula")
    yield all_of(
        "(6): bodies below r_max never collide in formation",
        "always",
        bodies >= 1,
        "curves",
        f"conservative: the measured radius is {span(larger, '.2f')} times r_max for N >= "
        f"{robots[~fewest].min()}, from {bodies[fewest].min():.2f} times on for N = {_FEWEST}",
    )
    yield all_of(
        "(7): a sensor of that radius covers in one lap",
        "always",
        sensors <= 1,
        "curves",
        f"the radius that is needed is {span(sensors, '.2f')} times that of (7); {count}",
    )
    yield at_most(
        "(8): largest distance of ring neighbours / 2 r_s, alpha by the rule",
        "at most 1",
        links.max(),
        1 + 1e-9,
        digits=".6f",
        why=f"exactly 1 for odd N (smallest {links[robots % 2 == 1].min():.6f}); {count}",
    )


def rogues(player: Player) -> Part:
    """Compute the worst-case undetected time of the formation with the sensing radius of bound (8)."""
    for name in ("experiment", "ideal"):
        formation = scenario(name)
        words = f"N = {formation.num_robots}, a = {formation.curve.a}, b = {formation.curve.b}"
        points = IdealFormation(formation, formation.detection_radius)
        times = [points.guaranteed_time(speed) for speed in _SPEEDS]
        yield at_most(
            f"{words}, r_s of (8): worst-case undetected time, rogues of 0.2, 1 and 5 m/s",
            f"T_max = {formation.detection_time_bound:.3g} s",
            max(times),
            formation.detection_time_bound,
            "s",
            why="the paper shows random walkers; this is the worst of all motions, detection between steps with it",
        )
