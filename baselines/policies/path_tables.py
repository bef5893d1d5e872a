"""Tables of timed paths: places of robots at each control step, with the heading, speed and inputs that follow.

A timed path is a lead-in of L control steps, driven once, and a loop of K control steps, driven for ever: t control
steps after the reset a robot is to be at `lead_in[t]`, or at `loop[(t - L) % K]` from step L on. Tables are made in
float64 on the host. Velocity and acceleration are those of a quintic spline through the places, one a control step.
"""

from dataclasses import dataclass

import numpy as np

from lissajous_env.parameters.scenario import Scenario

FINE = 4
"""Samples of a table in a control step, between which a car's place on its path is interpolated."""
_REACH = 16
"""Places beyond the ends of a part that its spline is fitted through; their influence fades by 0.43 a place."""


@dataclass(frozen=True)
class PathTables:
    """Timed paths of N robots in P variants, at FINE samples in a control step: first the lead-in, then the loop."""

    pose: np.ndarray
    """(P, N, M, 4) x, y [m], heading [rad], speed [m/s], where M = FINE (L + K)."""
    feedforward: np.ndarray
    """(P, N, M, 2) mean curvature [1/m] and mean acceleration [m/s^2] over the control step that begins there."""
    lead_in_steps: int
    """L [control steps]."""
    loop_steps: int
    """K [control steps]."""
    filtered_until: float = 0.0
    """Duration of the collision filter, for cars that do not know where the others start [control step]."""

    def places(self, steps: int) -> np.ndarray:
        """Return the places (P, N, steps + 1, 2) of the robots at the control steps from 0 to `steps` [m]."""
        t, begin = np.arange(steps + 1), self.lead_in_steps
        sample = FINE * np.where(t < begin, t, begin + (t - begin) % self.loop_steps)
        return self.pose[:, :, sample, :2]


def path_tables(
    scenario: Scenario, loop: np.ndarray, lead_in: np.ndarray | None = None, filtered_until: float = 0.0
) -> PathTables:
    """Return the tables of timed paths; one lead-in, or one loop, for all of several variants of the other is enough.

    Args:
        scenario: Scenario, for the duration of a control step.
        loop: (N, K, 2) or (P, N, K, 2) places on the loops, one a control step [m]; the first follows on the last.
        lead_in: (N, L, 2) or (P, N, L, 2) places before the loop, the first at the start of the episode [m]; none by
            default. `loop[..., 0, :]` follows on its last place.
        filtered_until: Duration of the collision filter [control step].
    """
    before = loop[..., :0, :] if lead_in is None else lead_in
    paths = np.broadcast_shapes((1, 1), loop.shape[:-2], before.shape[:-2])
    loop, before = (np.broadcast_to(part, (*paths, *part.shape[-2:])) for part in (loop, before))
    begin, steps, step = before.shape[2], loop.shape[2], scenario.task.step
    around = loop[:, :, np.arange(-_REACH, steps + _REACH + 1) % steps]
    onward = around[:, :, _REACH : 2 * _REACH + 1]
    parts = _sampled(np.concatenate([before, onward], axis=2), 0, begin), _sampled(around, _REACH, steps)
    places, velocity = (np.concatenate(arrays, axis=2) for arrays in zip(*parts, strict=True))
    velocity /= step
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    heading = np.arctan2(velocity[..., 1], velocity[..., 0])
    size, first = places.shape[2], FINE * begin
    whole = np.arange(size + FINE)  # a control step beyond the end, which continues at the start of the loop
    whole = np.where(whole < size, whole, first + (whole - first) % (FINE * steps))
    turn = np.diff(heading[:, :, whole], axis=2)
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    way = 0.5 * (speed[:, :, whole[1:]] + speed[:, :, whole[:-1]]) * (step / FINE)
    # of successive pieces, the sum over a control step
    turn, way = (np.sum([pieces[:, :, k : k + size] for k in range(FINE)], axis=0) for pieces in (turn, way))
    curvature = np.divide(turn, way, out=np.zeros_like(turn), where=way > 0)
    acceleration = (speed[:, :, whole[FINE:]] - speed) / step
    pose = np.concatenate([places, heading[..., None], speed[..., None]], axis=-1)
    return PathTables(pose, np.stack([curvature, acceleration], axis=-1), begin, steps, filtered_until)


def _sampled(places: np.ndarray, before: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return places [m] and velocities [m/step] at the fine samples of `count` steps, after `before` steps."""
    from scipy.interpolate import make_interp_spline  # slow to import

    spline = make_interp_spline(np.arange(places.shape[2]), places, k=5, axis=2)
    at = before + np.arange(FINE * count) / FINE
    return spline(at), spline(at, 1)
