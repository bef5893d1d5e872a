"""Learned policies, with the same interface as the classical ones."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import warp as wp

import baselines
from baselines.policies.base import Policy
from baselines.policies.registry import LOADERS, Loader
from lissajous_env import Scenario
from lissajous_env.wording import few_of
from training.learned import checkpoint
from training.learned.card import Card, constants_of
from training.learned.forward import Forward
from training.learned.network import Network
from training.learned.team_network import TeamNetwork
from training.learned.team_policy import LearnedTeam


class Learned(Policy):
    """Policy whose action is a network's output, clipped to [-1, 1], or the sum of a base's action and a part of it.

    The same network maps each row of the observation to the action of its robot. A policy that was trained without
    messages sends zeros in a scenario with messages.

    Args:
        network: Network of the policy.
        card: Card of the policy.
        scenario: Scenario to play.
        num_worlds: W.
        device: Warp device.

    Raises:
        ValueError: the network does not fit the card, the base is not a registered classical policy, or the robots or
            observation of the scenario do not fit the policy.
    """

    arrays = "warp"

    def __init__(
        self, network: Network, card: Card, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu"
    ):
        super().__init__(scenario, num_worlds, device)
        _check(network, card)
        self.network, self.card, self.kind = network, card, card.kind
        columns = card.columns(self.scenario, or_silent=True)
        self.base = card.make_base(self.scenario, num_worlds, self.device)
        added_to = None if self.base is None else self.base.action
        if card.constants:
            values = constants_of(self.scenario, card.constants)
            network = network.with_constants(len(card.inputs), values)
        self._forward = Forward(network, columns, self._observation, added_to, card.residual, self.action)

    def decide(self, observation: wp.array) -> None:
        """Run the network, and add its output to the base's action if there is a base."""
        base = None if self.base is None else self.base.act(observation)
        self._forward.launch(observation, base)


def _check(network: Network, card: Card) -> None:
    if (network.inputs, network.outputs) != (card.network_inputs, card.action_size):
        wanted = f"{card.network_inputs} inputs to {card.action_size} components of an action"
        raise ValueError(f"network must map {wanted}, got {network.inputs} to {network.outputs}")


def load(name: str | Path, scenario: str | Scenario | None = None, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    """Load an included network by name, or a checkpoint from its folder; by default for the scenario of its training.

    Raises:
        ValueError: there is no such name or folder, the checkpoint is damaged, or the policy does not fit the scenario.
    """
    network, card, _ = checkpoint.read(find(name))
    made = checkpoint.home_scenario(card) if scenario is None else scenario
    if isinstance(network, TeamNetwork):
        policy = LearnedTeam(network, card, made, num_worlds, device)
    else:
        policy = Learned(network, card, made, num_worlds, device)
    policy.name = str(name)
    return policy


def home(name: str | Path) -> Scenario:
    """Return the scenario on which an included policy, or that in a folder, was trained.

    Raises:
        ValueError: there is no such name or folder, the checkpoint is damaged, or the scenario is invalid.
    """
    return checkpoint.home_scenario(checkpoint.read(find(name))[1])


def find(name: str | Path) -> Path:
    """Return the folder of an included policy, or the given folder if it contains a checkpoint.

    Raises:
        ValueError: it is neither.
    """
    shipped = _SHIPPED / str(name)
    if str(name) in names():
        return shipped
    if (Path(name) / checkpoint.FILE).is_file():
        return Path(name)
    raise ValueError(
        f"policy must be one of {few_of(names(), name) or 'none shipped'}, or a folder with {checkpoint.FILE}, "
        f"got {str(name)!r}"
    )


def register_shipped() -> None:
    """Register the included policies in `baselines`, which then also accepts the folder of a checkpoint as a name.

    Weights are read when a policy is made.
    """
    LOADERS[checkpoint.FILE] = Loader(load, home, checkpoint.parts)
    for name in names():
        text = json.loads((_SHIPPED / name / checkpoint.FILE).read_text(encoding="utf-8"))
        policy, scenario = text["policy"], text["settings"].get("scenario", text["policy"]["scenario"])
        about = f"Learned on {scenario}{', on top of ' + policy['base'] if policy['base'] else ''}."
        baselines.register(name, policy["kind"], partial(load, name), tuple(text["made_for"]), about, learned=True)


_SHIPPED = Path(__file__).parent.parent / "policies"


def names() -> tuple[str, ...]:
    """Return the names of the included policies whose actions a network computes."""
    return tuple(sorted(path.parent.name for path in _SHIPPED.glob(f"*/{checkpoint.FILE}")))
