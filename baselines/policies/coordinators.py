"""Coordinators, which compute the phase rate of each robot in a Warp kernel or in NumPy.

`Kuramoto` is the paper's method, and `KuramotoByArc` measures its phase along the curve. `TrackedReference` and
`Consensus` are competing methods.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.base import parameters_for
from baselines.policies.loops import cruising_speed
from baselines.policies.memory import Remembering
from baselines.policies.own_row import Observation, Rows, hears, lead, message_age, own_phase, own_works, sine_ahead
from baselines.similarity import motion_scale
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap
from lissajous_env.device.devices import copy_in
from lissajous_env.device.program import launcher
from lissajous_env.parameters.scenario import Scenario, read_only
from lissajous_env.settings.checks import Checked, flag, number
from lissajous_env.theory.closed_forms import curve_speed
from lissajous_env.theory.geometry import curve_length, lap_phases

wp.set_module_options(OPTIONS)

PhaseRates = wp.array2d(dtype=float)
"""(W, N) phase rates of the robots [rad/s]."""
PHASES = "phases of ring neighbours"
"""Content of the messages of a coordinator without an attribute `communicates`."""


class Coordinator(Remembering):
    """Base class of coordinators, which decide phase rates from observations.

    A subclass sets `kernel`, whose arguments are `inputs`, the observation and the rates. A coordinator without this
    base class must have `phase_rate` and `coordinate`, and cannot have a memory, which nothing would reset.

    Attributes:
        scenario: The scenario, with every field filled in.
        num_worlds: Number of worlds W.
        natural_rate: omega / alpha, the phase rate of the formation [rad/s].
        phase_rate: (W, N) theta' of each robot from now on, on the device [rad/s].
    """

    kernel: Any

    Parameters: type[Checked] | None = None
    """Dataclass of its parameters; None for none."""

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any, parameters: Any = None):
        self.scenario, self.num_worlds = scenario.resolve(), num_worlds
        self.parameters = parameters or parameters_for(self.Parameters, self.scenario)
        self.natural_rate = scenario.formation.phase_rate / scenario.alpha
        self.phase_rate = wp.zeros((num_worlds, scenario.num_robots), dtype=wp.float32, device=device)
        self.inputs: list[Any] = []
        self._launch = launcher(device)

    def coordinate(self, observation: wp.array) -> None:
        """Write `phase_rate`."""
        self._launch(self.kernel, self.phase_rate.shape, [*self.inputs, observation], [self.phase_rate])


class NumpyCoordinator(Coordinator):
    """Base class of coordinators in NumPy; a subclass implements `rates`, and also `forget` if it has a memory.

        class Together(baselines.NumpyCoordinator):
            def rates(self, rows):
                return self.natural_rate + 0.1 * np.sin(rows.lead).sum(axis=-1)

    `baselines.with_tracker` returns a policy with the coordinator; `baselines.register_coordinator` registers one for
    each tracker. `self.scenario` has every field filled in, `self.natural_rate` is omega / alpha, the phase rate of the
    formation [rad/s].
    """

    def rates(self, rows: Rows) -> np.ndarray:
        """Return the phase rates theta' (W, N) of the robots until the next step [rad/s], given their rows."""
        raise NotImplementedError(f"{type(self).__name__} must have a method rates(rows) that returns phase rates")

    def coordinate(self, observation: wp.array) -> None:
        """Write `phase_rate`.

        Raises:
            ValueError: `rates` returned another shape, no numbers, or a number that is not finite.
        """
        name = f"rates of {type(self).__name__}"
        copy_in(name, self.rates(Rows(read_only(observation.numpy()), self.scenario)), self.phase_rate)
        rates = self.phase_rate.numpy()
        if not np.isfinite(rates).all():
            w, i = np.argwhere(~np.isfinite(rates))[0]
            raise ValueError(f"{name} must be finite [rad/s], got {rates[w, i]} for robot_{i} in world {w}")


@wp.kernel
def kuramoto_rates(rate: float, coupling: float, age_unit: float, observation: Observation, phase_rate_out: PhaseRates):
    """Write theta_i' = omega / alpha - K sum_j sin(theta_j - theta_i), equation (1), for robot i of world w."""
    w, i = wp.tid()
    pull = sine_ahead(w, i, 0, rate, age_unit, observation) + sine_ahead(w, i, 1, rate, age_unit, observation)
    phase_rate_out[w, i] = rate - coupling * pull


class Kuramoto(Coordinator):
    """Coordinator: phase rates (W, N) [rad/s] by (1).

    Differs from the paper: the natural rate is omega / alpha, so that with alpha of Lemma 2 the rate along the curve
    is still omega; and a neighbour's phase is extrapolated at that rate over the age of its message.
    """

    kernel = kuramoto_rates

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any):
        super().__init__(scenario, num_worlds, device)
        self.inputs = [self.natural_rate, scenario.coupling, scenario.time_unit]


