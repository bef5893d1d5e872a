"""Yao et al. [16], the coordination: linear consensus on the path parameter, with a prescribed spacing.

W. Yao, H. Garcia de Marina, Z. Sun, M. Cao, "Guiding vector fields for the distributed motion coordination of mobile
robots", IEEE Transactions on Robotics 39 (2023). The path parameter of robot i follows those of its ring neighbours,

    theta_i' = omega / alpha + k_c sum over j in R_i of (theta_j - theta_i - Delta_ij)

with Delta_ij = +-2 pi p / N, the phase of the neighbour after and before it in equilibrium (2), and k_c the scenario's
`coupling` [1/s]. So every robot requires N and p, and another configuration requires another Delta; any p is stable,
where (1) has only those of Theorem 1. `baselines.policies.trackers.vector_field` makes a car follow the parameter.

The parameter of the reference is a real number; here the robots measure only phases, and a deviation is wrapped to
[-pi, pi]. Two neighbours that are more than half a lap off their spacing therefore pull the other way around.
"""

import math
from typing import Any

import warp as wp

from baselines.policies.coordinators.base import Coordinator
from baselines.policies.own_row import hears, lead, message_age
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap
from lissajous_env.parameters.scenario import Scenario

wp.set_module_options(OPTIONS)


@wp.kernel
def consensus_rates(
    rate: float,
    gain: float,
    spacing: float,
    age_unit: float,
    observation: wp.array3d(dtype=float),
    phase_rate_out: wp.array2d(dtype=float),
):
    """Return theta_i' = rate + gain sum_j wrap(theta_j - theta_i - Delta_ij), for robot i of world w.

    `spacing` is Delta of the neighbour after robot i [rad]; a neighbour's phase is carried on at `rate` [rad/s] for the
    time its message was under way.
    """
    w, i = wp.tid()
    off = float(0.0)
    for side in range(2):
        if hears(w, i, side, observation):
            ahead = lead(w, i, side, observation) + rate * message_age(w, i, side, age_unit, observation)
            off += wrap(ahead - wp.where(side == 0, -spacing, spacing))
    phase_rate_out[w, i] = rate + gain * off


class Consensus(Coordinator):
    """Coordinator: phase rates (W, N) [rad/s] by linear consensus towards equilibrium (2) of known N and p."""

    kernel = consensus_rates

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any):
        super().__init__(scenario, num_worlds, device)
        spacing = 2 * math.pi * scenario.p / scenario.num_robots
        self.inputs = [self.natural_rate, scenario.coupling, spacing, scenario.time_unit]
