"""Borkar et al.: [14] drive along the curve without feedback, [15] track a reference point for each robot.

[14] A. V. Borkar, A. Sinha, L. Vachhani, H. Arya, "Application of Lissajous curves in trajectory planning of multiple
agents", Autonomous Robots 44 (2020). Every robot goes along the curve with gamma' = omega, so its speed is the profile
V(gamma) = omega ||r'(gamma)||. It assumes that the robots start in the formation and that nothing disturbs them.

[15] A. V. Borkar et al., as the paper describes it: a distributed and robust tracking of reference points that are
computed in open loop and centrally. The planner places the references in the formation, each with the rate omega:

    gamma_ref(t) = gamma_ref(0) + omega t_on                 t_on: time for which the robot has worked [s]
    theta_i' = omega / alpha + k wrap(theta_ref - theta_i)   gamma = alpha theta, k = `tracking` [1/s]

with the second term held to [-omega / alpha, `catch_up` omega / alpha], so that a robot does not reverse to meet its
reference. gamma_ref(0) is the robot's position at the start of the episode, which is its place in the formation; a
start that is off it is off it for good.

What a failure does depends on the generator of the stopped robot. As `tracked-reference` it stops and resumes together
with its robot: Fig. 6(b) shows states that keep their offset after t_2, and Section V names "the desynchronization in
the reference point generation" as the reason. As `running-reference` it runs on (t_on is the time of the episode) and
is caught up with: the configuration is recovered, which it is not in the figure, by robots that pass through the places
of others.

No message is used. Disturbances of the tracking are corrected, which `open-loop` does not.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.base import clear_worlds
from baselines.policies.coordinators.base import Coordinator
from baselines.policies.own_row import own_phase, own_works
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, flag, number

wp.set_module_options(OPTIONS)


class OpenLoop(Coordinator):
    """Coordinator: the phase rate of every robot is omega / alpha."""

    communicates = "nothing"

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any):
        super().__init__(scenario, num_worlds, device)
        self.phase_rate.fill_(self.natural_rate)

    def coordinate(self, observation: wp.array) -> None:
        """Leave `phase_rate` as it is."""


@dataclass(frozen=True)
class ReferenceParameters(Checked):
    """Parameters of the coordinator, besides the scenario."""

    runs_on: bool = flag(False)
    """True for a reference that moves on while its robot has failed."""
    tracking: float | None = number(None, 1e-9, 1e6, "1/s")
    """k, the rate at which a robot makes up for its distance from the reference [1/s]; None is omega / (0.3 rad)."""
    catch_up: float = number(1.0, 0, 1e6)
    """Most that a robot adds to its rate to catch up, as a multiple of omega / alpha."""


RUNNING = ReferenceParameters(runs_on=True, catch_up=1.5)
"""Parameters of `running-reference`: cars under MPCC catch up soonest with them; larger ones make cars leave the
curve."""


@wp.kernel
def track_reference(
    rate: float,
    step: float,
    runs_on: bool,
    tracking: float,
    most: float,
    memory: wp.array2d(dtype=wp.vec2),
    observation: wp.array3d(dtype=float),
    phase_rate_out: wp.array2d(dtype=float),
):
    """Return theta_i' = rate + clip(tracking wrap(theta_ref - theta_i)) to [-rate, most], for robot i of world w.

    A robot's memory is the phase of its reference at the start [rad] and, plus one, the steps that this has moved.
    """
    w, i = wp.tid()
    phase = own_phase(w, i, observation)
    known = memory[w, i]
    if known[1] == 0.0:
        known = wp.vec2(phase, 1.0)
    elif runs_on or own_works(w, i, observation):
        known = wp.vec2(known[0], known[1] + 1.0)
    memory[w, i] = known
    behind = wrap(known[0] + rate * step * (known[1] - 1.0) - phase)
    phase_rate_out[w, i] = rate + wp.clamp(tracking * behind, -rate, most)


class TrackedReference(Coordinator):
    """Coordinator: phase rates (W, N) [rad/s] by which each robot tracks its own reference point."""

    kernel = track_reference
    communicates = "nothing"

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any, parameters: ReferenceParameters | None = None):
        super().__init__(scenario, num_worlds, device)
        self.parameters = parameters or ReferenceParameters()
        rate, tracking = self.natural_rate, self.parameters.tracking or 1 / scenario.time_unit
        self._memory = wp.zeros(self.phase_rate.shape, dtype=wp.vec2, device=device)
        most = self.parameters.catch_up * rate
        self.inputs = [rate, scenario.task.step, self.parameters.runs_on, tracking, most, self._memory]

    def forget(self, mask: np.ndarray) -> None:
        """Reset the references of the worlds in a mask (W,)."""
        clear_worlds(self._memory, mask)
