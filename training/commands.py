"""The command `lissajous train`."""

import dataclasses
from typing import Annotated, Any, Literal

import tyro

from lissajous_env.console.terminal import DEFAULT_OUTPUT, Output, Overrides, make_console, parse_overrides
from lissajous_env.plugins import of_extra
from training.settings import RogueTraining, TrainingSettings


def train(
    settings: TrainingSettings,
    side: Literal["robots", "rogues"] = "robots",
    against: Annotated[str | None, tyro.conf.arg(metavar="POLICY")] = None,
    rogue_rounds: int | None = None,
    rogue_starts: int | None = None,
    output: Output = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Train a policy of the robots; with `--side rogues`, train targets that hide from robots.

    A *rogue* is a target that is controlled by an adversary. A training may be interrupted or killed at any moment; the
    same command resumes it from its last checkpoint.

    Example:
        lissajous train --scenario watch --out runs/watch
        lissajous train --side rogues --against sweep --scenario evaders --out runs/hiding

    Args:
        settings: Scenario, settings and folder of the results.
        side: `robots`, or `rogues` for targets that learn to hide from robots that do not learn. With rogues, only the
            options scenario, set, seed, out, episodes, device, threads, against and rogue_* are allowed.
        against: policy of the robots from which rogues learn to hide: a name, or the folder of a checkpoint.
        rogue_rounds: rounds in which rogues imitate a rogue that knows the robots' future; more rounds make better
            rogues, 48 take some minutes and are the default.
        rogue_starts: rogues per episode, each with a start of its own, 96 by default.
    """
    settings = dataclasses.replace(settings, overrides=parse_overrides(overrides))
    options = {"against": against, "rounds": rogue_rounds, "starts": rogue_starts}
    given: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
    # With --json, stdout is reserved for the result.
    console = make_console(stderr=output.json, quiet=output.quiet)
    if side == "robots" and given:
        raise ValueError(f"side must be rogues if options of rogues are given ({', '.join(given)}), got robots")
    try:
        if side == "rogues":
            if against is None:
                raise ValueError("against must be the policy from which the rogues learn to hide, got none")
            trainer = of_extra("training.rogue_trainer", "train", "train")
            history = trainer.train_rogues(RogueTraining.from_common(settings, **given), console)
        else:
            history = of_extra("training.trainer", "train", "train").train(settings, console)
    except KeyboardInterrupt:
        words = f"run the same command again to resume from the last checkpoint in {settings.out}"
        raise KeyboardInterrupt(words) from None
    output.print_json({"out": settings.out, **history})
