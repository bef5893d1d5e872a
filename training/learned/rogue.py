"""Learned rogues: checkpoints whose network maps a row of `lissajous_env.world.rogues.acting` to a velocity.

`targets.rogues`, and `--rogues` of the commands, accept the folder of such a checkpoint like the name of a script. The
included ones, in `training/rogues`, have the names of their folders.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lissajous_env import Scenario
from lissajous_env.parameters.rogues import Rogue
from lissajous_env.world.rogues.acting import ACTION_NAMES, rogue_entries, rogue_layout
from training.learned import checkpoint
from training.learned.card import ROGUE, Card
from training.learned.networks import RogueNetwork


def rogue_card(scenario: Scenario, settings: Mapping[str, Any] | None = None) -> Card:
    """Return the card of a rogue that reads the whole row of a scenario."""
    inputs = rogue_layout(scenario).names
    return Card.of(scenario, kind=ROGUE, inputs=inputs, action_size=len(ACTION_NAMES), settings=settings or {})


def open_rogue(folder: str | Path, name: str | None = None) -> Rogue:
    """Return the rogue of a checkpoint; its name is by default that of the folder.

    A scenario may have other numbers of robots than that of the training: the network reads the nearest robots, and the
    entries of absent ones are zero in every row.

    Raises:
        ValueError: there is none, it is damaged, or its policy drives robots.
    """
    network, card, _ = checkpoint.read(folder)
    if not isinstance(network, RogueNetwork):
        raise ValueError(f"rogues must be the folder of a rogue, got {folder}, which drives robots of kind {card.kind}")
    entries = rogue_entries(num_robots=len(card.inputs))  # more robots than the row has
    names = [entry for entry, *_ in entries[: len(card.inputs)]]
    if wrong := [entry for entry, wanted in zip(card.inputs, names, strict=True) if entry != wanted]:
        raise ValueError(f"inputs of {folder} must be the entries of a rogue's row in their order, got {wrong[0]}")
    against = str(card.settings.get("against") or "")
    words = f"learned on {card.scenario}" + (f" against {against}" if against else "")
    return Rogue(name or str(folder), lambda rows: network(rows).clip(-1.0, 1.0), words)
