"""Hints for the files of models, which are no policies by themselves."""

import os
from pathlib import Path

_MODELS = {
    ".zip": "training.sb3.ModelPolicy(PPO.load(file), scenario, num_worlds, device) for a model of Stable-Baselines3",
    ".onnx": "a baselines.Policy that runs the model in `decide`",
}
"""Returned values of a function that plays a model, by the suffix of its file."""


def how_to_play(name: str) -> str:
    """Return a hint for the file of a model, which a function of a module has to load; "" for any other name."""
    suffix = Path(name).suffix.lower()
    if suffix not in _MODELS and os.path.isfile(f"{name}.zip"):
        suffix = ".zip"
    if suffix not in _MODELS:
        return ""
    return (
        f"; write a function(scenario, num_worlds, device) in a module that returns {_MODELS[suffix]}, and name it as "
        "module:function"
    )
