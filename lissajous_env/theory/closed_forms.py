"""Closed forms of the paper, in float64 NumPy: equations (1), (2), (4)-(10), Theorems 1 and 2, Lemmas 1 and 2.

M. Boldrer, L. Lyons, L. Palopoli, D. Fontanelli, L. Ferranti, "Time-inverted Kuramoto Model Meets Lissajous Curves:
Multi-Robot Persistent Monitoring and Target Detection". Equation numbers refer to it. Quantities without a closed form
are computed numerically in `lissajous_env.theory.geometry`. `rounded` is a curve that the paper does not have.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from lissajous_env.settings.parts import Curve

ROUNDED = {(3, 2): ((-0.25, 0.825, -0.037, -0.002, 0.03), (0.623, 0.707, -0.289, 0.202, 0.038))}
"""Coefficients of `rounded` by a and b: c_k for k = 1, 3 and so on, and s_k for k = 2, 4 and so on.

`python benchmarks/rounding.py` computes them for the cars of `evaders-walls`: of the curves that bend at 1.1 of their
turning radius at least, and on which they are 0.39 m apart in formation, this one is nearest to (3) at equal gamma.
"""

# Radii and times of the formation, as functions of curve, number of robots and sensor.


def robot_radius_bound(curve: Curve, num_robots: int) -> float:
    """Return r_max = sin(pi / N) A B / sqrt(A^2 a^2 + B^2 b^2) [m], equation (6).

    Smaller robots never collide in formation. The bound is sufficient: half of the smallest distance is about 1.5 times
    as large (pi / 2 for large a, b).
    """
    if curve.harmonics:
        return math.nan  # defined for Lissajous curves only
    A, B = curve.half_width, curve.half_height
    return math.sin(math.pi / num_robots) * A * B / math.hypot(A * curve.a, B * curve.b)


def coverage_radius(curve: Curve) -> float:
    """Return max(B sin(pi / 2a), A sin(pi / 2b)) [m], above which a lap of one robot senses every point, equation (7).

    Differs from the paper: the text above (7) swaps the two denominators; the formula is the one that holds.
    """
    if curve.harmonics:
        return math.nan  # defined for Lissajous curves only
    along_y = curve.half_height * math.sin(math.pi / (2 * curve.a))
    along_x = curve.half_width * math.sin(math.pi / (2 * curve.b))
    return max(along_y, along_x)


def detection_radius(curve: Curve, num_robots: int, clusters: int = 1) -> float:
    """Return sin(pi / (N / kappa)) sqrt(A^2 + B^2) [m], from which on discs of ring neighbours overlap, equation (8).

    Differs from the paper: where all robots share one place (N = kappa) there is no neighbour and the formula gives 0;
    it is the half diagonal then, as for two places, with which a lap senses every point.
    """
    if curve.harmonics:
        return math.nan  # defined for Lissajous curves only
    places = max(num_robots / clusters, 2)
    return math.sin(math.pi / places) * math.hypot(curve.half_width, curve.half_height)


def detection_time_bound(phase_rate: float, num_robots: int, clusters: int = 1) -> float:
    """Return the detection-time bound T_max = (2 pi / omega) / (N / kappa) [s], below equation (8)."""
    return 2 * math.pi / phase_rate * clusters / num_robots


def fewest_robots(half_width: float, half_height: float, sensor_radius: float) -> tuple[int, int, int]:
    """Return the fewest robots N with a curve that meets (7) and (8), and the smallest odd a and smallest b of (7).

    The curve has a + b = N and no common divisor of a and b, so one of them may be larger than the smallest of (7).
    """

    def fewest(extent: float, half_turn: float) -> int:
        # A sensor of exactly the bound counts as large enough, whatever the last digit.
        return math.ceil(half_turn / math.asin(min(sensor_radius / extent, 1.0)) - 1e-9)

    a, b = fewest(half_height, math.pi / 2) | 1, fewest(half_width, math.pi / 2)
    robots = max(a + b, fewest(math.hypot(half_width, half_height), math.pi))
    while all(math.gcd(odd, robots) > 1 for odd in range(a, robots - b + 1, 2)):
        robots += 1
    return robots, a, b


# Equilibria: p, clusters and alpha.


def stable_equilibria(num_robots: int) -> list[int]:
    """Return all p in {0 ... N - 1} for which equilibrium (2) is stable: N / 4 < p < 3 N / 4 (Theorem 1)."""
    return [p for p in range(num_robots) if num_robots < 4 * p < 3 * num_robots]


def cluster_size(num_robots: int, p: int, alpha: int = 1) -> int:
    """Return kappa = gcd(N, alpha p), the robots per place on the curve in equilibrium (2) (Lemma 1 for alpha = 1)."""
    return math.gcd(num_robots, alpha * p)


def has_unclustered_equilibrium(num_robots: int) -> bool:
    """Return True if a stable equilibrium with one robot per place exists: all N > 1 but 4, 6 (Theorem 2 for N > 2)."""
    return any(cluster_size(num_robots, p) == 1 for p in stable_equilibria(num_robots))


def default_p(num_robots: int) -> int:
    """Return the stable p of the least clustered equilibrium, the largest one up to N / 2; 0 if none is stable.

    It is coprime with N (one robot per place) for every N > 2 but 4 and 6 (Theorem 2).
    """
    lower_half = [p for p in stable_equilibria(num_robots) if 2 * p <= num_robots]
    return min(lower_half, key=lambda p: (cluster_size(num_robots, p), -p), default=0)


def alpha_for(num_robots: int, p: int, wanted_p: int) -> int | None:
    """Return the smallest alpha >= 1 with alpha p = wanted_p (mod N), or None if there is none.

    Lemma 2 is the case of odd N and p = (N - 1) / 2, from which every equilibrium can be reached.
    """
    shared = math.gcd(num_robots, p)
    if wanted_p % shared:
        return None
    period = num_robots // shared
    return wanted_p // shared * pow(p // shared, -1, period) % period or period


def default_alpha(curve: Curve, num_robots: int, p: int) -> int:
    """Return the alpha for which ring neighbours are neighbours on ellipse (5), alpha p = a^-1 (mod N) (Lemma 2).

    For a clustered p, with kappa = gcd(N, p), the condition applies to the N / kappa places: alpha p / kappa = a^-1
    (mod N / kappa). If no such alpha exists (N shares a factor with a), the result is 1.
    """
    if curve.harmonics:
        return 1
    clusters = math.gcd(num_robots, p)
    return alpha_for(num_robots // clusters, curve.a * (p // clusters), 1) or 1


def ring_lies_on_ellipse(curve: Curve, num_robots: int, p: int, alpha: int = 1) -> bool:
    """Return True if ring neighbours are neighbours on ellipse (5): a alpha p = +-1 (mod N), for N = a + b."""
    return curve.a * alpha * p % num_robots in (1 % num_robots, num_robots - 1)


def equilibrium_phases(num_robots: int, p: int, ring: Sequence[int]) -> np.ndarray:
    """Return equilibrium (2) with theta_0 = 0: the k-th robot of the ring has phase 2 pi p k / N.

    Returns (N,) phases in [0, 2 pi) [rad], indexed by robot.
    """
    phases = np.empty(num_robots)
    phases[list(ring)] = 2 * math.pi * (p * np.arange(num_robots) % num_robots) / num_robots
    return phases


def admissible_displacement(num_robots: int, p: int) -> float:
    """Return the displacement h of one phase below which equilibrium p recovers, cos(2 pi p / N +- d) < 0, bound (9).

    It is h = pi / 2 - |2 pi p / N - pi| [rad], for d in (-h, h); 0 where p is not stable. The condition is sufficient,
    and on the phase theta: on the curve the displacement is alpha times as large.
    """
    return max(math.pi / 2 - abs(2 * math.pi * (p % num_robots) / num_robots - math.pi), 0.0)


# Dynamics.


def kuramoto_rates(phases: np.ndarray, neighbours: np.ndarray, phase_rate: float, coupling: float = 1.0) -> np.ndarray:
    """Return theta_i' = omega - K sum over j in R_i of sin(theta_j - theta_i) [rad/s], equation (1).

    Args:
        phases: (..., N) [rad].
        neighbours: (N, 2) robots before and after each one on the ring, -1 for none, as `Scenario.neighbours`.
        phase_rate: omega, rate of the phase in the equilibrium [rad/s].
        coupling: K [1/s]; the paper prints 1.

    Returns:
        (..., N) [rad/s].
    """
    differences = phases[..., neighbours] - phases[..., None]  # (..., N, 2)
    return phase_rate - coupling * np.sum(np.where(neighbours >= 0, np.sin(differences), 0.0), axis=-1)


def equilibrium_eigenvalues(num_robots: int, p: int, coupling: float = 1.0) -> np.ndarray:
    """Return the eigenvalues of (1) at equilibrium (2), 2 K cos(2 pi p / N) (1 - cos(2 pi k / N)) [1/s], for N > 2.

    Returns (N,), k = 0 ... N - 1; that of k = 0 is the free choice of theta_0. All others are negative exactly for the
    p of Theorem 1, and the one of k = 1 is the rate at which the formation recovers.
    """
    modes = 2 * math.pi * np.arange(num_robots) / num_robots
    return 2 * coupling * math.cos(2 * math.pi * p / num_robots) * (1 - np.cos(modes))


# The curve and the ellipse that the formation forms.


def curve_point(curve: Curve, curve_phase: np.ndarray) -> np.ndarray:
    """Return (A cos(a gamma), B sin(b gamma)) [m], equation (3); gamma [rad] of any shape gains an axis of 2."""
    gamma = np.asarray(curve_phase, dtype=float)
    if curve.harmonics:
        return series(curve.harmonics, gamma)
    return np.stack([curve.half_width * np.cos(curve.a * gamma), curve.half_height * np.sin(curve.b * gamma)], axis=-1)


def curve_point_3d(curve: Curve, curve_phase: np.ndarray) -> np.ndarray:
    """Return (A cos(a gamma), B sin(b gamma), C sin(c gamma)) [m], equation (10); gamma [rad] gains an axis of 3."""
    gamma = np.asarray(curve_phase, dtype=float)
    height = curve.half_depth * np.sin(curve.c * gamma)
    return np.concatenate([curve_point(curve, gamma), height[..., None]], axis=-1)


def curve_speed(curve: Curve, curve_phase: np.ndarray) -> np.ndarray:
    """Return ||r'(gamma)|| of the plane curve [m/rad], below equation (14), for gamma [rad] of any shape."""
    return np.hypot(*np.moveaxis(curve_derivatives(curve, curve_phase)[0], -1, 0))


