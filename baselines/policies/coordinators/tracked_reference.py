"""Borkar et al. [15]: every robot tracks its own reference point, and the points are generated in open loop.

A. V. Borkar et al., as the paper describes it: a distributed and robust tracking of reference points that are computed
in open loop and centrally. The planner places the references in the formation and gives each the rate omega:

    gamma_ref(t) = gamma_ref(0) + omega t_on                 t_on: time for which the robot has worked [s]
    theta_i' = omega / alpha + k wrap(theta_ref - theta_i)   gamma = alpha theta, k = TRACKING [1/s]

with the second term held to [-omega / alpha, omega / alpha], so that a robot neither reverses nor goes at more than
twice the formation's rate to meet its reference. gamma_ref(0) is where the robot stands when the episode begins, which
is its place in the formation; a start that is off it is off it for good.

What comes in between depends on what the generator of a stopped robot does. It is taken to stop with its robot and to
go on with it: Fig. 6(b) shows states that keep their offset after t_2, and Section V names "the desynchronization in
the reference point generation" as the reason. A reference that had run on would be caught up with by the tracking law
above, and the configuration would be recovered, as it is not in the figure.

No message is used. Disturbances of the tracking are corrected, which `open-loop` does not; failures are not.
"""

from typing import Any

import numpy as np
import warp as wp

from baselines.policies.memory import clear_worlds
from baselines.policies.own_row import own_phase, own_works
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap
from lissajous_env.device.program import launcher
from lissajous_env.parameters.scenario import Scenario

wp.set_module_options(OPTIONS)

TRACKING = 1.0
"""k, the rate at which a robot makes up for its distance from the reference [1/s]."""


@wp.kernel
def track_reference(
    rate: float,
    step: float,
    tracking: float,
    memory: wp.array2d(dtype=wp.vec2),
    observation: wp.array3d(dtype=float),
    phase_rate_out: wp.array2d(dtype=float),
):
    """theta_i' = rate + clip(tracking wrap(theta_ref - theta_i)), for robot i of world w.

    A robot's memory is the phase of its reference at the start [rad] and, plus one, the steps that it has worked.
    """
    w, i = wp.tid()
    phase = own_phase(w, i, observation)
    known = memory[w, i]
    if known[1] == 0.0:
        known = wp.vec2(phase, 1.0)
    elif own_works(w, i, observation):
        known = wp.vec2(known[0], known[1] + 1.0)
    memory[w, i] = known
    behind = wrap(known[0] + rate * step * (known[1] - 1.0) - phase)
    phase_rate_out[w, i] = rate + wp.clamp(tracking * behind, -rate, rate)


class TrackedReference:
    """Coordinator: phase rates (W, N) [rad/s] that keep each robot on its own reference point."""

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any):
        shape = (num_worlds, scenario.num_robots)
        self._rate, self._step = scenario.formation.phase_rate / scenario.alpha, scenario.task.step
        self._memory = wp.zeros(shape, dtype=wp.vec2, device=device)
        self.phase_rate = wp.zeros(shape, dtype=wp.float32, device=device)
        self._launch = launcher(device)

    def coordinate(self, observation: wp.array) -> None:
        """Write `phase_rate`."""
        inputs = [self._rate, self._step, TRACKING, self._memory, observation]
        self._launch(track_reference, self.phase_rate.shape, inputs, [self.phase_rate])

    def forget(self, mask: np.ndarray) -> None:
        """Forget the references of the worlds in a mask (W,)."""
        clear_worlds(self._memory, mask)
