"""The command `lissajous train`."""

import dataclasses
import importlib
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from lissajous_env.console.terminal import DEFAULT_OUTPUT, OutputOptions, make_console
from lissajous_env.extras import missing
from lissajous_env.parameters.overrides import Overrides, parse_overrides
from training.rogue_settings import RogueTraining
from training.settings import TrainingSettings


def train(
    settings: tyro.conf.OmitArgPrefixes[TrainingSettings],
    side: Literal["robots", "rogues"] = "robots",
    against: Annotated[str | None, tyro.conf.arg(metavar="POLICY")] = None,
    rogue_rounds: int | None = None,
    rogue_steps: int | None = None,
    rogue_starts: int | None = None,
    output: OutputOptions = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Train a policy, or with `--side rogues` targets that hide from the robots of a policy.

    A training may be interrupted or killed at any moment; the same command resumes it from its last checkpoint.

    Example:
        lissajous train --scenario intruders --out runs/intruders
        lissajous train --side rogues --against sweep --scenario evaders --out runs/hiding

    Options:
        training: scenario, set, algorithm, steps, seed, start, out
        start and base: base, residual, initial_output, residual_penalty, teacher, imitation, imitation_steps,
            imitation_batch, imitation_epochs
        worlds: worlds, groups, short, short_time, rollout, caution
        network: inputs, layers, activation, critic, critic_steps
        optimizer: learning_rate, batch_size, epochs, gamma, gae_lambda, clip_range, entropy, value_weight,
            gradient_max, averaging
        exploration: log_std, log_std_end, noise_steps
        evaluation: evaluate_every, evaluation_episodes, evaluation_scenarios, rivals
        where it runs: device, threads, engine, address, workers
        rogues: side, against, rogue_rounds, rogue_steps, rogue_starts

    Args:
        settings: Scenario, algorithm and folder of the results.
        side: `robots`, or `rogues` for targets that learn to hide from robots that do not learn. Rogues accept only the
            options scenario, set, seed, out, layers, activation, gamma, evaluation_episodes, device, threads, and
            those of this group.
        against: policy of the robots from which rogues learn to hide: a name, or the folder of a checkpoint.
        rogue_rounds: rounds of imitation of a rogue with foresight, 16 by default.
        rogue_steps: rogue steps of PPO after the imitation, 1,000,000 by default.
        rogue_starts: rogues per episode, each with a start of its own, 96 by default.
        output: Console output.
        overrides: fields changed in the scenario, as in --set task.reward_collision=-5 targets.count=5
    """
    settings = dataclasses.replace(settings, overrides=parse_overrides(overrides))
    of_rogues = {"against": against, "rounds": rogue_rounds, "steps": rogue_steps, "starts": rogue_starts}
    given = {name: value for name, value in of_rogues.items() if value is not None}
    # Its lines tell how it goes: where stdout is for the result alone, they go to stderr.
    console = make_console(stderr=output.json, quiet=output.quiet)
    if side == "rogues":
        output.print_json({"out": settings.out, **_train_rogues(settings, given, console)})
        return
    if given:
        raise ValueError(f"side must be rogues where options of rogues are given ({', '.join(given)}), got robots")
    extra = "cluster" if settings.engine == "ray" else "train"
    try:
        engine = importlib.import_module(
            "training.rllib.trainer" if settings.engine == "ray" else "training.sb3.trainer"
        )
    except ImportError as error:
        raise missing("train", extra, error) from error
    history = engine.train(settings, console)
    output.print_json({"out": settings.out, **dataclasses.asdict(history)})


def _train_rogues(settings: TrainingSettings, given: dict[str, Any], console: Console) -> dict[str, Any]:
    """Train rogues and return the history."""
    if "against" not in given:
        raise ValueError("against must be the policy from which the rogues learn to hide, got none")
    made = RogueTraining.from_common(settings, **given)
    try:
        engine = importlib.import_module("training.sb3.rogue_trainer")
    except ImportError as error:
        raise missing("train", "train", error) from error
    return engine.train_rogues(made, console)
