"""Yao et al. [16], the coordination: linear consensus on the path parameter, with the spacing given.
"""

import math
from typing import Any

import warp as wp

from lissajous_env.compilation import OPTIONS
from lissajous_env.curve import wrap
from lissajous_env.observation import LINK, OWN
from lissajous_env.scenario import Scenario

wp.set_module_options(OPTIONS)


@wp.func
def hears(w: int, i: int, side: int, observation: wp.array3d(dtype=float)) -> bool:
    """Whether a ring neighbour was heard within the last second."""
    start = OWN + LINK * side
    return observation[w, i, start] > 0.5 and observation[w, i, start + 1] < 1.0


@wp.func
def message_age(w: int, i: int, side: int, observation: wp.array3d(dtype=float)) -> float:
    """Time since a ring neighbour sent its message [s]."""
    return observation[w, i, OWN + LINK * side + 1]


@wp.func
def lead(w: int, i: int, side: int, observation: wp.array3d(dtype=float)) -> float:
    """Phase that a ring neighbour sent less one's own, theta_j - theta_i in [-pi, pi] [rad]."""
    start = OWN + LINK * side
    return wp.atan2(observation[w, i, start + 3], observation[w, i, start + 2])


@wp.kernel
def consensus(
    rate: float,
    gain: float,
    spacing: float,
    observation: wp.array3d(dtype=float),
    phase_rate_out: wp.array2d(dtype=float),
):
    w, i = wp.tid()
    off = float(0.0)
    for side in range(2):
        if hears(w, i, side, observation):
            wanted = spacing * (2.0 * float(side) - 1.0)
            ahead = lead(w, i, side, observation) + rate * message_age(w, i, side, observation)
            off += wrap(ahead - wanted)
    phase_rate_out[w, i] = rate + gain * off


class Consensus:
    def __init__(self, scenario: Scenario, num_worlds: int, device: Any):
        formation = scenario.formation
        self._rate, self._gain = formation.phase_rate / scenario.alpha, formation.coupling
        self._spacing = 2 * math.pi * scenario.p / scenario.num_robots
        self.phase_rate = wp.zeros((num_worlds, scenario.num_robots), dtype=wp.float32, device=device)

    def coordinate(self, observation: wp.array) -> None:
        """Write `phase_rate`."""
        inputs = [self._rate, self._gain, self._spacing, observation]
        wp.launch(consensus, self.phase_rate.shape, inputs, outputs=[self.phase_rate], device=self.phase_rate.device)
