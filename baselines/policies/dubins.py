"""Shortest paths of bounded curvature between two poses, in NumPy, for many pairs at once.

Such a path is made of arcs of the smallest radius and straight lines: L. E. Dubins, "On curves of minimal length with a
constraint on average curvature, and with prescribed initial and terminal positions and tangents", American Journal of
Mathematics 79 (1957).
"""

import numpy as np

WORDS = ("LSL", "RSR", "LSR", "RSL", "RLR", "LRL")
"""Kinds of paths: left turn, straight line, right turn."""
TURNS = np.array([[{"L": 1.0, "S": 0.0, "R": -1.0}[letter] for letter in word] for word in WORDS])
"""(6, 3) direction of each piece of each kind: 1 to the left, 0 straight on, -1 to the right."""


def dubins_lengths(start: np.ndarray, end: np.ndarray, radius: float) -> np.ndarray:
    """Return the lengths (..., 6, 3) of the three pieces of each kind of path; NaN where there is none [m].

    Args:
        start: (..., 3) x, y [m] and heading [rad] of the start.
        end: (..., 3) x, y [m] and heading [rad] of the end; broadcasts with `start`.
        radius: Smallest radius of a turn [m].
    """
    start, end = np.broadcast_arrays(start, end)
    pieces = np.full((*start.shape[:-1], len(WORDS), 3), np.nan)
    for k, word in enumerate(WORDS):
        first, _, last = TURNS[k]
        # Centres of the first and the last turn.
        away = _centre(end, last, radius) - _centre(start, first, radius)
        distance, bearing = np.hypot(away[..., 0], away[..., 1]), np.arctan2(away[..., 1], away[..., 0])
        with np.errstate(invalid="ignore", divide="ignore"):
            if word[1] != "S":
                # The middle turn touches both others, so its centre is 2 radii from theirs.
                lean = np.arccos(distance / (4 * radius))
                # Headings at both ends of the middle turn, tangents of the circles where they touch.
                leaves = bearing + first * (np.pi / 2 - lean)
                enters = bearing + first * (np.pi / 2 + lean) + np.pi
                straight = radius * _turned(-first * (enters - leaves))
            elif first == last:
                leaves = enters = bearing
                straight = distance
            else:
                straight = np.sqrt(distance**2 - 4 * radius**2)
                leaves = enters = bearing + first * np.arcsin(2 * radius / distance)
        pieces[..., k, 0] = radius * _turned(first * (leaves - start[..., 2]))
        pieces[..., k, 1] = straight
        pieces[..., k, 2] = radius * _turned(last * (end[..., 2] - enters))
    return pieces


def dubins_poses(
    start: np.ndarray, pieces: np.ndarray, turns: np.ndarray, radius: np.ndarray, along: np.ndarray
) -> np.ndarray:
    """Return x, y [m] and heading [rad] (..., M, 3) on paths at some distances; beyond its end a path goes straight on.

    Args:
        start: (..., 3) x, y [m] and heading [rad] of the starts.
        pieces: (..., 3) lengths of the pieces [m].
        turns: (..., 3) directions of the pieces, rows of `TURNS`.
        radius: (...) radii of the turns [m].
        along: (..., M) distances from the start [m].
    """
    place, heading, left = start[..., None, :2], start[..., None, 2], along
    for k in range(4):
        length, turn = (pieces[..., k, None], turns[..., k, None]) if k < 3 else (np.inf, 0.0)
        gone = np.clip(left, 0, length)
        left = left - gone
        turned = turn * gone / radius[..., None]
        chord = (gone * np.sinc(turned / (2 * np.pi)))[..., None]
        middle = heading + turned / 2
        place = place + chord * np.stack([np.cos(middle), np.sin(middle)], axis=-1)
        heading = heading + turned
    return np.concatenate([place, heading[..., None]], axis=-1)


def dubins_reach(start: np.ndarray, pieces: np.ndarray, turns: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return the largest |x| and |y| (..., 2) on paths of finite pieces [m].

    Args:
        start: (..., 3) x, y [m] and heading [rad] of the starts.
        pieces: (..., 3) lengths of the pieces [m].
        turns: (..., 3) directions of the pieces, rows of `TURNS`.
        radius: (...) radii of the turns [m].
    """
    place, heading = start[..., :2], start[..., 2]
    reach = np.abs(place)
    for k in range(3):
        length, turn, wide = pieces[..., k, None], turns[..., k, None], radius[..., None]
        # An arc is farthest out at its ends, or where it is parallel to an axis.
        until = wide * _turned(turn * (np.arange(4) * np.pi / 2 - heading[..., None]))
        gone = np.concatenate([np.minimum(until, length), length], axis=-1)
        turned = turn * gone / wide
        middle = heading[..., None] + turned / 2
        chord = (gone * np.sinc(turned / (2 * np.pi)))[..., None]
        passed = place[..., None, :] + chord * np.stack([np.cos(middle), np.sin(middle)], axis=-1)
        reach = np.maximum(reach, np.abs(passed).max(axis=-2))
        place, heading = passed[..., -1, :], heading + turned[..., -1]
    return reach


def _centre(pose: np.ndarray, side: float, radius: float) -> np.ndarray:
    """Return the centre of a turn to a side (1 left, -1 right) of a pose [m]."""
    normal = np.stack([-np.sin(pose[..., 2]), np.cos(pose[..., 2])], axis=-1)
    return pose[..., :2] + side * radius * normal


def _turned(angle: np.ndarray) -> np.ndarray:
    """Return an angle in [0, 2 pi), 0 for one that is a whole turn but for rounding."""
    turned = np.mod(angle, 2 * np.pi)
    return np.where(turned > 2 * np.pi - 1e-9, 0.0, turned)
