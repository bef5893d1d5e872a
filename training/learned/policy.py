"""Learned policies of robots, with the interface of the classical ones: load, register and play them."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import baselines
from baselines.policies.base import Policy
from baselines.policies.registry import LOADERS, Loader
from lissajous_env import Scenario
from lissajous_env.wording import few_of, require
from training.learned import checkpoint
from training.learned.card import Card
from training.learned.networks import TeamNetwork
from training.learned.perception import BASE, actions_of, base_action, perceive

_SHIPPED = Path(__file__).parent.parent / "policies"
"""Folder of the included policies."""


def load(name: str | Path, scenario: str | Scenario | None = None, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    """Load an included network by name, or a checkpoint from its folder; by default for the scenario of its training.

    Raises:
        ValueError: there is no such name or folder, the checkpoint is damaged, or the policy does not fit the scenario.
    """
    network, card, _ = checkpoint.read(find(name))
    if not isinstance(network, TeamNetwork):
        raise ValueError(f"policy must drive robots, got {name}, which drives rogues")
    task = checkpoint.scenario_of_card(card) if scenario is None else scenario
    policy = LearnedTeam(network, card, task, num_worlds, device)
    policy.name = str(name)
    return policy


def find(name: str | Path) -> Path:
    """Return the folder of an included policy, or the given folder if it contains a checkpoint.

    Raises:
        ValueError: it is neither.
    """
    if str(name) in names():
        return _SHIPPED / str(name)
    rule = f"must be one of {few_of(names(), name)}, or a folder with {checkpoint.FILE}"
    require((Path(name) / checkpoint.FILE).is_file(), "policy", rule, str(name), names())
    return Path(name)


def register_shipped() -> None:
    """Register the included policies in `baselines`, which then also accepts the folder of a checkpoint as a name.

    Weights are read when a policy is made.
    """
    LOADERS[checkpoint.FILE] = Loader(
        load,
        lambda folder: checkpoint.scenario_of_card(checkpoint.read_description(folder)["card"]),
        checkpoint.digests,
    )
    for name in names():
        description = checkpoint.read_description(_SHIPPED / name)
        card = description["card"]
        about = f"Learned on {card.settings['scenario']}{f', on top of {card.base}' if card.base else ''}."
        baselines.register(name, card.kind, partial(load, name), tuple(description["made_for"]), about, "network")


def names() -> tuple[str, ...]:
    """Return the names of the included learned policies."""
    return tuple(sorted(path.parent.name for path in _SHIPPED.glob(f"*/{checkpoint.FILE}")))


class LearnedTeam(Policy):
    """Policy whose action is a network's output, added to the action of the base if the card has one, in [-1, 1].

    `actions_of` changes velocities. The same network computes the action of each robot, from the robot's own row and
    the base's action alone, on the CPU.

    Raises:
        ValueError: the network does not fit the card, or the robots or actions of the scenario do not fit the policy.
    """

    communicates = "phases, positions and tracks of other robots"

    def __init__(
        self, network: TeamNetwork, card: Card, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu"
    ):
        super().__init__(scenario, num_worlds, device)
        if network.outputs != card.action_size:
            raise ValueError(f"network must have {card.action_size} outputs, got {network.outputs}")
        card.check(self.scenario)
        self.network, self.card, self.kind = network, card, card.kind
        self.base = baselines.make(card.base, self.scenario, num_worlds) if card.base else None

    def decide(self, observation: np.ndarray) -> np.ndarray:
        """Return the actions; the network reads entries of rows clipped to [-10, 10], far outside of their ranges."""
        of_base = None if self.base is None else base_action(self.base, observation)
        observation = observation.clip(-10.0, 10.0)
        perception = perceive(observation, self.scenario, of_base)
        outputs = self.network(perception)
        outputs[..., :2] += perception.own[..., BASE][..., : outputs.shape[-1]]
        actions = actions_of(outputs, observation, self.scenario)
        return np.pad(actions, ((0, 0), (0, 0), (0, self.action.shape[2] - actions.shape[2])))  # messages of zeros
