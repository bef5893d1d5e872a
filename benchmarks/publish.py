"""Add a trained policy or rogue to the included ones: `python benchmarks/publish.py runs/x learned-x "COMMAND"`.

The copy has no state of the training. Its description contains the command and the scores on held-out seeds: of
a policy on the scenarios for which a benchmark plays it by default, of a rogue beside those of scripted ones.
"""

import dataclasses
import sys
from pathlib import Path
from typing import Annotated, Any

import tyro

from baselines.benchmark.statistics import summarize
from lissajous_env import evaluate
from lissajous_env.parameters import named
from lissajous_env.storage.folder import LIST
from lissajous_env.world.columns import COLLISIONS, MEAN, task_score
from training.learned import checkpoint
from training.learned.card import Card
from training.learned.networks import TeamNetwork
from training.learned.policy import LearnedTeam
from training.rogue_trainer import undetected_times
from training.settings import RogueTraining

HELD_OUT = range(10_000, 10_256)
"""Held-out seeds of policies."""
ROGUES_HELD_OUT = range(10_000, 10_064)
"""Held-out seeds of rogues; an episode has 96 of them."""
SCRIPTS = "wander", "flee", "shadow", "follow-gap"
"""Scripts whose undetected times are stored beside those of a rogue."""
_PACKAGE = Path(checkpoint.__file__).parents[1]


def publish(
    source: Annotated[Path, tyro.conf.Positional],
    name: Annotated[str, tyro.conf.Positional],
    command: Annotated[str, tyro.conf.Positional],
    made_for: tuple[str, ...] = (),
    folder: Path = _PACKAGE,
) -> None:
    """Copy a checkpoint into the package.

    Args:
        source: folder of the checkpoint.
        name: name of the included policy or rogue.
        command: command that trained it.
        made_for: scenarios of a policy; by default that of its training.
        folder: folder of the package, in which policies are in `policies` and rogues in `rogues`.
    """
    network, card, description = checkpoint.read(source)
    if not isinstance(network, TeamNetwork):
        notes, kind = {"held_out_times": _times_of(source, card), "rogues": description["rogues"]}, "rogues"
    else:
        notes, kind = _scores_of(network, card, made_for or (card.scenario,)), "policies"
        notes["training"] = description["training"]
    card = dataclasses.replace(card, settings=dict(card.settings) | {"out": f"runs/{name}"})
    with checkpoint.locked(folder / kind / name) as locked_folder:
        checkpoint.save(locked_folder, network, card, notes={"command": command, **notes})
    # Nothing is added to the copy, so that it needs no list of its files.
    (folder / kind / name / LIST).unlink()
    print(f"wrote {folder / kind / name}", file=sys.stderr)


def _scores_of(network: TeamNetwork, card: Card, made_for: tuple[str, ...]) -> dict[str, Any]:
    """Return the score and the collisions of a policy on some scenarios, each a mean with its interval."""
    scores = {}
    for played in made_for:
        # The scenario of the training is in its folder and need not be registered.
        scenario = checkpoint.scenario_of_card(card) if played == card.scenario else named.scenario(played)
        rows = evaluate(LearnedTeam(network, card, scenario, len(HELD_OUT)), scenario, HELD_OUT)
        for name in (task_score(scenario).name, COLLISIONS.name):
            mean = summarize([row[name] for row in rows], MEAN)
            scores.setdefault(played, {})[name] = [round(value, 4) for value in (mean.value, mean.low, mean.high)]
        print(played, scores[played])
    return {"made_for": made_for, "held_out_scores": scores}


def _times_of(source: Path, card: Card) -> dict[str, Any]:
    """Return the undetected times of a rogue and of scripts against the policy of its training."""
    stored = card.settings
    settings = RogueTraining(stored["scenario"], starts=stored["starts"], overrides=stored["overrides"])
    times = {}
    for rogue in (*SCRIPTS, "learned"):
        moved_by = str(source) if rogue == "learned" else rogue
        summary = undetected_times(stored["against"], settings.make_scenario(moved_by), ROGUES_HELD_OUT)
        times[rogue] = {key: round(value, 4) for key, value in summary.items()}
        print(stored["against"], rogue, times[rogue])
    return {stored["against"]: times}


if __name__ == "__main__":
    tyro.cli(publish)