def curve_derivatives(curve: Curve, curve_phase: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return r' [m/rad] and r'' [m/rad^2] of the plane curve; gamma [rad] of any shape gains an axis of 2."""
    gamma = np.asarray(curve_phase, dtype=float)
    if curve.harmonics:
        return series(curve.harmonics, gamma, 1), series(curve.harmonics, gamma, 2)
    A, B, a, b = curve.half_width, curve.half_height, curve.a, curve.b
    first = np.stack([-A * a * np.sin(a * gamma), B * b * np.cos(b * gamma)], axis=-1)
    return first, np.stack([-A * a**2 * np.cos(a * gamma), -B * b**2 * np.sin(b * gamma)], axis=-1)


def series(harmonics: Sequence[Sequence[float]] | np.ndarray, gamma: np.ndarray, order: int = 0) -> np.ndarray:
    """Return the curve of the rows of `Curve.harmonics`, or a derivative by gamma [rad], (..., 2) [m/rad^order]."""
    k = np.arange(1, len(harmonics) + 1)
    turn = gamma[..., None] * k + order * np.pi / 2
    rows = np.array(harmonics) * (k**order)[:, None]
    return np.cos(turn) @ rows[:, ::2] + np.sin(turn) @ rows[:, 1::2]


def rounded(curve: Curve) -> Curve:
    """Return the rounded form of a Lissajous curve, as a series in the same rectangle; the curve itself without one.

    In the open, a car that turns more widely than the curve bends leaves the rectangle there, which walls prevent. The
    rounded form of the curve 3:2, for such cars within walls, has the extents and the symmetries of (3):

        x(gamma) = A sum of c_k cos(k gamma), k odd        y(gamma) = B sum of s_k sin(k gamma), k even
    """
    if (curve.a, curve.b) not in ROUNDED:
        return curve
    x, y = ROUNDED[curve.a, curve.b]
    rows = np.zeros((2 * len(y), 4))
    rows[::2, 0], rows[1::2, 3] = curve.half_width * np.array(x), curve.half_height * np.array(y)
    return dataclasses.replace(curve, harmonics=tuple(map(tuple, rows.tolist())))


def unrounded(curve: Curve) -> Curve:
    """Return the Lissajous curve whose rounded form a curve is; the curve itself if it is none."""
    if not curve.harmonics or (curve.a, curve.b) not in ROUNDED:
        return curve
    plain = dataclasses.replace(curve, harmonics=())
    given, form = np.array(curve.harmonics), np.array(rounded(plain).harmonics)
    return plain if given.shape == form.shape and np.allclose(given, form, rtol=1e-9, atol=0.0) else curve


def ellipse_residual(curve: Curve, positions: np.ndarray, curve_phase: float | np.ndarray) -> np.ndarray:
    """Return y^2/B^2 + x^2/A^2 - 2 x y sin((a + b) gamma)/(A B) - cos^2((a + b) gamma), 0 on ellipse (5).

    Args:
        curve: The curve.
        positions: (..., 2) [m].
        curve_phase: gamma of any robot of the formation [rad].

    Returns:
        (...), without a unit.
    """
    x, y = positions[..., 0] / curve.half_width, positions[..., 1] / curve.half_height
    angle = (curve.a + curve.b) * np.asarray(curve_phase, dtype=float)
    return y**2 + x**2 - 2 * x * y * np.sin(angle) - np.cos(angle) ** 2
