"""The command `lissajous train`."""

import dataclasses
import importlib

import tyro

from lissajous_env.cli import Overrides, parse_overrides
from training.settings import Train


def train(settings: tyro.conf.OmitArgPrefixes[Train], overrides: Overrides = ()) -> None:
    """Train a policy; it can be stopped or killed at any moment, the same command goes on.

    Args:
        settings: What is trained, how, and where it goes.
        overrides: fields changed in the scenario, as in --set task.reward_collision=-5 targets.count=5
    """
    settings = dataclasses.replace(settings, overrides=parse_overrides(overrides))
    extra = "cluster" if settings.engine == "ray" else "train"
    try:
        engine = importlib.import_module("training.rllib" if settings.engine == "ray" else "training.train")
    except ImportError as error:
        raise ValueError(f'train must have its libraries ({error}): pip install "lissajous-env[{extra}]"') from error
    engine.train(settings)
