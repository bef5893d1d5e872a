"""Trackers, by which robots follow the phase rates of a coordinator, and the policies that consist of both.

Points follow them exactly, cars by the paper's model predictive contouring control (`WithMpcc`) or by a vector field.
A policy has the coordinator's name and the tracker's suffix, as `kuramoto-mpcc`; points have no suffix.
Coordination and tracking can thus be compared separately: `consensus-gvf` is the whole method of Yao et al., and
`consensus-mpcc` their coordination alone.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from baselines.mpcc.model import MpccParameters
from baselines.mpcc.solver import Mpcc
from baselines.policies import registry
from baselines.policies.base import Policy
from baselines.policies.coordinators import (
    PHASES,
    Consensus,
    Coordinator,
    Kuramoto,
    KuramotoByArc,
    PhaseRates,
    ReferenceParameters,
    TrackedReference,
)
from baselines.policies.driving import steady_speed
from baselines.policies.own_row import Actions, Observation, own_heading, own_phase, own_position, own_speed, own_works
from baselines.similarity import motion_scale
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct, curve_struct, point2, tangent2, wrap
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters.assumptions import warn_of_violations
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number
from lissajous_env.theory.geometry import curve_length
from lissajous_env.wording import require
from lissajous_env.world.robots.car import car_action, throttle_towards
from lissajous_env.world.robots.inside import scaled_gain

wp.set_module_options(OPTIONS)


class Coordinated(Policy):
    """Base class of trackers: policies whose robots follow a coordinator; a subclass implements `decide`.

    `coordinator(scenario, num_worlds, device)` makes the coordinator: its class, or a `partial` that sets parameters.

    Warns:
        AssumptionWarning: the scenario violates an assumption of the paper about its formation.
    """

    arrays = "warp"

    def __init__(
        self,
        coordinator: Callable[..., Coordinator],
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        parameters: Any = None,
    ):
        super().__init__(scenario, num_worlds, device, parameters)
        warn_of_violations(self.scenario)
        self.coordinator = coordinator(self.scenario, num_worlds, self.device)
        self.communicates = getattr(self.coordinator, "communicates", PHASES)
        self._curve = curve_struct(self.scenario.curve, self.device)
        self._robot = to_struct(RobotStruct, self.scenario.robot)
        self._alpha = float(self.scenario.alpha)
        self._prepare()

    def _prepare(self) -> None:
        """Make what the tracker needs besides its coordinator."""


@wp.kernel
def follow_as_point(robot: RobotStruct, phase_rate: PhaseRates, action_out: Actions):
    """Write the action of a point on the curve: its phase rate over the largest."""
    w, i = wp.tid()
    action_out[w, i, 0] = wp.clamp(phase_rate[w, i] / robot.phase_rate_max, -1.0, 1.0)


class OnCurve(Coordinated):
    """Points that follow a coordinator exactly."""

    kind = "curve"

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        self.coordinator.coordinate(observation)
        self.launch(follow_as_point, self.shape, [self._robot, self.coordinator.phase_rate], [self.action])


@wp.kernel
def read_cars(
    curve: CurveStruct,
    alpha: float,
    speed_unit: float,
    observation: Observation,
    phase_rate: PhaseRates,
    state_out: wp.array2d(dtype=float),
    rate_out: wp.array(dtype=float),
):
    """Write the state x, y, heading, speed, gamma of each car and its wanted gamma' = alpha theta'."""
    w, i = wp.tid()
    k = w * observation.shape[1] + i
    position = own_position(w, i, curve, observation)
    state_out[k, 0] = position[0]
    state_out[k, 1] = position[1]
    state_out[k, 2] = own_heading(w, i, observation)
    state_out[k, 3] = wp.max(own_speed(w, i, speed_unit, observation), 0.0)
    state_out[k, 4] = alpha * own_phase(w, i, observation)
    rate_out[k] = alpha * phase_rate[w, i]


@wp.kernel
def scale_controls(robot: RobotStruct, control: Actions, action_out: Actions):
    """Write a car's action: steering and throttle of the first stage, scaled to [-1, 1]."""
    w, i = wp.tid()
    k = w * action_out.shape[1] + i
    action = car_action(robot, control[k, 0, 0], control[k, 0, 1])
    action_out[w, i, 0] = action[0]
    action_out[w, i, 1] = action[1]


