"""Numerical measures of a curve: lengths, curvature, distances in formation and coverage.

Float64 NumPy. Bounds (6) and (7) are only sufficient; the quantities that they bound are computed here. Distances and
lengths are accurate to about nine digits (with hairpins: six), tight shares and coverage to four, accelerations to 4 %.
"""

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from lissajous_env.settings.parts import Curve
from lissajous_env.theory.closed_forms import curve_derivatives, curve_point, curve_point_3d, curve_speed

_SAMPLES_PER_OSCILLATION = 64
SLACK = 1e-3
"""Relative excess over a limit up to which a speed, a turning radius or an acceleration still counts as within it."""
_PLACES = 8192
"""Places of the curve that `locate` compares."""
_REACH = 0.25
"""Distance that weighs as much as a heading that is off by a right angle [half of the rectangle's shorter side]."""


def curve_length(curve: Curve) -> float:
    """Return the length of one lap of the plane curve, the integral of ||r'(gamma)|| over [0, 2 pi) [m]."""
    # The trapezoidal rule converges geometrically on a periodic function without kinks.
    return 2 * np.pi * float(np.mean(curve_speed(curve, lap_phases(curve))))


@lru_cache(maxsize=64)
def largest_speed(curve: Curve) -> float:
    """Return the largest ||r'(gamma)|| of the plane curve [m/rad]; omega times this is the top speed of the formation.

    It is accurate to nine digits.
    """
    return -_minimum(lambda gamma: -curve_speed(curve, gamma), lap_phases(curve, 1))


@lru_cache(maxsize=64)
def top_speed(curve: Curve, phase_rate: float) -> float:
    """Return the speed of a formation on the fastest stretch of the curve [m/s], for `phase_rate` omega [rad/s].

    4096 samples ensure identical bits in all policies; the relative error is below 1e-5 in the paper's scenarios.
    """
    return phase_rate * float(curve_speed(curve, np.linspace(0, 2 * np.pi, 4096)).max())


