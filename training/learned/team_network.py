"""The network of a team as plain arrays: it maps what a robot perceives, any number of tokens, to its action.

A layer maps each token to features, which attention pools: each head has a query, computed from the robot's own
numbers, and returns the mean of the features with the weights softmax(query . features). Without heads, the features
are averaged over all slots for tokens, where those of an empty slot are zeros. With a memory, a gated recurrent unit
follows (Cho et al., EMNLP 2014).

Each world is computed by matrix products of its own, so that actions do not depend on the other worlds of a batch.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from training.learned.perception import OWN, TOKEN, Perception
from training.learned.rogue_network import numbers

_LAYERS = "own", "token", "query", "trunk", "memory.input", "memory.hidden", "last", "action"
_OPTIONAL = "query", "memory.input", "memory.hidden"
_ABSENT = 1e4
"""Number that is subtracted from the score of an absent token."""


@dataclass(frozen=True)
class TeamNetwork:
    """Network of all robots of a team, in float32.

    Raises:
        ValueError: layers are missing or do not fit together, or numbers are not finite.
    """

    weights: dict[str, np.ndarray]
    """Matrix (outputs, inputs) of each layer, by name: `query` only with attention, `memory.*` only with a memory."""
    biases: dict[str, np.ndarray]
    """Vector (outputs,) of each layer, by name."""

    inputs = 0
    """Number of `Card.inputs` that it requires: none, because it reads a `Perception`."""

    def __post_init__(self) -> None:
        for part in ("weights", "biases"):
            object.__setattr__(self, part, {name: numbers(part, array) for name, array in getattr(self, part).items()})
        names = set(self.weights)
        if not set(_LAYERS) - set(_OPTIONAL) <= names <= set(_LAYERS) or names != set(self.biases):
            raise ValueError(f"layers must be {', '.join(_LAYERS)}, got {', '.join(sorted(names))}")
        if ("memory.input" in names) != ("memory.hidden" in names):
            raise ValueError("layers must be both memory.input and memory.hidden, or neither, got one of them")
        sizes = {name: array.shape for name, array in self.weights.items()}
        if any(len(size) != 2 for size in sizes.values()):
            raise ValueError(f"weights must have shape (outputs, inputs), got {sizes}")
        own, features, hidden, memory = sizes["own"][0], sizes["token"][0], sizes["trunk"][0], self.memory
        heads = sizes["query"][0] // features if "query" in names else 1
        wanted = {"own": (own, len(OWN)), "token": (features, len(TOKEN)), "query": (heads * features, own)}
        wanted |= {"trunk": (hidden, own + heads * features), "last": (sizes["last"][0], hidden + memory)}
        wanted |= {"memory.input": (3 * memory, hidden), "memory.hidden": (3 * memory, memory)}
        wanted["action"] = (sizes["action"][0], sizes["last"][0])
        for name, size in sizes.items():
            if size != wanted[name] or self.biases[name].shape != size[:1]:
                got = f"{size} with a bias of shape {self.biases[name].shape}"
                raise ValueError(f"layer {name} must have shape {wanted[name]}, got {got}")

    @property
    def outputs(self) -> int:
        """Number of components of an action."""
        return self.weights["action"].shape[0]

    @property
    def memory(self) -> int:
        """Size of a robot's memory."""
        return self.weights["memory.hidden"].shape[1] if "memory.hidden" in self.weights else 0

    def __call__(self, seen: Perception, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the outputs (W, N, A), and the memory (W, N, memory) for the next step."""
        own = np.maximum(self._layer("own", seen.own), 0)
        worlds, robots, count, size = seen.tokens.shape
        features = np.maximum(self._layer("token", seen.tokens.reshape(worlds, robots * count, size)), 0)
        features = features.reshape(worlds, robots, count, -1)
        if "query" in self.weights:
            query = self._layer("query", own).reshape(worlds, robots, -1, features.shape[-1])
            score = query @ features.swapaxes(2, 3) + (seen.present[:, :, None] - 1) * np.float32(_ABSENT)
            weight = np.exp(score - score.max(axis=-1, keepdims=True))
            weight = weight / weight.sum(axis=-1, keepdims=True) * seen.present[:, :, None]
            pooled = (weight @ features).reshape(worlds, robots, -1)
        else:
            pooled = (features * seen.present[..., None]).mean(axis=2)
        hidden = np.maximum(self._layer("trunk", np.concatenate([own, pooled], axis=-1)), 0)
        if self.memory:
            memory = self._remember(hidden, memory)
            hidden = np.concatenate([hidden, memory], axis=-1)
        return self._layer("action", np.maximum(self._layer("last", hidden), 0)), memory

    def _layer(self, name: str, values: np.ndarray) -> np.ndarray:
        return values @ self.weights[name].T + self.biases[name]

    def _remember(self, values: np.ndarray, memory: np.ndarray) -> np.ndarray:
        """Return h' = (1 - z) n + z h with the reset gate r, the update gate z and the candidate n, as in PyTorch."""
        r, z, n = np.split(self._layer("memory.input", values), 3, axis=-1)
        r_old, z_old, n_old = np.split(self._layer("memory.hidden", memory), 3, axis=-1)
        r, z = 1 / (1 + np.exp(-r - r_old)), 1 / (1 + np.exp(-z - z_old))
        return (1 - z) * np.tanh(n + r * n_old) + z * memory

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays by name, as stored in a checkpoint."""
        named = {f"team.{name}.weight": array for name, array in self.weights.items()}
        return named | {f"team.{name}.bias": array for name, array in self.biases.items()}

    @classmethod
    def from_arrays(cls, arrays: dict[str, Any]) -> "TeamNetwork":
        """Return the network that `to_arrays` converted.

        Raises:
            ValueError: the arrays do not fit together.
        """
        parts = [
            {name[5 : -len(end)]: array for name, array in arrays.items() if name.endswith(end)}
            for end in (".weight", ".bias")
        ]
        return cls(*parts)
