"""Policies of cars for robots of other models that move like cars (`lissajous_env.AsCar`)."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import warp as wp

from baselines.policies.base import Policy
from baselines.policies.own_row import Actions, Observation, own_heading, own_speed
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.parameters.assumptions import quietly
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Robot, Scenario
from lissajous_env.world.robots.car import car_rate, car_step, motor_acceleration, steering_and_throttle

wp.set_module_options(OPTIONS)


class CarForDrive(Robot):
    """Cars that stand for robots of another model; those that stand for differential drives turn as gradually."""

    stands_for_drive = True


@wp.kernel
def to_twists(
    car: RobotStruct,
    step: float,
    observation: Observation,
    wanted: Actions,
    heading_out: wp.array2d(dtype=float),
    speed_out: wp.array2d(dtype=float),
    yaw_rate_out: wp.array2d(dtype=float),
):
    """Write the measured heading, and the speed and yaw rate that a car would reach in the step with its action."""
    w, i = wp.tid()
    control = steering_and_throttle(car, wp.vec2(wanted[w, i, 0], wanted[w, i, 1]))
    curvature = wp.tan(control[0]) / car.wheelbase
    push = motor_acceleration(car, car.drive, control[1])
    speed = wp.max(own_speed(w, i, car.speed_max, observation), 0.0)
    reached = car_step(car, wp.vec4(0.0, 0.0, 0.0, speed), curvature, push, step)
    heading_out[w, i] = own_heading(w, i, observation)
    speed_out[w, i] = reached[3]
    yaw_rate_out[w, i] = car_rate(car, reached, curvature, push)[2]


class AsCars(Policy):
    """Robots of a model that move as a policy would drive cars of the same top speed, turning radius and acceleration.

    In each control step, a robot moves at the speed and the yaw rate that its car would reach at the end of the step.
    `make(scenario, num_worlds, device)` returns the policy of cars; the robots' model has `as_car`.

    Raises:
        ValueError: there are no such cars, or the policy of cars does not fit the scenario.
    """

    arrays = "warp"

    def __init__(
        self, make: Callable[[Scenario, int, Any], Policy], scenario: Scenario, num_worlds: int = 1, device: Any = "cpu"
    ):
        super().__init__(scenario, num_worlds, device)
        self.kind = self.scenario.robot.kind
        cars = scenario_of_cars(self.scenario)
        with quietly():  # about fields that these robots do not have
            self.policy = make(cars, self.num_worlds, self.device)
        self.communicates = self.policy.communicates
        as_car: Any = model_of(self.kind).as_car
        self._act_kernel = as_car.act
        self._size = self.scenario.action_size - self.scenario.messages.size
        self._robot, self._car = (to_struct(RobotStruct, team.robot) for team in (self.scenario, cars))
        self._twist = [wp.zeros(self.shape, dtype=wp.float32, device=self.device) for _ in range(3)]

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        wanted = self.policy.act(observation)
        inputs = [self._car, self.scenario.task.step, observation, wanted]
        self.launch(to_twists, self.shape, inputs, self._twist)
        self.launch(self._act_kernel, self.shape, [self._robot, *self._twist], [self.action])
        if self.scenario.messages.size:
            wp.copy(self.action[:, :, self._size :], wanted[:, :, 2:])


def like_cars(scenario: Scenario) -> Scenario | None:
    """Return the scenario if its robots are cars, else `scenario_of_cars`; None if they do not move like cars."""
    if scenario.robot.kind == "car":
        return scenario
    return None if model_of(scenario.robot.kind).as_car is None else scenario_of_cars(scenario)


def scenario_of_cars(scenario: Scenario) -> Scenario:
    """Return a scenario with cars that move like its robots: their motor has no dead zone, their grip is the same.

    Raises:
        ValueError: the model has no `as_car`, a top speed, turning radius or acceleration is not above 0, or the
            scenario does not fit cars.
    """
    robot, model = scenario.robot, model_of(scenario.robot.kind)
    as_car = model.as_car
    if as_car is None:
        raise ValueError(f"robot model {model.name} must have as_car to be driven by policies of cars, got None")
    limits = {
        "speed_unit": scenario.speed_unit,
        "as_car.turning_radius": as_car.turning_radius(robot),
        "as_car.acceleration": as_car.acceleration(robot),
    }
    for name, value in limits.items():
        if not value > 0:
            raise ValueError(f"{name} of robot model {model.name} must be above 0, got {value}")
    top, top_radius, acceleration = limits.values()
    turning, grip = scenario.turning_radius, robot.lateral_acceleration_max
    drag = min(acceleration / top, 1 / scenario.task.step)
    fields = dataclasses.asdict(robot) | {
        "kind": "car",
        "steering_max": Robot.steering_max,
        "wheelbase": turning * math.tan(Robot.steering_max),
        "throttle_min": 0.0,
        "throttle_max": None,
        "speed_max": top,
        "drag": drag,
        "drive": drag * top,
        "offset": 0.0,
        "dead_zone": 0.0,
        "model_offset": None,
        "lateral_acceleration_max": grip if turning == top_radius else min(grip, turning * (top / top_radius) ** 2),
        "yaw_acceleration_max": robot.top_yaw_acceleration if robot.kind == "differential" else None,
        "drive_factors": (),
    }
    return dataclasses.replace(scenario, robot=CarForDrive(**fields)).resolve()