@lru_cache(maxsize=64)
def along_lap(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Return ||r'|| [m/rad] and the radius of curvature [m] along a lap of the plane curve.

    The radius is ||r'||^3 / |x' y'' - y' x''|, infinite where the curve is straight.
    """
    (dx, dy), (ddx, ddy) = (derivative.T for derivative in curve_derivatives(curve, lap_phases(curve)))
    speed = np.hypot(dx, dy)
    with np.errstate(divide="ignore"):
        return speed, speed**3 / np.abs(dx * ddy - dy * ddx)


def needed_acceleration(curve: Curve, turning_radius: float = 0.0) -> float:
    """Return the largest lateral acceleration along the curve, over the square of the phase rate [m/rad^2].

    It is max ||r'||^2 / max(radius of curvature, turning radius): cars cut the bends that are tighter than they turn.

    Args:
        curve: The curve.
        turning_radius: Radius of the tightest circle of a car [m].
    """
    speed, radius = along_lap(curve)
    return float(np.max(speed**2 / np.maximum(radius, turning_radius)))


def turning_radius(wheelbase: float, steering_max: float) -> float:
    """Return the radius of the tightest circle of a car's rear axle, l / tan(delta_max) [m]."""
    return wheelbase / math.tan(steering_max)


def tight_share(curve: Curve, radius: float) -> float:
    """Return the share of the arc of the plane curve that turns tighter than `radius` [m], between 0 and 1."""
    speed, radii = along_lap(curve)
    return float(speed[radii < radius].sum() / speed.sum())


def chord_length(curve: Curve, middle: np.ndarray, half: np.ndarray | float) -> np.ndarray:
    """Return the distance between two robots at gamma = u - v and u + v [m], in 3D if `half_depth` is positive.

    Args:
        curve: the curve.
        middle: u, the middle of the two phases [rad].
        half: v, half of their difference [rad]; broadcasts with u.
    """
    chord = curve_point_3d(curve, middle + half) - curve_point_3d(curve, middle - half)
    return np.sqrt(np.einsum("...i,...i", chord, chord))


def smallest_distance(curve: Curve, num_robots: int, least: float = 0.0) -> float:
    """Return the smallest distance of two robots over a lap in equilibrium, 2 pi / N apart on the curve [m].

    Half of it is the largest body without collisions, of which (6) is a lower bound. Fig. 5 shows it in three
    dimensions. If it is below `least` [m], another distance below that may be returned in its place, which is faster.
    """
    middle = lap_phases(curve, 1)
    halves = np.pi * np.arange(1, num_robots // 2 + 1) / num_robots
    for v in halves:
        if (sampled := chord_length(curve, middle, v).min()) < least:
            return float(sampled)
    return min((_minimum(lambda u, v=v: chord_length(curve, u, v), middle) for v in halves), default=math.inf)


def largest_neighbour_distance(curve: Curve, num_robots: int, p: int, alpha: int = 1) -> float:
    """Return the largest distance of ring neighbours over a lap in equilibrium p [m]; at most 2 r_s of (8) on (5)."""
    half = math.pi * p * alpha / num_robots
    return -_minimum(lambda u: -chord_length(curve, u, half), lap_phases(curve, 1))


def measured_coverage_radius(curve: Curve, precision: float = 1e-4) -> float:
    """Return the least sensing radius with which one lap covers the rectangle [m]; (7) is an upper bound.

    It is the largest distance of a point of the rectangle from the curve. Since the distance is 1-Lipschitz, a cell of
    a grid needs no division once its centre's distance plus half of its diagonal is at most the largest distance so
    far, up to `precision` times the half diagonal of the rectangle.
    """
    half_extent = np.array([curve.half_width, curve.half_height])
    tolerance = precision * math.hypot(*half_extent)
    # A chord of length s hides s^2 / 8 d of the distance d; d is about the width of a mesh of the curve.
    mesh = math.hypot(curve.half_width / curve.b, curve.half_height / curve.a)
    gamma = np.linspace(0, 2 * np.pi, int(4 * curve_length(curve) / math.sqrt(tolerance * mesh)))
    from scipy.spatial import KDTree  # slow to import

    tree = KDTree(curve_point(curve, gamma))
    cells = np.ceil(half_extent / half_extent.min()).astype(int)  # roughly square, so that the division ends
    half_cell = half_extent / cells
    columns, rows = np.indices(cells).reshape(2, -1)
    centres, radius = half_cell * (2 * np.stack([columns, rows], axis=-1) + 1) - half_extent, 0.0
    quarters = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    while len(centres):
        distances = tree.query(centres)[0]
        radius = max(radius, float(distances.max()))
        undecided = distances + math.hypot(*half_cell) > radius + tolerance
        half_cell = half_cell / 2
        centres = (centres[undecided, None, :] + quarters * half_cell).reshape(-1, 2)
    return radius


def lap_phases(curve: Curve, density: int = 16) -> np.ndarray:
    """Return evenly spaced phases over a lap [rad], `density` times as many as needed to resolve all local minima."""
    oscillations = len(curve.harmonics) or max(curve.a, curve.b, curve.c if curve.half_depth > 0 else 1)
    return np.linspace(0, 2 * np.pi, density * _SAMPLES_PER_OSCILLATION * oscillations, endpoint=False)


def _minimum(function: Callable[[np.ndarray], np.ndarray], samples: np.ndarray) -> float:
    """Return the smallest value of a smooth periodic function by refining every local minimum of the samples."""
    values = function(samples)
    centres = samples[(values <= np.roll(values, 1)) & (values <= np.roll(values, -1))]
    spacing, offsets = samples[1] - samples[0], np.linspace(-1, 1, 17)
    for _ in range(6):
        candidates = centres[:, None] + spacing * offsets
        centres = candidates[np.arange(len(centres)), np.argmin(function(candidates), axis=1)]
        spacing /= 8
    return float(np.min(function(centres)))


def locate(curve: Curve, alpha: int, x: float, y: float, heading: float, near: float) -> float:
    """Return the phase theta in [0, 2 pi) [rad] at which the curve passes a pose in its direction.

    The curve crosses itself, so the heading decides between branches. Where several phases belong to one place of the
    curve (`alpha` of Lemma 2 above 1), it is the one nearest to `near` [rad].
    """
    gamma = np.arange(_PLACES) * (2 * np.pi / _PLACES)
    place, along = curve_point(curve, gamma), curve_derivatives(curve, gamma)[0]
    off = np.arctan2(along[..., 1], along[..., 0]) - heading
    reach = _REACH * min(curve.half_width, curve.half_height)
    square = np.sum((place - (x, y)) ** 2, axis=-1)
    best = gamma[np.argmin(square / reach**2 + 1 - np.cos(off))]
    phases = (best + 2 * np.pi * np.arange(alpha)) / alpha
    return float(phases[np.argmax(np.cos(phases - near))] % (2 * np.pi))
