"""Trackers: what makes a robot follow the phase rates of a coordinator; points follow them exactly, cars by MPCC."""

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from baselines.mpcc.model import MpccParameters
from baselines.mpcc.solver import Mpcc
from baselines.policies.base import Policy, Remembering
from baselines.policies.coordinators import PHASES, Coordinator, PhaseRates
from baselines.policies.own_row import Actions, Observation, own_heading, own_phase, own_position, own_speed
from lissajous_env.device.car_input import car_action
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct, curve_struct
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.structs import to_struct
from lissajous_env.parameters.assumptions import warn_of_violations
from lissajous_env.parameters.scenario import Scenario

wp.set_module_options(OPTIONS)


class Coordinated(Policy):
    """Robots that follow a coordinator, each kind in its own way.

    `coordinator(scenario, num_worlds, device)` makes the coordinator: its class, or a `partial` of it that fixes
    parameters of its own.

    Warns:
        AssumptionWarning: the scenario violates an assumption of the paper about its formation.
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
        warn_of_violations(self.scenario)
        self.coordinator = coordinator(self.scenario, num_worlds, self.device)
        self.communicates = getattr(self.coordinator, "communicates", PHASES)
        self._curve = curve_struct(self.scenario.curve, self.device)
        self._robot = to_struct(RobotStruct, self.scenario.robot)
        self._alpha = float(self.scenario.alpha)

    def forget(self, mask: np.ndarray) -> None:
        """Reset the memory of these worlds, also that of a coordinator of another base class."""
        super().forget(mask)
        if not isinstance(self.coordinator, Remembering) and hasattr(self.coordinator, "forget"):
            self.coordinator.forget(mask)


@wp.kernel
def follow_as_point(robot: RobotStruct, phase_rate: PhaseRates, action_out: Actions):
    """Return the action of a point on the curve: its phase rate over the largest."""
    w, i = wp.tid()
    action_out[w, i, 0] = wp.clamp(phase_rate[w, i] / robot.phase_rate_max, -1.0, 1.0)


class OnCurve(Coordinated):
    """Points that follow a coordinator exactly."""

    kind = "curve"

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        self.coordinator.coordinate(observation)
        inputs = [self._robot, self.coordinator.phase_rate]
        self.launch(follow_as_point, self.shape, inputs, [self.action])


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
    """Return a car's action: steering and throttle of the first stage, scaled to [-1, 1]."""
    w, i = wp.tid()
    k = w * action_out.shape[1] + i
    action = car_action(robot, control[k, 0, 0], control[k, 0, 1])
    action_out[w, i, 0] = action[0]
    action_out[w, i, 1] = action[1]


class WithMpcc(Coordinated):
    """Cars that follow a coordinator by model predictive contouring control.

    `parameters` are the controller's; None is `MpccParameters.of` the scenario.
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
        self._speed_unit = self.scenario.robot.top_speed
        parameters = parameters or MpccParameters.of(self.scenario)
        self.mpcc = Mpcc(self.scenario.curve, parameters, batch=num_worlds * self.num_robots, device=self.device)

    def restrict(self, robot: int) -> None:
        """Solve the problem of one robot alone."""
        super().restrict(robot)
        if self.num_worlds > 1:
            raise ValueError(f"policy must be for one world to be restricted, got {self.num_worlds}")
        self.mpcc.restrict(robot)

    def forget(self, mask: np.ndarray) -> None:
        """Reset the memory of these worlds."""
        super().forget(mask)
        self.mpcc.reset(np.repeat(mask, self.num_robots))

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        self.coordinator.coordinate(observation)
        inputs = [self._curve, self._alpha, self._speed_unit, observation, self.coordinator.phase_rate]
        self.launch(read_cars, self.shape, inputs, [self.mpcc.state, self.mpcc.phase_rate])
        self.mpcc.launch()
        inputs = [self._robot, self.mpcc.control]
        self.launch(scale_controls, self.shape, inputs, [self.action])
