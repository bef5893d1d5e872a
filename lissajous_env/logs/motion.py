"""The motion of a robot between its poses, and what is not known of it.

Nothing is known of a robot between two poses that are far apart in time (a gap), between two that it cannot have driven
between (a jump), before its first one, and after its last one. Elsewhere its speed and its heading change evenly from
pose to pose; a cubic without slopes at its ends adds the rest of the way to the next pose. An arc that is driven at a
steady speed is exact, and without a turn the motion is the cubic through both poses with these speeds. Where speeds
were not logged, or contradict the poses, the slopes of the cubic are those of the smoothed poses.

Noisy poses would make the way too long, so it leads through smoothed ones: smoothed so far that their noise does not
matter. Where speeds were logged, the differences of the poses from the way at these speeds are smoothed, so that a
motion that they describe is not.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.sparse.linalg import spsolve
from scipy.special import gammaincinv

from lissajous_env.logs.log import Track
from lissajous_env.wording import counted

SAME_TIME = 1e-6
"""Difference up to which two times are the same [s]."""
_FEWEST = 5
"""Least number of poses whose noise is known: one more than a cubic has coefficients."""
_CALM = 0.35
"""Share of the values whose deviations from smooth motion are noise; corners and fast turns make others larger."""
_PRECISE = 0.0125
"""Standard deviation of a velocity up to which it is precise, in typical speeds of the robot."""
_CLOSE = 2.5
"""Standard deviations of a pose within which most smoothed ones lie: 90 % of normal noise is within 2.15 of them."""
_LONGEST = 0.15
"""Longest time constant with which poses are smoothed, even if a velocity is not precise [s]."""
_SHORTER = 0.7
"""Factor of time constants that are tried one after the other."""
_SHORTEST = 0.2
"""Shortest time constant, in mean times between two poses."""
_PIECES = 3
"""Largest number of pieces of a spline in a time constant."""
_CONTRADICTING = 0.25
"""Share of the poses of a moving robot above which logged speeds that do not match contradict them."""
_NOISY = 4.5
"""Standard deviations up to which the speed of a robot that stands still may be noise: one in 25,000 is faster."""
_STOPS = 1 / 3
"""Largest share by which the way between two poses may differ from that at their speeds. A robot that drove less
stopped at once, as in a collision; its motion until then is slowed down, so that it does not overshoot."""
_WITH_TURNS = 0.05
"""This share where whole turns are added between two poses."""
_FASTER = 2.0
"""Factor on the top speed of the scenario's robots, above which the way between two poses is a jump."""
_JUMP = 6.0
"""Standard deviations of a position by which a jump must exceed this way."""