class WithMpcc(Coordinated):
    """Cars that follow a coordinator by model predictive contouring control."""

    kind = "car"
    Parameters = MpccParameters

    def _prepare(self) -> None:
        self._speed_unit, batch = self.scenario.speed_unit, self.num_worlds * self.num_robots
        self.mpcc = Mpcc(self.scenario.curve, self.parameters, batch=batch, device=self.device)

    def restrict(self, robot: int) -> None:
        """Solve the problem of one robot alone; a policy for several worlds cannot be restricted."""
        super().restrict(robot)
        require(self.num_worlds == 1, "policy", "must be for one world to be restricted", self.num_worlds)
        self.mpcc.restrict(robot)

    def forget(self, mask: np.ndarray) -> None:
        """Delete the warm starts of these worlds."""
        self.mpcc.reset(np.repeat(mask, self.num_robots))

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        self.coordinator.coordinate(observation)
        inputs = [self._curve, self._alpha, self._speed_unit, observation, self.coordinator.phase_rate]
        self.launch(read_cars, self.shape, inputs, [self.mpcc.state, self.mpcc.phase_rate])
        self.mpcc.launch()
        inputs = [self._robot, self.mpcc.control]
        self.launch(scale_controls, self.shape, inputs, [self.action])


@dataclass(frozen=True)
class FieldParameters(Checked):
    """Parameters of the tracker, besides the scenario; `FieldParameters.of` scales the defaults to another scenario."""

    pull: float = number(4.0, 1e-6, 1e6, "1/m")
    """Largest k, the pull towards the path [1/m]."""
    turn: float = number(6.0, 1e-6, 1e6, "1/s")
    """TURN, the rate at which a car turns into the field [1/s]."""
    speed: float = number(8.0, 1e-6, 1e6, "1/s")
    """SPEED, the rate at which a car approaches the field's speed [1/s]."""
    slowest: float = number(0.3, 0, 1)
    """SLOWEST, the smallest share of the field's speed at which a car drives while it turns: a car that has stopped
    cannot turn."""

    @classmethod
    def of(cls, scenario: Scenario, **overrides: Any) -> "FieldParameters":
        """Return the parameters for the cars of a scenario, scaled from those of the paper's experiment."""
        scale = motion_scale(scenario)
        scaled = {
            "pull": cls.pull / scale.length,
            "turn": min(cls.turn / scale.time, 1 / scenario.task.step),
            "speed": scaled_gain(scenario, cls.speed),
        }
        return cls(**scaled | overrides)


@wp.struct
class Field:
    """Constants of the field; `rate` is omega [rad/s], `scale` L / 2 pi [m/rad], `pull` k [1/m], `step` [s].

    `turn`, `speed` and `slowest` are those of `FieldParameters`; cars slower than `least` [m/s] steer as if at it.
    """

    rate: float
    scale: float
    pull: float
    step: float
    turn: float
    speed: float
    slowest: float
    least: float


@wp.func
def field_velocity(field: Field, tangent: wp.vec2, off: wp.vec2) -> wp.vec2:
    """Return q' = V (f' - k off) = omega (r' - k scale off) [m/s]."""
    return field.rate * (tangent - field.pull * field.scale * off)


@wp.func
def field_rate(field: Field, tangent: wp.vec2, off: wp.vec2) -> float:
    """Return V chi_w as a rate of gamma, omega (1 + k off . r' / scale) [rad/s]."""
    return field.rate * (1.0 + field.pull * wp.dot(off, tangent) / field.scale)


