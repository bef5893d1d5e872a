"""What stands between a learner and the worlds: the rows that it reads, the actions that its outputs become."""

from typing import Any

import numpy as np

import baselines
from lissajous_env import Scenario
from lissajous_env.world.observation import layout
from training.learned.card import Card
from training.learned.named_arrays import prefixed, within
from training.learned.residual import Adder


class Wiring:
    """A batch of W worlds of N robots, wired to a learner as a card says; arrays are NumPy's.

    A row holds the entries of the observation that the card lists and, where there is a base, its action. The base's
    action is the one of the latest `read`.

    Args:
        card: What the learner reads, and what its outputs are added to.
        scenario: What is played.
        num_worlds: W.
        device: Warp device, on which the base works.
        residual_penalty: Reward that an output which is added costs, per step and mean square.

    Raises:
        ValueError: the scenario's robots or observation do not fit the card.
    """

    def __init__(
        self, card: Card, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", residual_penalty: float = 0.0
    ):
        ranges, columns = layout(scenario), card.columns(scenario)
        self._columns = None if np.array_equal(columns, np.arange(ranges.size)) else columns
        self.base, self._penalty, ends = None, 0.0, np.zeros(0, dtype=np.float32)
        if card.base is not None:
            self._penalty = residual_penalty
            self.base = baselines.make(card.base, scenario, num_worlds, device)
            self._base_action = np.zeros((num_worlds, scenario.num_robots, card.action_size), dtype=np.float32)
            self._adder = Adder(self._base_action.shape, card.residual)
            ends = np.ones(card.action_size, dtype=np.float32)
        self.low = np.concatenate([ranges.low[columns], -ends])
        self.high = np.concatenate([ranges.high[columns], ends])
        """Ranges of a row's entries, (inputs,)."""

    def reset(self, worlds: Any = None) -> None:
        """Let the base forget some worlds, by mask or index, or all."""
        if self.base is not None:
            self.base.reset(worlds)

    def read(self, observation: np.ndarray) -> np.ndarray:
        """Ask the base what it does, and return the rows (W, N, inputs) of observations (W, N, D)."""
        if self.base is not None:
            self._base_action = self.base.act(observation)
        return self.rows(observation)

    def rows(self, observation: np.ndarray) -> np.ndarray:
        """Rows (W, N, inputs) of observations (W, N, D), with what the base did last."""
        rows = observation if self._columns is None else observation[:, :, self._columns]
        return rows if self.base is None else np.concatenate([rows, self._base_action], axis=2)

    def actions(self, outputs: np.ndarray) -> np.ndarray:
        """Actions (W, N, action_size) that a learner's outputs of the same shape become."""
        return outputs if self.base is None else self._adder(self._base_action, outputs)

    def penalty(self, outputs: np.ndarray) -> np.ndarray:
        """Reward (W, N) that outputs in [-1, 1] cost, where there is a base."""
        if self._penalty == 0:
            return np.zeros(outputs.shape[:2], dtype=np.float32)
        return self._penalty * np.square(outputs).mean(axis=2)

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy what changes while the worlds go on, by name."""
        if self.base is None:
            return {}
        return prefixed("base", self.base.save_state()) | {"base_action": self._base_action}

    def load_state(self, saved: dict[str, np.ndarray]) -> None:
        """Go on from what `save_state` returned; other names are ignored."""
        if self.base is not None:
            self.base.load_state(within("base", saved))
            self._base_action = saved["base_action"]