@dataclass(frozen=True)
class Motion:
    """Motion of a robot."""

    track: Track
    """Its path through the smoothed poses, with a heading and a speed at each."""
    velocity: np.ndarray
    """(K, 3) velocities at the poses [m/s]."""
    known: np.ndarray
    """(K - 1,) True where the motion from a pose to the next is known."""
    jumps: np.ndarray
    """(K - 1,) True where a pose and the next are a jump."""
    why_derived: str = ""
    """Reason for which speeds are derived from the poses; "" if they are those of the log."""
    has_headings: bool = True
    """False if headings are those of the direction of motion, because the log has none."""

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return places (M, 3) [m], headings, speeds (M,) at times [s]; where unknown, on straight lines at speed 0.

        At the times of known poses they are those of `track`, to the last bit.
        """
        track = self.track
        near = np.clip(np.searchsorted(track.time, times - SAME_TIME), 0, len(track) - 1)
        times = np.where(np.abs(times - track.time[near]) < SAME_TIME, track.time[near], times)
        k = np.clip(np.searchsorted(track.time, times, side="right") - 1, 0, len(track) - 2)
        width = np.diff(track.time)[k]
        share = np.clip((times - track.time[k]) / width, 0, 1)
        begin, end = width[:, None] * self.velocity[[k, k + 1]]
        turn, way = np.diff(track.heading)[k] * (not self.why_derived), np.diff(track.position, axis=0)[k]
        whole, s = _driven(begin, end, turn), share[:, None]
        least = (1 - _STOPS) * np.linalg.norm(whole, axis=1)
        slower = np.minimum(np.linalg.norm(way, axis=1) / np.maximum(least, 1e-12), 1)[:, None]
        smooth = slower * _driven(begin, end, turn, share) + s**2 * (3 - 2 * s) * (way - slower * whole)
        smooth = np.where(self.known[k, None], smooth, s * way)
        place = np.where(s < 1, track.position[k] + smooth, track.position[k + 1])
        speed = np.where(self.unknown(times, times), 0.0, np.interp(times, track.time, track.speed))
        return place, np.interp(times, track.time, track.heading), speed

    def unknown(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return True for intervals, each from a `begin` to an `end` [s], that are not wholly known."""
        time, is_jump = self.track.time, np.concatenate([[False], self.jumps, [False]])
        is_outlier = is_jump[:-1] & is_jump[1:]  # a pose between two jumps, which is left out
        first = np.concatenate([[-np.inf], time[:-1][~self.known & ~is_outlier[:-1]], time[-1:]])
        last = np.concatenate([time[:1], time[1:][~self.known & ~is_outlier[1:]], [np.inf]])
        k = np.searchsorted(last, begin + SAME_TIME, side="right")
        return first[np.minimum(k, len(first) - 1)] < end - SAME_TIME

    def remarks(self, first: float, last: float, was_removed: bool) -> list[str]:
        """Return remarks for readers of a score from a first to a last time [s]: what is not known, and what is odd."""
        time, words = self.track.time, []
        unknown, limits = ~self.known & (time[:-1] < last) & (time[1:] > first), np.clip(time, first, last)
        gaps, jumps = np.flatnonzero(unknown & ~self.jumps), np.flatnonzero(unknown & self.jumps)
        if len(gaps):
            total, begin, end = np.diff(limits)[gaps].sum(), *limits[gaps[0] : gaps[0] + 2]
            words.append(f"gaps of {total:.3g} s in all, the first from {begin:.3f} to {end:.3f} s, count as failures")
        if len(jumps):
            way, at = np.linalg.norm(np.diff(self.track.position, axis=0)[jumps[0]]), time[jumps[0]]
            rule = "that no robot of the scenario can drive, counted as failure"
            words.append(f"{counted(len(jumps), 'jump')} {rule}, the first of {way:.3g} m at {at:.3f} s")
        if time[-1] < last - SAME_TIME and not was_removed:
            words.append(f"no pose after {time[-1]:.3f} s, which counts as a failure from then on")
        words += [f"the speeds {self.why_derived}; they are computed from the poses"] if self.why_derived else []
        return words + ([] if self.has_headings else ["the headings are unknown; they are those of the motion"])


def motion_of(
    track: Track, gap: float = math.inf, top_speed: float = math.inf, slack: float = 0.0, trusted: bool = False
) -> Motion:
    """Return the motion of a robot along its track.

    Args:
        track: The track.
        gap: Longest time between two poses between which the motion is known [s].
        top_speed: Top speed of the robot [m/s].
        slack: Distance that is no jump [m].
        trusted: True for the speeds of a simulation, in which robots stop at once, so that poses seem to contradict.
    """
    width, way = np.diff(track.time), np.linalg.norm(np.diff(track.position, axis=0), axis=1)
    noise = noise_of(track.time, track.position[:, :2])
    jumps = way > _FASTER * top_speed * width + slack + _JUMP * noise
    known = (width <= gap + SAME_TIME) & ~jumps
    edges = np.concatenate([[0], np.flatnonzero(~known) + 1, [len(track)]])
    position, velocity, _ = _smoothed(track.time, track.position, noise, edges)
    with_heading = np.isfinite(track.heading)
    if has_headings := with_heading.sum() > 1:
        heading = np.interp(track.time, track.time[with_heading], track.heading[with_heading])
    else:
        heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    along = np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=1)
    derived = np.linalg.norm(velocity[:, :2], axis=1)
    speed = derived * np.where((along * velocity).sum(axis=1) < -1e-9, -1.0, 1.0)
    width, logged = width[:, None], along * track.speed[:, None]
    ends, reason = (width * logged[:-1], width * logged[1:]), ""
    if not np.isfinite(track.speed).all():
        reason = "were not logged with every pose"
    elif trusted:
        position, speed, velocity = track.position, track.speed, logged
        heading = _with_whole_turns(track, *ends, heading)
    else:
        reckoned = np.concatenate([np.zeros((1, 3)), np.cumsum(_driven(*ends, np.diff(heading)), axis=0)])
        away = track.position - reckoned
        rest, drift, error = _smoothed(track.time, away, noise_of(track.time, away[:, :2]), edges, logged)
        counts = np.repeat(np.diff(edges) >= _FEWEST, np.diff(edges))
        if _contradict(track.speed[counts], derived[counts], np.linalg.norm(drift, axis=1)[counts], error):
            reason = "do not match the poses"
        else:
            position, speed, velocity = reckoned + rest, track.speed, logged
    whole = Track(track.time, position, heading, speed)
    return Motion(whole, velocity, known, jumps, reason, has_headings)


