"""Policies whose network reads sets: what a robot perceives, of any number of tracks and teammates."""

from typing import Any

import numpy as np

import baselines
from baselines.policies.base import Policy
from lissajous_env import Scenario
from training.learned.card import Card
from training.learned.perception import perceive, told_to_drive, wish_of
from training.learned.team_network import TeamNetwork


class LearnedTeam(Policy):
    """Policy whose action is a network's output, added to the wish of the base if the card has one, in [-1, 1].

    Velocities are changed to lead away from robots that are near, as those of the classical policies are. The same
    network decides for each robot, from the robot's own row and memory alone.

    Args:
        network: Network of the policy.
        card: Card of the policy.
        scenario: Scenario to play.
        num_worlds: W.
        device: Warp device; the network is evaluated on the CPU.

    Raises:
        ValueError: the network does not fit the card, or the robots or actions of the scenario do not fit the policy.
    """

    def __init__(
        self, network: TeamNetwork, card: Card, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu"
    ):
        super().__init__(scenario, num_worlds, device)
        if network.outputs != card.action_size:
            raise ValueError(f"network must have {card.action_size} outputs, got {network.outputs}")
        card.check(self.scenario)
        self.network, self.card, self.kind = network, card, card.kind
        self.base = baselines.make(card.base, self.scenario, num_worlds) if card.base else None
        self._memory = np.zeros((*self.shape, network.memory), np.float32)

    def forget(self, mask: np.ndarray) -> None:
        """Forget everything in the masked worlds."""
        super().forget(mask)
        self._memory[mask] = 0.0

    def decide(self, observation: np.ndarray) -> np.ndarray:
        """Return the actions; entries far outside of their ranges count as at most 10."""
        observation = observation.clip(-10.0, 10.0)
        wish = None if self.base is None else wish_of(self.base, observation)
        outputs, self._memory = self.network(perceive(observation, self.scenario, wish), self._memory)
        if wish is not None:
            outputs[..., :2] += wish[..., :2]
        action = np.zeros(self.action.shape, np.float32)
        action[..., : outputs.shape[-1]] = outputs.clip(-1.0, 1.0)
        if self.scenario.task.action == "velocity":
            action[..., :2] = told_to_drive(action[..., :2], observation, self.scenario)
        return action