@wp.kernel
def consensus_rates(
    rate: float, gain: float, spacing: float, age_unit: float, observation: Observation, phase_rate_out: PhaseRates
):
    """Write theta_i' = rate + gain sum_j wrap(theta_j - theta_i - Delta_ij), for robot i of world w.

    `spacing` is Delta of the neighbour after robot i [rad]; a neighbour's phase is extrapolated at `rate` [rad/s]
    over the age of its message.
    """
    w, i = wp.tid()
    off = float(0.0)
    for side in range(2):
        if hears(w, i, side, observation):
            ahead = lead(w, i, side, observation) + rate * message_age(w, i, side, age_unit, observation)
            off += wrap(ahead - wp.where(side == 0, -spacing, spacing))
    phase_rate_out[w, i] = rate + gain * off


class Consensus(Coordinator):
    """Coordinator: linear consensus on the path parameter, with a prescribed spacing: Yao et al. [16].

    W. Yao, H. Garcia de Marina, Z. Sun, M. Cao, "Guiding vector fields for the distributed motion coordination of
    mobile robots", IEEE Transactions on Robotics 39 (2023). The path parameter of robot i follows those of its ring
    neighbours,

        theta_i' = omega / alpha + k_c sum over j in R_i of (theta_j - theta_i - Delta_ij)

    with Delta_ij = +-2 pi p / N, the phase of the neighbour after and before it in equilibrium (2), and k_c the
    scenario's `coupling` [1/s]. So every robot requires N and p, and another configuration requires another Delta; any
    p is stable, where (1) has only those of Theorem 1. `baselines.policies.trackers` makes a car follow the
    parameter.

    The parameter of the reference is a real number; here the robots measure only phases, and a deviation is wrapped to
    [-pi, pi]. Two neighbours that are more than half a lap off their spacing therefore pull the other way around.
    """

    kernel = consensus_rates

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any):
        super().__init__(scenario, num_worlds, device)
        spacing = 2 * math.pi * scenario.p / scenario.num_robots
        self.inputs = [self.natural_rate, scenario.coupling, spacing, scenario.time_unit]


@dataclass(frozen=True)
class ReferenceParameters(Checked):
    """Parameters of the coordinator, besides the scenario."""

    runs_on: bool = flag(False)
    """True for a reference that moves on while its robot has failed."""
    tracking: float | None = number(None, 0, 1e6, "1/s")
    """k, the gain of the phase error from the reference [1/s]; None is omega / (0.3 rad)."""
    catch_up: float = number(1.0, 0, 1e6)
    """Largest rate that a robot adds to catch up, as a multiple of omega / alpha."""


