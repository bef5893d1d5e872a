"""Conversion between a learner and the worlds: observations to its input rows, its outputs to actions."""

from typing import Any

import numpy as np

from lissajous_env import Scenario
from lissajous_env.world.observation import layout
from training.learned.card import LARGEST_CONSTANT, Card, constants_of
from training.learned.checkpoint import prefixed, within


class Wiring:
    """Conversion for W worlds of N robots according to a card, in NumPy arrays.

    A row contains the entries of the observation and the constants of the scenario that the card lists and, if there is
    a base, the base's action of the latest `read`.

    Args:
        card: Inputs of the learner, and the base to which its outputs are added.
        scenario: Scenario of the worlds.
        num_worlds: W.
        device: Warp device of the base.

    Raises:
        ValueError: the scenario's robots or observation do not fit the card.
    """

    def __init__(self, card: Card, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu"):
        ranges, columns = layout(scenario), card.columns(scenario)
        self._columns = None if np.array_equal(columns, np.arange(ranges.size)) else columns
        ends = np.zeros(0, dtype=np.float32)
        self.base, self._residual = card.make_base(scenario, num_worlds, device), card.residual
        constants = constants_of(scenario, card.constants)
        self._constants = np.broadcast_to(constants, (num_worlds, scenario.num_robots, len(constants)))
        if self.base is not None:
            self._base_action = np.zeros((num_worlds, scenario.num_robots, card.action_size), dtype=np.float32)
            ends = np.ones(card.action_size, dtype=np.float32)
        self.low = np.concatenate([ranges.low[columns], 0 * constants, -ends])
        self.high = np.concatenate([ranges.high[columns], 0 * constants + LARGEST_CONSTANT, ends])
        """Upper ends of the ranges of a row's entries, (inputs,); `low` are the lower ones."""

    def reset(self, worlds: Any = None) -> None:
        """Reset the base for some worlds, by mask or index, or for all."""
        if self.base is not None:
            self.base.reset(worlds)

    def read(self, observation: np.ndarray) -> np.ndarray:
        """Compute the base's actions, and return the rows (W, N, inputs) of observations (W, N, D)."""
        if self.base is not None:
            self._base_action = self.base.act(observation)
        return self.rows(observation)

    def rows(self, observation: np.ndarray) -> np.ndarray:
        """Return the rows (W, N, inputs) of observations (W, N, D), with the base's latest actions."""
        rows = observation if self._columns is None else observation[:, :, self._columns]
        parts = [rows] + [self._constants] * (self._constants.shape[2] > 0)
        parts += [] if self.base is None else [self._base_action]
        return rows if len(parts) == 1 else np.concatenate(parts, axis=2)

    def actions(self, outputs: np.ndarray) -> np.ndarray:
        """Return the actions (W, N, action_size) for a learner's outputs of the same shape."""
        return outputs if self.base is None else sum_of_actions(self._base_action, self._residual, outputs)

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy everything that changes during steps, by name."""
        if self.base is None:
            return {}
        return prefixed("base", self.base.save_state()) | {"base_action": self._base_action}

    def load_state(self, saved: dict[str, np.ndarray]) -> None:
        """Resume from what `save_state` returned; other names are ignored."""
        if self.base is not None:
            self.base.load_state(within("base", saved))
            self._base_action = saved["base_action"]


def sum_of_actions(base: np.ndarray, residual: float, own: np.ndarray) -> np.ndarray:
    """Return the actions in [-1, 1] for a base's actions and those of a network, to the bits of the kernel."""
    total = base.astype(np.float64) + np.float64(np.float32(residual)) * np.clip(own.astype(np.float32), -1.0, 1.0)
    return np.clip(total, -1.0, 1.0).astype(np.float32)