def _driven(begin: np.ndarray, end: np.ndarray, turn: np.ndarray, share: Any = 1.0) -> np.ndarray:
    """Return the ways (M, 3) within shares of steps [m], by Gauss-Legendre quadrature of the velocity.

    Args:
        begin: (M, 3) velocities at the beginning, in distances of a step [m].
        end: (M, 3) velocities at the end [m]; the velocity changes evenly from one to the other, while it turns.
        turn: (M,) angles by which the heading turns in a step [rad].
        share: Shares (M,) of the steps, by default all of each.
    """
    first, last = begin[:, 0] + 1j * begin[:, 1], (end[:, 0] + 1j * end[:, 1]) * np.exp(-1j * turn)
    plane: Any = 0.0
    for node, weight in zip(*np.polynomial.legendre.leggauss(10), strict=True):
        at = share * (1 + node) / 2
        plane = plane + weight / 2 * share * np.exp(1j * at * turn) * ((1 - at) * first + at * last)
    height = share * (begin[:, 2] + share / 2 * (end[:, 2] - begin[:, 2]))
    return np.column_stack([plane.real, plane.imag, height])


def _with_whole_turns(track: Track, begin: np.ndarray, end: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Return headings (K,) with up to two whole turns between two poses whose way cannot be driven without them.

    The velocities (K - 1, 3) at both ends are those of `_driven`.
    """
    turn, way, counts = np.diff(heading), np.diff(track.position, axis=0), np.array([0, 1, -1, 2, -2])
    driven = [_driven(begin, end, turn + 2 * np.pi * count) for count in counts]
    length = (np.linalg.norm(begin, axis=1) + np.linalg.norm(end, axis=1)) / 2
    missed = np.linalg.norm(way - driven, axis=2) / np.maximum(length, 1e-12)
    turned = (missed[0] > _STOPS) & (missed.min(axis=0) < _WITH_TURNS)
    return heading + 2 * np.pi * np.append(0, np.cumsum(turned * counts[missed.argmin(axis=0)]))


def _contradict(logged: np.ndarray, derived: np.ndarray, drift: np.ndarray, error: float) -> bool:
    """Return whether the logged speeds of a robot are impossible, or do not lead from pose to pose.

    Args:
        logged: (K,) logged speeds [m/s].
        derived: (K,) speeds of the poses [m/s].
        drift: (K,) speeds of the poses from the ways at the logged speeds and headings [m/s].
        error: Standard deviation of these speeds [m/s].
    """
    if (np.abs(logged) > 4 * derived.max(initial=0) + 1e-3).any():
        return True
    moving = derived > np.maximum(_NOISY * error, 0.1 * np.quantile(derived, 0.9) if len(derived) else 0.0)
    least = np.maximum(_NOISY * error, 0.5 * np.maximum(derived, np.median(derived[moving]) if moving.any() else 0.0))
    return bool((moving & (drift > least)).sum() > _CONTRADICTING * moving.sum())


def _smoothed(
    time: np.ndarray, place: np.ndarray, noise: float, edges: np.ndarray, velocity: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the smoothed places (K, 3) of each stretch between two edges [m], their slopes, and the slopes' error.

    The time constant is the least for which slopes are precise. Where that moves the places by more than their noise,
    which was no noise but motion, it is shorter.

    Args:
        time: (K,) times [s].
        place: (K, 3) places [m].
        noise: Standard deviation of the places [m].
        edges: First places of the stretches, and K.
        velocity: (K, 3) velocities of the robot [m/s], by default the slopes.
    """
    period = (time[edges[1:] - 1] - time[edges[:-1]]).sum() / len(time)
    shortest = _SHORTEST * period
    constant = max(_LONGEST, shortest)
    while True:
        stretches = [_spline(time[a:b], place[a:b], constant) for a, b in pairwise(edges.tolist())]
        smooth, slope = (np.concatenate(parts) for parts in zip(*stretches, strict=True))
        # The integral of (w / (1 + (w T)^6))^2 over frequencies w > 0 is pi / (12 T^3), for a time constant T.
        error = noise * math.sqrt(period / 12) / max(constant, 1e-12) ** 1.5
        if constant <= shortest:
            return place, slope, error
        speed = np.quantile(np.linalg.norm(slope if velocity is None else velocity, axis=1), 0.75)
        factor = float(error / max(_PRECISE * speed, 1e-12)) ** (2 / 3)
        if np.quantile(np.linalg.norm((smooth - place)[:, :2], axis=1), 0.9) > _CLOSE * noise:
            factor = min(factor, _SHORTER)
        if factor > _SHORTER:
            return smooth, slope, error
        constant = max(factor * constant, shortest)


def _spline(time: np.ndarray, place: np.ndarray, constant: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the values and slopes (K, 3) of a cubic spline along some poses, smoothed with a time constant T [s].

    Changes of third order of its coefficients are penalised (a P-spline), so that a motion of frequency w becomes
    1 / (1 + (w T)^6) of itself. Within 2 T and a piece of an end, no slope exceeds the nearest between both ends.
    """
    k = len(time)
    if k < 3:
        return place, np.gradient(place, time, axis=0) if k > 1 else np.zeros_like(place)
    lasts = np.ptp(time)
    constant = max(constant, _SHORTEST * lasts / (k - 1))
    pieces = min(k - 1, math.ceil(_PIECES * lasts / constant))
    knots, at = np.arange(-3.0, pieces + 4), np.clip((time - time[0]) / lasts, 0, 1) * pieces
    base, lag = BSpline.design_matrix(at, knots, 3), constant / lasts * pieces
    change: Any = sparse.eye_array(pieces + 3, format="csr")
    for _ in range(3):
        change = change[1:] - change[:-1]
    normal = base.T @ base + lag**6 * (k - 1) / pieces * (change.T @ change)
    spline = BSpline(knots, spsolve(normal.tocsc(), base.T @ (place - place[0])), 3)
    slope, end = spline.derivative()(at) * pieces / lasts, min(2 * lag + 1, pieces / 2)
    length = np.linalg.norm(slope, axis=1)
    inner = np.clip(np.arange(k), np.searchsorted(at, end), np.searchsorted(at, pieces - end, side="right") - 1)
    return place[0] + spline(at), slope * np.minimum(1, length[inner] / np.maximum(length, 1e-12))[:, None]


def noise_of(time: np.ndarray, values: np.ndarray) -> float:
    """Return the standard deviation of values (K, C) over time [s] from cubics through their neighbours.

    It is that of normal noise of which as large a share as `_CALM` deviates as little as the same share of the values.
    """
    if len(time) < _FEWEST:
        return 0.0
    near = sliding_window_view(time, _FEWEST)
    weight = 1 / (near[:, :, None] - near[:, None, :] + np.eye(_FEWEST)).prod(axis=2)  # of fourth divided differences
    weight /= np.linalg.norm(weight, axis=1, keepdims=True)
    rest = np.einsum("kp,kcp->kc", weight, sliding_window_view(values, _FEWEST, axis=0))
    square = 2 * gammaincinv(values.shape[1] / 2, _CALM)  # quantile of the chi-squared distribution
    return math.sqrt(np.quantile((rest**2).sum(axis=1), _CALM) / square)
