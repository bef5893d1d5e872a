"""Robot models: how robots of a kind move, what an action is and how they are drawn; `robot.kind` names one."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.warp_abi import names_of_arguments
from lissajous_env.plugins import Registry
from lissajous_env.settings.checks import is_number
from lissajous_env.settings.parts import Curve, Formation, Noise, Robot
from lissajous_env.settings.task import Task
from lissajous_env.theory.geometry import turning_radius
from lissajous_env.wording import few_of, require


@dataclass(frozen=True)
class AsCar:
    """Description of how robots of a model move like cars; classical policies for cars can drive a model that has one.

    The policies plan for cars with the model's `speed_unit` as top speed, with this turning radius and acceleration,
    and with its heading, which must be the direction of the motion.
    """

    act: Any
    """Kernel of (W, N) threads that writes the actions for a constant speed and yaw rate in a step.

    Its arguments are, in this order: `robot: RobotStruct`; `heading`, `speed` and `yaw_rate` (W, N), the measured
    heading [rad], the desired speed [m/s] and the desired yaw rate [rad/s], float; `action_out` (W, N, action size).
    """
    turning_radius: Callable[[Robot], float]
    """Radius of the tightest turn at the top speed [m]; above 0, also for robots that turn on the spot."""
    acceleration: Callable[[Robot], float]
    """Acceleration from rest, and deceleration from the top speed [m/s^2]; infinity for robots without inertia."""
    has_yaw_limit: bool = False
    """True if the radius is proportional to the speed, as for robots with a largest yaw rate: policies then plan for
    cars with the smaller radius `Scenario.turning_radius`, and with grip. Otherwise it applies to any speed."""


@dataclass(frozen=True)
class RobotModel:
    """One model of robots; after `lissajous_env.register_robot_model`, `robot.kind` can name it."""

    name: str
    """Name, as in `robot.kind`."""
    actions: tuple[str, ...]
    """Names of the action's components, each in [-1, 1]."""
    table: tuple[tuple[float, ...], ...]
    """(K, len(actions)) actions from which a discrete action selects."""
    move: Any
    """Kernel that moves the robots by a step; arguments are matched by name, see `lissajous_env.world.stages`.

    `command` (W, N, len(actions)) is the clipped action with noise. The kernel writes position, heading and speed of
    `robots`, and the path `robots.path` (W, N, S + 1) from the old position to the new one. A robot that is not
    WORKING does not move.
    """
    speed_unit: Callable[[Curve, Formation, Robot], float]
    """Unit of observed speeds [m/s], such as the top speed."""
    meanings: tuple[str, ...] = ()
    """Description of each component of the action, with its unit."""
    rest: Callable[[Robot], tuple[float, ...]] | None = None
    """Function that returns the action that brings a robot to rest; None means zeros."""
    driving: tuple[int, ...] | None = None
    """Indices of the action's components that drive a robot away from its place; None means all."""
    check: Callable[[Curve, Formation, Robot, Noise, Task], None] | None = None
    """Function that raises ValueError for fields that this model does not support."""
    shape: Callable[[Robot], list[tuple[np.ndarray, str | None]]] | None = None
    """Function that returns outlines (K, 2) for a radius of 1, heading right, lowest first, each with the name of a
    colour in `lissajous_env.render.palette` or None for the robot's own; by default a disc with a tip."""
    keeps_to_curve: bool = False
    """True if robots never leave the curve; `move` then writes the phase, otherwise derived from the position."""
    as_car: AsCar | None = None
    """Description by which policies for cars drive these robots; None if they cannot."""

    def rest_action(self, robot: Robot) -> tuple[float, ...]:
        """Return the action that brings a robot to rest."""
        return (0.0,) * len(self.actions) if self.rest is None else self.rest(robot)


_ARGUMENTS_OF_ACT = ("robot", "heading", "speed", "yaw_rate", "action_out")
MODELS = Registry(
    "robot model",
    (r"\w[\w-]{0,62}", "of letters, digits, _ and -"),
    lambda model: model.name in ("car", "curve", "differential"),
)
"""Registered models by name; the included ones register themselves in `lissajous_env.world.robots`."""


def register_robot_model(model: RobotModel) -> RobotModel:
    """Add a model to those that `robot.kind` can name, and return it.

    Raises:
        ValueError: the name is taken or invalid, or the model is invalid.
    """
    require(isinstance(model, RobotModel), "robot model", "must be a RobotModel", model)
    called, size, as_car = f"robot model {model.name}", len(model.actions), model.as_car
    are_words = all(isinstance(action, str) and action.strip() == action != "" for action in model.actions)
    is_named = model.actions and are_words and len(set(model.actions)) == size
    require(is_named, called, "must have an action of at least one component, with different names", model.actions)
    require(isinstance(model.move, wp.Kernel), called, "must move by a Warp kernel", model.move)
    require(model.table, called, "must have a table of at least one row", model.table)
    rests = model.rest is None or callable(model.rest)
    require(rests, f"rest of {called}", "must be a function of a Robot", model.rest)
    for what, given in {"table": model.table, "rest": [model.rest_action(Robot())]}.items():
        for row in given:
            are_actions = len(row) == size and all(is_number(value, -1, 1) for value in row)
            require(are_actions, f"{what} of {called}", f"must contain rows of {size} numbers from -1 to 1", row)
    are_indices = set(model.driving or ()) <= set(range(size))
    rule = f"must contain indices of components of the action, from 0 to {size - 1}"
    require(are_indices, f"driving of {called}", rule, model.driving)
    require(as_car is None or isinstance(as_car, AsCar), f"as_car of {called}", "must be an AsCar", as_car)
    if as_car is not None:
        arguments = names_of_arguments(as_car.act) if isinstance(as_car.act, wp.Kernel) else ()
        rule = f"must be a Warp kernel of {', '.join(_ARGUMENTS_OF_ACT)}"
        require(tuple(arguments) == _ARGUMENTS_OF_ACT, f"as_car.act of {called}", rule, arguments or as_car.act)
    return MODELS.add(model)


def model_of(kind: str) -> RobotModel:
    """Return the model of a name.

    Raises:
        ValueError: there is no such model.
    """
    require(kind in MODELS, "robot.kind", f"must be one of {few_of(MODELS, kind)}, or one that --import adds", kind)
    return MODELS[kind]


REST_OR_DIRECTION = (0.0, 0.0), *((math.cos(k * math.pi / 4), math.sin(k * math.pi / 4)) for k in range(8))
"""Velocities from which a discrete action selects [top speed]: rest, and eight directions."""


def driven_by_velocity(model: RobotModel) -> RobotModel:
    """Return a model of cars whose actions are velocities: `task.action` = `velocity`."""
    axis = "velocity along {} that the driver steers to [top speed]"
    return dataclasses.replace(
        model,
        actions=("x_velocity", "y_velocity"),
        table=REST_OR_DIRECTION,
        meanings=(axis.format("x"), axis.format("y")),
        rest=None,
        driving=None,
        as_car=None,
    )


def tightest_radius(robot: Robot) -> float:
    """Return the radius of the tightest circle of a car, or of one that a robot moves like [m]; 0 for points."""
    if robot.kind == "car":
        return turning_radius(robot.wheelbase, robot.steering_max)
    as_car = model_of(robot.kind).as_car
    return 0.0 if as_car is None else as_car.turning_radius(robot)
