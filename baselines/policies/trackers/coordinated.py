"""A coordinator over a tracker: who decides the phase rates, and what makes a robot follow them."""

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np
import warp as wp

from baselines.mpcc.solver import Mpcc, MpccParameters
from baselines.policies.base import Policy
from baselines.policies.own_row import own_heading, own_phase, own_position
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.structs import to_struct
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.robots import RobotStruct

wp.set_module_options(OPTIONS)


class Coordinator(Protocol):
    """Decides phase rates from observations."""

    phase_rate: wp.array
    """(W, N) theta' that each robot should go on with [rad/s]."""

    def coordinate(self, observation: wp.array) -> None:
        """Write `phase_rate`."""


@runtime_checkable
class Remembering(Protocol):
    """A coordinator that keeps something of the episode."""

    def forget(self, mask: np.ndarray) -> None:
        """Forget the worlds in a mask (W,)."""


@wp.kernel
def follow_as_point(robot: RobotStruct, phase_rate: wp.array2d(dtype=float), action_out: wp.array3d(dtype=float)):
    """Action of a point on the curve: its phase rate over the largest."""
    w, i = wp.tid()
    action_out[w, i, 0] = wp.clamp(phase_rate[w, i] / robot.phase_rate_max, -1.0, 1.0)


@wp.kernel
def read_cars(
    curve: CurveStruct,
    alpha: float,
    speed_scale: float,
    observation: wp.array3d(dtype=float),
    phase_rate: wp.array2d(dtype=float),
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
    state_out[k, 3] = wp.max(observation[w, i, 4] * speed_scale, 0.0)
    state_out[k, 4] = alpha * own_phase(w, i, observation)
    rate_out[k] = alpha * phase_rate[w, i]


@wp.kernel
def scale_controls(robot: RobotStruct, control: wp.array3d(dtype=float), action_out: wp.array3d(dtype=float)):
    """Action of a car: steering and throttle of the first stage, scaled to [-1, 1]."""
    w, i = wp.tid()
    k = w * action_out.shape[1] + i
    action_out[w, i, 0] = control[k, 0, 0] / robot.steering_max
    span = robot.throttle_max - robot.throttle_min
    action_out[w, i, 1] = 2.0 * (control[k, 0, 1] - robot.throttle_min) / span - 1.0


class Coordinated(Policy):
    """Robots that follow a coordinator, each kind in its own way.

    `coordinator(scenario, num_worlds, device)` makes the coordinator: its class, or a `partial` of it that fixes
    parameters of its own.
    """

    arrays = "warp"

    def __init__(
        self,
        coordinator: Callable[[Scenario, int, Any], Coordinator],
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
    ):
        super().__init__(scenario, num_worlds, device)
        self.coordinator = coordinator(self.scenario, num_worlds, self.device)
        self._curve = to_struct(CurveStruct, self.scenario.curve)
        self._robot = to_struct(RobotStruct, self.scenario.robot)

    def forget(self, mask: np.ndarray) -> None:
        """Forget what the coordinator remembers."""
        if isinstance(self.coordinator, Remembering):
            self.coordinator.forget(mask)


class OnCurve(Coordinated):
    """Points that follow a coordinator exactly."""

    kind = "curve"

    def decide(self, observation: wp.array) -> None:
        """Take the coordinator's phase rates."""
        self.coordinator.coordinate(observation)
        inputs = [self._robot, self.coordinator.phase_rate]
        wp.launch(follow_as_point, self.shape, inputs, outputs=[self.action], device=self.device)


class WithMpcc(Coordinated):
    """Cars that follow a coordinator by model predictive contouring control.

    `parameters` are the controller's; None is `MpccParameters.of` the scenario's robot.
    """

    kind = "car"

    def __init__(
        self,
        coordinator: Callable[[Scenario, int, Any], Coordinator],
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        parameters: MpccParameters | None = None,
    ):
        super().__init__(coordinator, scenario, num_worlds, device)
        self._speed_scale = self.scenario.robot.speed_max
        parameters = parameters or MpccParameters.of(self.scenario.robot, step=self.scenario.task.step)
        self.mpcc = Mpcc(self.scenario.curve, parameters, batch=num_worlds * self.num_robots, device=self.device)

    def forget(self, mask: np.ndarray) -> None:
        """Forget what the coordinator remembers, and the last solutions."""
        super().forget(mask)
        self.mpcc.reset(np.repeat(mask, self.num_robots))

    def decide(self, observation: wp.array) -> None:
        """Solve for the controls that follow the coordinator's phase rates."""
        self.coordinator.coordinate(observation)
        alpha = float(self.scenario.alpha)
        inputs = [self._curve, alpha, self._speed_scale, observation, self.coordinator.phase_rate]
        wp.launch(read_cars, self.shape, inputs, outputs=[self.mpcc.state, self.mpcc.phase_rate], device=self.device)
        self.mpcc.launch()
        inputs = [self._robot, self.mpcc.control]
        wp.launch(scale_controls, self.shape, inputs, outputs=[self.action], device=self.device)
