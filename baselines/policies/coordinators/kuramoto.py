"""The paper's coordination: the time-inverted Kuramoto dynamics (1) on the phases of the ring neighbours."""

from typing import Any

import warp as wp

from baselines.policies.coordinators.base import Coordinator
from baselines.policies.own_row import sine_ahead
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.parameters.scenario import Scenario

wp.set_module_options(OPTIONS)


@wp.kernel
def kuramoto_rates(
    rate: float,
    coupling: float,
    age_unit: float,
    observation: wp.array3d(dtype=float),
    phase_rate_out: wp.array2d(dtype=float),
):
    """Return theta_i' = omega / alpha - K sum_j sin(theta_j - theta_i), equation (1), for robot i of world w."""
    w, i = wp.tid()
    pull = sine_ahead(w, i, 0, rate, age_unit, observation) + sine_ahead(w, i, 1, rate, age_unit, observation)
    phase_rate_out[w, i] = rate - coupling * pull


class Kuramoto(Coordinator):
    """Coordinator: phase rates (W, N) [rad/s] by (1).

    Differs from the paper: the natural rate is omega / alpha, so that with alpha of Lemma 2 the rate along the curve
    is still omega; and a neighbour's phase is carried on at that rate for the time its message was under way.
    """

    kernel = kuramoto_rates

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any):
        super().__init__(scenario, num_worlds, device)
        self.inputs = [self.natural_rate, scenario.coupling, scenario.time_unit]
