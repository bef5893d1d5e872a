"""Closed forms of the paper, in float64 NumPy: equations (2), (5)-(9), T_max, and which p and alpha to use.

M. Boldrer, L. Lyons, L. Palopoli, D. Fontanelli, L. Ferranti, "Time-inverted Kuramoto Model Meets Lissajous Curves:
Multi-Robot Persistent Monitoring and Target Detection". Equation numbers refer to it.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lissajous_env.scenario import Curve


def robot_radius_bound(curve: "Curve", num_robots: int) -> float:
    """r_max = sin(pi / N) A B / sqrt(A^2 a^2 + B^2 b^2) [m], equation (6): robots below it never touch in formation.

    A sufficient bound; half of the smallest distance ever seen is about 1.5 times as large.
    """
    A, B = curve.half_width, curve.half_height
    return math.sin(math.pi / num_robots) * A * B / math.hypot(A * curve.a, B * curve.b)


def coverage_radius(curve: "Curve") -> float:
    """r_s > max(B sin(pi / 2a), A sin(pi / 2b)) [m], equation (7): one lap of one robot senses every point.

    Differs from the paper: the text above (7) swaps the two denominators; the formula is the one that holds.
    """
    along_y = curve.half_height * math.sin(math.pi / (2 * curve.a))
    along_x = curve.half_width * math.sin(math.pi / (2 * curve.b))
    return max(along_y, along_x)


def detection_radius(curve: "Curve", num_robots: int, clusters: int = 1) -> float:
    """r_s >= sin(pi / (N / kappa)) sqrt(A^2 + B^2) [m], equation (8): sensing discs of ring neighbours always overlap."""
    return math.sin(math.pi * clusters / num_robots) * math.hypot(curve.half_width, curve.half_height)


def detection_time_bound(phase_rate: float, num_robots: int, clusters: int = 1) -> float:
    """T_max = (2 pi / omega) / (N / kappa) [s], below equation (8)."""
    return 2 * math.pi / phase_rate * clusters / num_robots


def stable_equilibria(num_robots: int) -> list[int]:
    """All p in {0 ... N - 1} for which equilibrium (2) is stable: N / 4 < p < 3 N / 4 (Theorem 1)."""
    return [p for p in range(num_robots) if num_robots < 4 * p < 3 * num_robots]


def default_p(num_robots: int) -> int:
    """The stable p of the least clustered equilibrium, the largest of those not above N / 2; 0 where none is stable.

    Coprime with N (one robot to a place) for every N > 2 but 4 and 6 (Theorem 2).
    """
    lower_half = [p for p in stable_equilibria(num_robots) if 2 * p <= num_robots]
    return min(lower_half, key=lambda p: (math.gcd(p, num_robots), -p), default=0)


def default_alpha(curve: "Curve", num_robots: int, p: int) -> int:
    """The alpha with alpha p = a^-1 (mod N), so that the edges of the ring are the neighbours on ellipse (5) (Lemma 2).

    1 where no such alpha exists: a clustered p, or N sharing a factor with a (as it can when N is not a + b).
    """
    if num_robots == 1 or math.gcd(curve.a * p, num_robots) > 1:
        return 1
    return pow(curve.a * p, -1, num_robots)


def equilibrium_phases(num_robots: int, p: int, ring: Sequence[int]) -> np.ndarray:
    """Equilibrium (2) with theta_0 = 0: the k-th robot of the ring has phase 2 pi p k / N.

    Returns (N,) phases in [0, 2 pi) [rad], indexed by robot.
    """
    phases = np.empty(num_robots)
    phases[list(ring)] = 2 * math.pi * (p * np.arange(num_robots) % num_robots) / num_robots
    return phases


def curve_point(curve: "Curve", curve_phase: np.ndarray) -> np.ndarray:
    """r = (A cos(a gamma), B sin(b gamma)) [m], equation (3), for any shape of gamma [rad]; adds a last axis of 2."""
    gamma = np.asarray(curve_phase, dtype=float)
    return np.stack(
        [curve.half_width * np.cos(curve.a * gamma), curve.half_height * np.sin(curve.b * gamma)], axis=-1
    )


def curve_speed(curve: "Curve", curve_phase: np.ndarray) -> np.ndarray:
    """||r'(gamma)|| [m/rad], below equation (14)."""
    gamma = np.asarray(curve_phase, dtype=float)
    return np.hypot(
        curve.half_width * curve.a * np.sin(curve.a * gamma), curve.half_height * curve.b * np.cos(curve.b * gamma)
    )
