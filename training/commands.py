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
    """Train a policy.

    A training may be interrupted or killed at any moment; the same command resumes it from its last checkpoint.

    Example:
        lissajous train --scenario intruders --out runs/intruders

    Options:
        training: scenario, set, algorithm, steps, seed, start, out
        start and base: base, residual, residual_penalty, teacher, imitation, imitation_steps, imitation_batch,
            imitation_epochs
        worlds: worlds, short, short_time, rollout, caution
        network: inputs, layers, activation, critic, critic_steps
        optimizer: learning_rate, batch_size, epochs, gamma, gae_lambda, clip_range, entropy, value_weight,
            gradient_max, averaging
        exploration: log_std, log_std_end, noise_steps
        evaluation: evaluate_every, evaluation_episodes, rivals
        where it runs: device, threads, engine, address, workers

    Args:
        settings: Scenario, algorithm and folder of the results.
        output: Console output.
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
