"""The table of robot models, by the name that `robot.kind` takes."""

import warp as wp

from lissajous_env.wording import shown
from lissajous_env.world.robots.car import CAR
from lissajous_env.world.robots.model import RobotModel
from lissajous_env.world.robots.point import POINT

_MODELS = {model.name: model for model in (CAR, POINT)}


def register_robot_model(model: RobotModel) -> RobotModel:
    """Make a model known by its name; returns it.

    Raises:
        ValueError: a name that another model has, or a model that cannot be one.
    """
    if _MODELS.get(model.name, model) != model:
        raise ValueError(f"name of a robot model must be new, got {shown(model.name)}")
    if not model.actions:
        raise ValueError(f"robot model {model.name} must have an action of at least one component, got none")
    if not isinstance(model.move, wp.Kernel):
        raise ValueError(f"robot model {model.name} must move by a Warp kernel, got {shown(model.move)}")
    if not model.table or any(len(row) != model.action_size for row in model.table):
        raise ValueError(f"robot model {model.name} must have a table of rows of {model.action_size}, got another")
    _MODELS[model.name] = model
    return model


def model_of(kind: str) -> RobotModel:
    """Return the model of a name.

    Raises:
        ValueError: there is none.
    """
    if kind not in _MODELS:
        raise ValueError(f"robot.kind must be one of {', '.join(_MODELS)}, got {shown(kind)}")
    return _MODELS[kind]


def is_ours(model: RobotModel) -> bool:
    """Whether a model is part of the package, and needs no check of what it does."""
    return model in (CAR, POINT)


def robot_kinds() -> tuple[str, ...]:
    """Names of the models."""
    return tuple(_MODELS)