@wp.kernel
def follow_field(
    curve: CurveStruct,
    robot: RobotStruct,
    field: Field,
    alpha: float,
    phase_rate: PhaseRates,
    memory: wp.array2d(dtype=wp.vec2),
    observation: Observation,
    action_out: Actions,
):
    """Steer and drive by the field, and advance gamma. A robot's memory is gamma [rad] and 1 once it is known."""
    w, i = wp.tid()
    known = memory[w, i]
    gamma = known[0]
    if known[1] == 0.0 or not own_works(w, i, observation):
        gamma = alpha * own_phase(w, i, observation)
    tangent = tangent2(curve, gamma)
    off = own_position(w, i, curve, observation) - point2(curve, gamma)
    velocity = field_velocity(field, tangent, off)
    gamma_rate = field_rate(field, tangent, off) + alpha * phase_rate[w, i] - field.rate
    memory[w, i] = wp.vec2(wrap(gamma + field.step * gamma_rate), 1.0)

    heading = own_heading(w, i, observation)
    speed = own_speed(w, i, steady_speed(robot), observation)
    turn = wrap(wp.atan2(velocity[1], velocity[0]) - heading)
    steering = wp.atan(robot.wheelbase * field.turn * turn / wp.max(speed, field.least))
    wanted = wp.length(velocity) * wp.max(cos_sin(turn)[0], field.slowest)
    if wp.dot(velocity, tangent) < 0.0:
        wanted = 0.0
    action = car_action(robot, steering, throttle_towards(robot, speed, wanted, field.speed))
    action_out[w, i, 0] = action[0]
    action_out[w, i, 1] = action[1]


class WithVectorField(Coordinated):
    """Cars that follow a coordinator by a guiding vector field.

    This is the tracker of Yao et al. [16] (`Consensus` has the reference). The path parameter is a coordinate of its
    own, w, which the robot stores; so the path in (x, y, w) does not cross itself, although r(gamma) does, and the
    field vanishes nowhere.

    Here w = gamma L / 2 pi [m], L the length of a lap, so that f(w) = r(gamma) has |f'| near 1. With the robot at q and
    off = q - f(w) the field chi, its sum with the coordination c, and the desired motion are

        chi_xy = f'(w) - k off                         without a unit; k [1/m]
        chi_w  = 1 + k off . f'(w)
        q' = V chi_xy,  w' = V chi_w + (L / 2 pi) c    V = omega L / 2 pi [m/s], the mean speed of the formation

    where c = alpha (theta' - omega / alpha) [rad/s] is the rate that the coordinator adds to the natural one. c moves w
    alone; the robot follows because of the pull of off.

    A car follows q' as heading and speed, e [rad] being the angle from its heading to q':

        steering = atan(l TURN e / v)
        wanted speed = |q'| max(cos e, SLOWEST), or 0 where q' points back along the curve
        throttle = (c_drag wanted + beta + SPEED (wanted - v)) / alpha_motor, as a patrol's

    Differs from Yao et al.: their unicycle drives at the desired speed and turns with the feed-forward of the field's
    direction, which the limits of this car leave without effect. A car that is ahead of w cannot reverse, and waits.

    A failed robot sets w to its own place, so that it continues from there. On `experiment` without faults the tracking
    error of `consensus-gvf` is 0.147 m in the mean of 64 episodes, that of `open-loop-mpcc` 0.182 m.
    """

    kind = "car"
    remembers = ("_memory",)
    Parameters = FieldParameters

    def _prepare(self) -> None:
        self._field = field_of(self.scenario, self.parameters)
        self._memory = wp.zeros(self.shape, dtype=wp.vec2, device=self.device)

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        self.coordinator.coordinate(observation)
        inputs = [self._curve, self._robot, self._field, self._alpha, self.coordinator.phase_rate,
                  self._memory, observation]  # fmt: skip
        self.launch(follow_field, self.shape, inputs, [self.action])


def field_of(scenario: Scenario, parameters: FieldParameters) -> Any:
    """Return the constants of the field.

    The pull is limited so that at the formation's speed a step corrects at most half of `off`.
    """
    field = to_struct(Field, parameters)
    field.least = 0.1 * motion_scale(scenario).speed
    field.rate, field.step = scenario.formation.phase_rate, scenario.task.step
    field.scale = curve_length(scenario.driven) / (2 * math.pi)
    field.pull = min(parameters.pull, 0.5 / (field.rate * field.scale * field.step))
    return field


