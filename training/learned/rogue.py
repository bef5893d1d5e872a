"""Learned rogues: checkpoints whose network maps a row of `lissajous_env.world.rogues.acting` to a velocity.

`targets.rogues`, and `--rogues` of the commands, accept the folder of such a checkpoint like the name of a script. The
included ones, in `training/rogues`, have the names of their folders.
"""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lissajous_env import Scenario
from lissajous_env.console.terminal import plain
from lissajous_env.parameters.rogues import Rogue
from lissajous_env.world.rogues.acting import ACTION_NAMES, rogue_layout
from training.learned import checkpoint
from training.learned.card import Card
from training.learned.forward import Forward
from training.learned.network import Network

KIND = "rogue"
"""Kind of a card whose policy drives no robots."""


def rogue_card(scenario: Scenario, settings: Mapping[str, Any] | None = None) -> Card:
    """Return the card of a rogue that reads the whole row of a scenario."""
    home, names = plain(scenario.resolve().to_dict()), rogue_layout(scenario).names
    return Card(scenario.name, KIND, tuple(names), len(ACTION_NAMES), home, settings=settings or {})


def open_rogue(folder: str | Path, name: str | None = None) -> Rogue:
    """Return the rogue in the folder of a checkpoint, under a name; by default that of the folder.

    Raises:
        ValueError: there is none, it is damaged, or its policy drives robots.
    """
    network, card, _ = checkpoint.read(folder)
    if card.kind != KIND or not isinstance(network, Network):
        raise ValueError(f"rogues must be the folder of a rogue, got {folder}, which drives robots of kind {card.kind}")
    return as_rogue(name or str(folder), network, card)


def as_rogue(name: str, network: Network, card: Card) -> Rogue:
    """Return the rogue of a network under a name."""

    def bind(scenario: Scenario, rogues: Any) -> Callable[[], None]:
        fitted, columns = fit_network(network, card, scenario)
        return Forward(fitted, columns, rogues.observation, rogues.action).launch

    against = str(card.settings.get("against") or "")
    words = f"learned on {card.scenario}" + (f" against {against}" if against else "")
    return Rogue(name, None, words, bind=bind, trained_on=card.scenario, trained_against=against)


def fit_network(network: Network, card: Card, scenario: Scenario) -> tuple[Network, np.ndarray]:
    """Return a network for the rows of a scenario, and the indices of the entries that it reads.

    A scenario may have more robots than that of the training, of which the nearest are read, or fewer: the entries of
    absent robots are zero in any row, so the network is used without them.

    Raises:
        ValueError: the scenario lacks another entry that the network reads.
    """
    names = rogue_layout(scenario).names
    lacking = [entry for entry in card.inputs if entry not in names and not entry.startswith("robot_")]
    if lacking:
        raise ValueError(f"rows of rogues on {scenario.name} must contain {', '.join(lacking[:4])}, which they lack")
    there = [k for k, entry in enumerate(card.inputs) if entry in names]
    first, *others = network.weights
    fitted = dataclasses.replace(network, weights=(first[:, there], *others))
    return fitted, np.array([names.index(card.inputs[k]) for k in there])
