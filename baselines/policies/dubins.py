"""Shortest paths of bounded curvature between two poses, in NumPy, for many pairs at once.

Such a path is made of arcs of the smallest radius and straight lines: L. E. Dubins, "On curves of minimal length with a
constraint on average curvature, and with prescribed initial and terminal positions and tangents", American Journal of
Mathematics 79 (1957).
"""

import numpy as np

WORDS = ("LSL", "RSR", "LSR", "RSL", "RLR", "LRL")
"""Kinds of paths: left turn, straight line, right turn."""
_TURN = {"L": 1.0, "S": 0.0, "R": -1.0}


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
        first, last = _TURN[word[0]], _TURN[word[2]]
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


def dubins_places(start: np.ndarray, pieces: np.ndarray, word: int, radius: float, along: np.ndarray) -> np.ndarray:
    """Return the places (M, 2) of a path at some distances from its start [m].

    Args:
        start: x, y [m] and heading [rad] of the start.
        pieces: Lengths of its three pieces [m].
        word: Kind of the path, a place in `WORDS`.
        radius: Radius of the turns [m].
        along: (M,) distances [m].
    """
    places = np.empty((len(along), 2))
    (x, y, heading), done = start, 0.0
    for letter, piece in zip(WORDS[word], pieces, strict=True):
        inside = along >= done
        way = np.clip(along[inside] - done, 0, piece)
        ends = np.append(way, piece)
        turn = _TURN[letter] * ends / radius
        if letter == "S":
            moved = np.column_stack([ends * np.cos(heading), ends * np.sin(heading)])
        else:
            side = _TURN[letter] * radius
            moved = side * np.column_stack(
                [np.sin(heading + turn) - np.sin(heading), np.cos(heading) - np.cos(heading + turn)]
            )
        places[inside] = moved[:-1] + np.array([x, y])
        x, y, heading, done = x + moved[-1, 0], y + moved[-1, 1], heading + turn[-1], done + piece
    return places


def _centre(pose: np.ndarray, side: float, radius: float) -> np.ndarray:
    """Return the centre of a turn to a side (1 left, -1 right) of a pose [m]."""
    normal = np.stack([-np.sin(pose[..., 2]), np.cos(pose[..., 2])], axis=-1)
    return pose[..., :2] + side * radius * normal


def _turned(angle: np.ndarray) -> np.ndarray:
    """Return an angle in [0, 2 pi), 0 for one that is a whole turn but for rounding."""
    turned = np.mod(angle, 2 * np.pi)
    return np.where(turned > 2 * np.pi - 1e-9, 0.0, turned)
