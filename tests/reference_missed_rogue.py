"""Faults of a missed rogue, found in float64 from the recorded tracks of the sensors: speed, walls, discs."""

import numpy as np

SLICES = 24
"""Moments of a sub-step at which a rogue's distance from the robots is computed."""


def fault_of(rogue):
    """Return the fault of a missed rogue in words, None if there is none."""
    played, path = rogue.played, rogue.path
    scenario, places = played.scenario, np.asarray(path.places, dtype=np.float32).astype(float)
    half = np.array([scenario.curve.half_width, scenario.curve.half_height])
    if (np.abs(places) > half * (1 + 1e-6)).any():
        return "it leaves the rectangle"
    moved = np.linalg.norm(np.diff(places, axis=0), axis=1).max(initial=0.0)
    if moved > scenario.rogue_speed * scenario.task.step + 1e-6 * half.sum():
        return f"it moves {moved} m in a step"
    edge = (np.abs(np.abs(places[0]) - half) < 1e-6 * half).any()
    if scenario.targets.entry == "boundary" and not edge:
        return "it does not appear on the boundary"
    if not (scenario.targets.count if path.appears_at == 0 else scenario.targets.arrival_rate):
        return f"no target appears in step {path.appears_at}"
    if nearest(played, path.appears_at, places[:1])[-1] < scenario.sensing_radius:
        return "it appears within a disc"
    for k in range(len(places) - 1):
        if nearest(played, path.appears_at + k + 1, places[k : k + 2]).min() < scenario.sensing_radius:
            return f"it is within a disc in step {path.appears_at + k + 1}"
    return None


def nearest(played, step, places):
    """Least distance from any working robot at equal shares of a step, of a rogue that moves straight [m]."""
    path = played.path[step, played.works[step]].astype(float)
    if not len(path):
        return np.array([np.inf])
    last = path.shape[1] - 1
    share = np.linspace(0, 1, SLICES * last + 1)
    low = np.minimum((share * last).astype(int), last - 1)
    along = (share * last - low)[None, :, None]
    robots = (1 - along) * path[:, low] + along * path[:, low + 1]
    rogue = places[0] + share[:, None] * (places[-1] - places[0])
    return np.linalg.norm(robots - rogue, axis=-1).min(axis=0)


def first_detection(played, path):
    """Return the time until a disc has the rogue [step], which waits after its path; None if none has until the end."""
    places = np.asarray(path.places, dtype=np.float32).astype(float)
    radius = played.scenario.sensing_radius
    for now in range(path.appears_at + 1, played.steps + 1):
        pair = [places[min(max(step - path.appears_at, 0), len(places) - 1)] for step in (now - 1, now)]
        away = nearest(played, now, np.array(pair))
        if away.min() < radius:
            return now - 1 + np.argmax(away < radius) / (len(away) - 1) - path.appears_at
    return None
