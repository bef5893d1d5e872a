"""The command `lissajous train`."""

import dataclasses
import importlib

import tyro

from lissajous_env.console.terminal import DEFAULT_OUTPUT, OutputOptions, make_console
from lissajous_env.extras import missing
from lissajous_env.parameters.overrides import Overrides, parse_overrides
from training.settings import TrainingSettings


def train(
    settings: tyro.conf.OmitArgPrefixes[TrainingSettings],
    output: OutputOptions = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Train a policy; it can be stopped or killed at any moment, the same command goes on.

    Args:
        settings: What is trained, how, and where it goes.
        output: How it speaks.
        overrides: fields changed in the scenario, as in --set task.reward_collision=-5 targets.count=5
    """
    settings = dataclasses.replace(settings, overrides=parse_overrides(overrides))
    extra = "cluster" if settings.engine == "ray" else "train"
    try:
        engine = importlib.import_module(
            "training.rllib.trainer" if settings.engine == "ray" else "training.sb3.trainer"
        )
    except ImportError as error:
        raise missing("train", extra, error) from error
    # Its lines tell how it goes: where stdout is for the result alone, they go to stderr.
    console = make_console(stderr=output.json, quiet=output.quiet)
    history = engine.train(settings, console)
    output.print_json({"out": settings.out, **dataclasses.asdict(history)})
