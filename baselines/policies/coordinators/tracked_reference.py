"""Borkar et al. [15]: every robot tracks its own reference point, and the points are generated in open loop.

A. V. Borkar et al., as the paper describes it: a distributed and robust tracking of reference points that are computed
in open loop and centrally. The planner places the references in the formation, each with the rate omega:

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
from baselines.policies.own_row import own_phase, own_works
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap
from lissajous_env.device.program import launcher
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, flag, number

wp.set_module_options(OPTIONS)


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


class TrackedReference:
    """Coordinator: phase rates (W, N) [rad/s] by which each robot tracks its own reference point."""

    communicates = "nothing"

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any, parameters: ReferenceParameters | None = None):
        shape = (num_worlds, scenario.num_robots)
        self._parameters = parameters or ReferenceParameters()
        self._tracking = self._parameters.tracking or 1 / scenario.time_unit
        self._rate, self._step = scenario.formation.phase_rate / scenario.alpha, scenario.task.step
        self._memory = wp.zeros(shape, dtype=wp.vec2, device=device)
        self.phase_rate = wp.zeros(shape, dtype=wp.float32, device=device)
        self._launch = launcher(device)

    def coordinate(self, observation: wp.array) -> None:
        """Write `phase_rate`."""
        given = self._parameters
        inputs = [self._rate, self._step, given.runs_on, self._tracking, given.catch_up * self._rate]
        inputs += [self._memory, observation]
        self._launch(track_reference, self.phase_rate.shape, inputs, [self.phase_rate])

    def forget(self, mask: np.ndarray) -> None:
        """Reset the references of the worlds in a mask (W,)."""
        clear_worlds(self._memory, mask)