@wp.kernel
def track_reference(
    rate: float,
    step: float,
    runs_on: bool,
    tracking: float,
    most: float,
    memory: wp.array2d(dtype=wp.vec2),
    observation: Observation,
    phase_rate_out: PhaseRates,
):
    """Write theta_i' = rate + clip(tracking wrap(theta_ref - theta_i)) to [-rate, most] [rad/s] for robot i of world w.

    The memory is the phase of the reference at the start [rad], and one more than the number of steps of its motion.
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
    """Coordinator: each robot tracks its own reference point, without messages: Borkar et al. [15].

    The paper describes it as a distributed and robust tracking of reference points that are computed centrally in open
    loop. The planner places the references in the formation, each with the rate omega:

        gamma_ref(t) = gamma_ref(0) + omega t_on                 t_on: time for which the robot has worked [s]
        theta_i' = omega / alpha + k wrap(theta_ref - theta_i)   gamma = alpha theta, k = `tracking` [1/s]

    with the second term clipped to [-omega / alpha, `catch_up` omega / alpha], so that a robot does not reverse to meet
    its reference. gamma_ref(0) is the robot's position at the start of the episode, which is its place in the
    formation; a deviation at the start therefore remains.

    The effect of a failure depends on the reference of the stopped robot. As `tracked-reference` it stops and resumes
    together with its robot: Fig. 6(b) shows states that keep their offset after t_2, and Section V names "the
    desynchronization in the reference point generation" as the reason. As `running-reference` it keeps moving (t_on is
    the time of the episode), and the robot catches up: the configuration is recovered, unlike in the figure, by robots
    that pass through the places of others.

    Without tracking, k = 0, it is the open loop of Borkar et al. [14], which assumes that the robots start in the
    formation and are not disturbed: A. V. Borkar, A. Sinha, L. Vachhani, H. Arya, "Application of Lissajous
    curves in trajectory planning of multiple agents", Autonomous Robots 44 (2020). Every robot goes along the curve
    with gamma' = omega, so its speed is the profile V(gamma) = omega ||r'(gamma)||.
    """

    kernel = track_reference
    communicates = "nothing"
    remembers = ("_memory",)
    Parameters = ReferenceParameters

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any, parameters: ReferenceParameters | None = None):
        super().__init__(scenario, num_worlds, device, parameters)
        rate, given = self.natural_rate, self.parameters
        tracking = 1 / scenario.time_unit if given.tracking is None else given.tracking
        self._memory = wp.zeros(self.phase_rate.shape, dtype=wp.vec2, device=device)
        self.inputs = [rate, scenario.task.step, given.runs_on, tracking, given.catch_up * rate, self._memory]


PREVIEW = 0.6
"""Time over which the phase rate of `KuramotoByArc` is averaged [s], in the time scale of the paper's experiment: with
less, the ground speed is unsteady before tight turns."""


@dataclass(frozen=True)
class ArcParameters(Checked):
    """Parameters of the coordinator, besides the scenario."""

    speed: float | None = number(None, 1e-6, 1e5, "m/s")
    """v, speed along the curve [m/s]; None is `ground_speed`."""
    preview: float | None = number(None, 1e-3, 1e5, "s")
    """Time over which the phase rate is averaged [s]; None is PREVIEW, scaled to the scenario."""


class KuramotoByArc(NumpyCoordinator):
    """Coordinator: phase rates (W, N) [rad/s] by (1) on arc phases.

    This is the paper's coordination with the phase measured along the curve: the robots are equally spaced, at a
    constant ground speed. Robot i has the arc phase psi_i = 2 pi s(alpha theta_i) / (L alpha), with s(gamma) of (14)
    and L the length of a lap, and dynamics (1) act on it:

        psi_i' = 2 pi v / (L alpha) - K sum over j in R_i of sin(psi_j - psi_i)

    Its equilibria, their stability and alpha of Lemma 2 are those of the phase, with the places spaced by L / N along
    the curve rather than by 2 pi / N in gamma. psi_j follows from the observed phase theta_i and phase difference
    theta_j - theta_i, and is advanced at the natural rate by the age of the message. The controller uses one phase rate
    for its horizon: the mean one over the next PREVIEW seconds at the ground speed of psi_i'.

    The ground speed v is the formation's mean speed, or that of a patrol if it is higher (`ground_speed`). With
    theta' = omega, cars reach it only on the fast stretches of the curve. So in `intruders`, where the rectangle is too
    large for a guarantee, targets are detected sooner.

    The bounds (6), (8) and T_max do not hold, because equally spaced robots are not on ellipse (5), and `phase_error`,
    the deviation from (2) in theta, does not fall to 0. On curve (16), two robots in formation come nearer to one
    another than those of (2), and too near for cars that leave the curve by decimetres: they collide in `experiment`.
    """

    Parameters = ArcParameters

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any, parameters: ArcParameters | None = None):
        super().__init__(scenario, num_worlds, device, parameters)
        curve = self.scenario.driven
        self._preview = self.parameters.preview or PREVIEW * motion_scale(scenario).time
        speed = self.parameters.speed or ground_speed(scenario)
        self._rate = 2 * math.pi * speed / (curve_length(curve) * self.scenario.alpha)
        gamma = np.append(lap_phases(curve), 2 * math.pi)
        ends, middles = curve_speed(curve, gamma), curve_speed(curve, gamma[:-1] + 0.5 * gamma[1])
        cells = (ends[:-1] + 4 * middles + ends[1:]) / 6  # Simpson's rule
        arc = np.concatenate([[0.0], np.cumsum(cells)]) * 2 * math.pi / cells.sum()
        self._to_arc, self._from_arc = (gamma, arc - gamma), (arc, gamma - arc)

    def rates(self, rows: Rows) -> np.ndarray:
        """Return the mean theta_i' over the preview for psi_i' = rate - K sum_j sin(psi_j - psi_i)."""
        alpha, theta = self.scenario.alpha, rows.phase.astype(float)
        arc = self._arc_of(alpha * theta)
        ahead = (self._arc_of(alpha * (theta[..., None] + rows.lead)) - arc[..., None]) / alpha
        pull = (rows.heard * np.sin(ahead + self._rate * rows.age)).sum(axis=-1)
        arc_then = arc + self._preview * alpha * (self._rate - self.scenario.coupling * pull)
        gamma = arc_then + np.interp(arc_then % (2 * math.pi), *self._from_arc)
        return (gamma - alpha * theta) / (self._preview * alpha)

    def _arc_of(self, gamma: np.ndarray) -> np.ndarray:
        """Return 2 pi s(gamma) / L [rad] for gamma [rad], which may be beyond a lap."""
        return gamma + np.interp(gamma % (2 * math.pi), *self._to_arc)


def ground_speed(scenario: Scenario) -> float:
    """Return the formation's mean speed, omega L / (2 pi) [m/s], or a patrol's, if that is higher and grip limited."""
    mean = scenario.formation.phase_rate * curve_length(scenario.driven) / (2 * math.pi)
    return mean if math.isinf(scenario.robot.lateral_acceleration_max) else max(mean, cruising_speed(scenario))
