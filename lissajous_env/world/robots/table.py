"""The table of robot models, by the name that `robot.kind` takes."""

import re
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.wording import few_of, shown
from lissajous_env.world.robots.car import CAR
from lissajous_env.world.robots.model import RobotModel
from lissajous_env.world.robots.point import POINT

_MODELS = {model.name: model for model in (CAR, POINT)}


def register_robot_model(model: RobotModel) -> RobotModel:
    """Register a model by its name, and return it.

    Raises:
        ValueError: a name that another model has, or a model that cannot be one.
    """
    if not isinstance(model, RobotModel):
        raise ValueError(f"robot model must be a RobotModel, got {shown(model)}")
    if not (isinstance(model.name, str) and re.fullmatch(r"\w[\w-]{0,62}", model.name)):
        raise ValueError(f"name of a robot model must be of letters, digits, _ and -, got {shown(model.name)}")
    if _MODELS.get(model.name, model) != model:
        raise ValueError(f"name of a robot model must be new, got {shown(model.name)}")
    words = all(isinstance(each, str) and each.strip() == each != "" for each in model.actions)
    if not model.actions or not words or len(set(model.actions)) < len(model.actions):
        rule = "must have an action of at least one component, each with a name of its own"
        raise ValueError(f"robot model {model.name} {rule}, got {shown(model.actions)}")
    if not isinstance(model.move, wp.Kernel):
        raise ValueError(f"robot model {model.name} must move by a Warp kernel, got {shown(model.move)}")
    if not model.table or any(len(row) != model.action_size for row in model.table):
        raise ValueError(f"robot model {model.name} must have a table of rows of {model.action_size}, got another")
    rows = {"table": model.table, "rest": [model.rest] if model.rest is not None else []}
    for what, given in rows.items():
        for row in given:
            if len(row) != model.action_size or not all(_is_action(each) for each in row):
                rule = f"must hold rows of {model.action_size} numbers from -1 to 1"
                raise ValueError(f"{what} of robot model {model.name} {rule}, got {shown(row)}")
    _MODELS[model.name] = model
    return model


def _is_action(value: Any) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool) and bool(-1 <= value <= 1)


def model_of(kind: str) -> RobotModel:
    """Return the model of a name.

    Raises:
        ValueError: there is none.
    """
    if kind not in _MODELS:
        raise ValueError(f"robot.kind must be one of {few_of(_MODELS, kind)}, got {shown(kind)}")
    return _MODELS[kind]


def is_shipped(kind: str) -> bool:
    """Return whether a model comes with the package."""
    return _MODELS.get(kind) in (CAR, POINT)


def robot_kinds() -> tuple[str, ...]:
    """Names of the models."""
    return tuple(_MODELS)