TRACKERS: dict[str, tuple[type[Coordinated], str]] = {
    "points": (OnCurve, ""),
    "mpcc": (WithMpcc, ", for cars with model predictive contouring control"),
    "gvf": (WithVectorField, ", for cars that follow a guiding vector field (Yao et al.)"),
}
"""Trackers by name, each with the end of the description of a policy; the name is its suffix, except for points."""


def with_tracker(
    coordinator: Callable[..., Coordinator], tracker: str = "points", **settings: Any
) -> Callable[..., Coordinated]:
    """Return a factory of policies that follow a coordinator: `factory(scenario, num_worlds, device)` makes one.

    Args:
        coordinator: Function or class, called as `coordinator(scenario, num_worlds, device)`: a subclass of
            `baselines.NumpyCoordinator`, or any class with a Warp array `phase_rate` (W, N) [rad/s] and a method
            `coordinate(observation)` that writes it.
        tracker: "mpcc" for cars with model predictive contouring control; "gvf" for cars with a guiding vector field;
            "points" for points on the curve, which follow exactly.
        **settings: Settings of the tracker, such as `parameters=baselines.mpcc.MpccParameters(...)`.

    Raises:
        ValueError: the tracker is unknown, or the coordinator is not callable.
    """
    require(tracker in TRACKERS, "tracker", f"must be one of {', '.join(TRACKERS)}", tracker, TRACKERS)
    require(callable(coordinator), "coordinator", "must be coordinator(scenario, num_worlds, device)", coordinator)
    return partial(TRACKERS[tracker][0], coordinator, **settings)


def register_coordinator(name: str, coordinator: Callable[..., Coordinator] | None = None, about: str = "") -> Any:
    """Register a policy for each tracker: `name` for points, `name-mpcc` and `name-gvf` for cars.

    Without `coordinator`, return a decorator, as in `@register_coordinator("mine")`. The policies for cars also accept
    the suffixes of collision filters. A benchmark plays `name-gvf` only if it is named, except for the whole method of
    Yao et al.

    Args:
        name: Name of the coordinator.
        coordinator: The coordinator, as for `with_tracker`.
        about: Description in one line; by default the first line of the coordinator's docstring.

    Returns:
        The coordinator.

    Raises:
        ValueError: another policy has the name; the same coordinator may be registered again.
    """
    if coordinator is None:
        return partial(register_coordinator, name, about=about)
    description = (about or getattr(coordinator, "__doc__", None) or "").partition("\n")[0].rstrip(".")
    for tracker, (_, ending) in TRACKERS.items():
        word = name if tracker == "points" else f"{name}-{tracker}"
        on_request = tracker == "gvf" and coordinator is not Consensus
        registry.register(
            word, None, with_tracker(coordinator, tracker), about=f"{description}{ending}.", on_request=on_request
        )
    return coordinator


register_coordinator("kuramoto", Kuramoto, "Time-inverted Kuramoto coordination, the paper's method")
_OPEN_LOOP = partial(TrackedReference, parameters=ReferenceParameters(tracking=0.0))
register_coordinator("open-loop", _OPEN_LOOP, "Constant phase rate of every robot, without feedback (Borkar et al.)")
_TRACKS = "Each robot tracks its own reference, which"
register_coordinator("tracked-reference", TrackedReference, f"{_TRACKS} stops with the robot (Borkar et al.)")
# Cars under MPCC catch up soonest with this value; larger ones make cars leave the curve.
_RUNNING = partial(TrackedReference, parameters=ReferenceParameters(runs_on=True, catch_up=1.5))
register_coordinator("running-reference", _RUNNING, f"{_TRACKS} keeps moving if the robot stops")
register_coordinator("consensus", Consensus, "Linear consensus with the desired spacing given (Yao et al.)")
register_coordinator("arc", KuramotoByArc, "Kuramoto on the arc length at constant ground speed, without the guarantee")
