"""The paper's coordination with the phase measured by arc length, so that robots go at a constant ground speed."""

import math
from typing import Any

import numpy as np
import warp as wp

from baselines.consensus import hears, lead, message_age
from baselines.observed import own_phase
from lissajous_env import theory
from lissajous_env.compilation import OPTIONS
from lissajous_env.curve import CurveStruct, tangent2
from lissajous_env.scenario import Curve, Scenario
from lissajous_env.structs import to_struct

wp.set_module_options(OPTIONS)

TURN = wp.constant(2.0 * math.pi)


@wp.func
def interpolate(table: wp.array(dtype=float), angle: float) -> float:
    """Value at an angle [rad] of a periodic function that is tabulated over one turn."""
    n = table.shape[0]
    x = angle / TURN * float(n)
    cell = wp.floor(x)
    k = ((int(cell) % n) + n) % n
    low = table[k]
    return low + (x - cell) * (table[(k + 1) % n] - low)


@wp.func
def to_arc(ahead: wp.array(dtype=float), gamma: float) -> float:
    return gamma + interpolate(ahead, gamma)


@wp.kernel
def kuramoto_by_arc(
    curve: CurveStruct,
    alpha: float,
    rate: float,
    coupling: float,
    preview: float,
    length: float,
    ahead: wp.array(dtype=float),
    behind: wp.array(dtype=float),
    observation: wp.array3d(dtype=float),
    phase_rate_out: wp.array2d(dtype=float),
):
    w, i = wp.tid()
    theta = own_phase(w, i, observation)
    gamma = alpha * theta
    own = to_arc(ahead, gamma)
    pull = float(0.0)
    for side in range(2):
        if hears(w, i, side, observation):
            other = to_arc(ahead, alpha * (theta + lead(w, i, side, observation)))
            pull += wp.sin((other - own) / alpha + rate * message_age(w, i, side, observation))
    arc_rate = alpha * (rate - coupling * pull)
    if preview <= 0.0:
        phase_rate_out[w, i] = arc_rate * length / (TURN * wp.length(tangent2(curve, gamma))) / alpha
    else:
        there = own + arc_rate * preview
        phase_rate_out[w, i] = (there + interpolate(behind, there) - gamma) / (preview * alpha)


def arc_tables(curve: Curve) -> tuple[np.ndarray, np.ndarray, float]:
    count = 512 << (max(curve.a, curve.b) - 1).bit_length()
    gamma = 2 * math.pi * np.arange(count + 1) / count
    # Simpson's rule in each cell.
    middle = theory.curve_speed(curve, gamma[:-1] + math.pi / count)
    ends = theory.curve_speed(curve, gamma)
    cells = (ends[:-1] + 4 * middle + ends[1:]) / 6 * (2 * math.pi / count)
    s = np.concatenate([[0.0], np.cumsum(cells)])
    length = s[-1]
    arc = 2 * math.pi * s / length
    inverse = np.interp(gamma, arc, gamma)
    return (arc - gamma)[:-1], (inverse - gamma)[:-1], float(length)


PREVIEW = 0.5
SPEED = None


def ground_speed(scenario: Scenario) -> float:
    if SPEED is not None:
        return SPEED
    length = arc_tables(scenario.curve)[2]
    return scenario.formation.phase_rate * length / (2 * math.pi)


class KuramotoByArc:
    def __init__(self, scenario: Scenario, num_worlds: int, device: Any):
        ahead, behind, self._length = arc_tables(scenario.curve)
        self._curve = to_struct(CurveStruct, scenario.curve)
        self._alpha = float(scenario.alpha)
        self._rate = 2 * math.pi * ground_speed(scenario) / (self._length * scenario.alpha)
        self._coupling = scenario.formation.coupling
        self._ahead = wp.array(ahead, dtype=wp.float32, device=device)
        self._behind = wp.array(behind, dtype=wp.float32, device=device)
        self.phase_rate = wp.zeros((num_worlds, scenario.num_robots), dtype=wp.float32, device=device)

    def coordinate(self, observation: wp.array) -> None:
        inputs = [self._curve, self._alpha, self._rate, self._coupling, PREVIEW, self._length, self._ahead,
                  self._behind, observation]  # fmt: skip
        outputs = [self.phase_rate]
        wp.launch(kuramoto_by_arc, self.phase_rate.shape, inputs, outputs=outputs, device=self.phase_rate.device)
