"""The networks of learned policies as plain arrays: that of a team, and that of rogues.

Each world is computed by matrix products of its own, so that actions do not depend on the other worlds of a batch.
"""

from dataclasses import dataclass

import numpy as np

from lissajous_env.wording import few_of, require
from training.learned.perception import OWN, TOKEN, Perception

ABSENT = 1e4
"""Number that is subtracted from the score of an absent token."""


@dataclass(frozen=True)
class Network:
    """Layers y = W x + b of a network, in float32; its arrays are read-only copies.

    Raises:
        ValueError: layers are missing or do not fit together, or arrays are not finite numbers of type float32.
    """

    arrays: dict[str, np.ndarray]
    """W (outputs, inputs) of each layer as `LAYER.weight`, and b (outputs,) as `LAYER.bias`."""

    def __post_init__(self) -> None:
        arrays = {name: _numbers(name, array) for name, array in self.arrays.items()}
        object.__setattr__(self, "arrays", arrays)
        layers = [name.removesuffix(".weight") for name in arrays if name.endswith(".weight")]
        sizes = {layer: arrays[f"{layer}.weight"].shape for layer in layers}
        for layer, size in sizes.items():
            fits, rule = len(size) == 2 and 0 not in size, "must have shape (outputs, inputs), both at least 1"
            require(fits, f"{layer}.weight", rule, size)
        fitting = {f"{layer}.weight": size for layer, size in self._fitting(sizes).items() if layer in sizes}
        fitting |= {f"{layer}.bias": size[:1] for layer, size in sizes.items()}
        require(fitting.keys() == arrays.keys(), "arrays", f"must be {few_of(sorted(fitting))}", few_of(sorted(arrays)))
        for name, size in fitting.items():
            require(arrays[name].shape == size, name, f"must have shape {size}", arrays[name].shape)

    def _fitting(self, sizes: dict[str, tuple[int, ...]]) -> dict[str, tuple[int, int]]:
        """Return the shape that each layer must have to fit to the others, or raise ValueError for their names."""
        raise NotImplementedError

    def _layer(self, name: str, values: np.ndarray) -> np.ndarray:
        return values @ self.arrays[f"{name}.weight"].T + self.arrays[f"{name}.bias"]


class RogueNetwork(Network):
    """Network of rogues: y = W_k s(... s(W_0 x + b_0) ...) + b_k, with s(x) = max(x, 0) between the layers 0 to k."""

    def _fitting(self, sizes: dict[str, tuple[int, ...]]) -> dict[str, tuple[int, int]]:
        names = [str(k) for k in range(len(sizes))]
        if not names or set(names) != set(sizes):
            raise ValueError(f"layers must be 0, 1 and so on, at least one, got {few_of(sorted(sizes)) or 'none'}")
        inputs = [sizes["0"][1], *(sizes[name][0] for name in names[:-1])]
        return {name: (sizes[name][0], count) for name, count in zip(names, inputs, strict=True)}

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Return y (W, ..., outputs) for rows (W, ..., n), cut or padded with zeros to the size of x."""
        count = min(rows.shape[-1], self.inputs)
        values = rows[..., :count] @ self.arrays["0.weight"][:, :count].T + self.arrays["0.bias"]
        for k in range(1, len(self.arrays) // 2):
            values = self._layer(str(k), np.maximum(values, 0, out=values))
        return values

    @property
    def inputs(self) -> int:
        """Number of entries of x."""
        return self.arrays["0.weight"].shape[1]

    @property
    def outputs(self) -> int:
        """Number of entries of y."""
        return self.arrays[f"{len(self.arrays) // 2 - 1}.bias"].shape[0]


class TeamNetwork(Network):
    """Network of all robots of a team: it maps what a robot perceives, any number of tokens, to its action.

    A layer maps each token to features, which attention pools: each head has a query, computed from the robot's own
    numbers, and returns the mean of the features with the weights softmax(query . features). Without heads (no layer
    `query`), the features are averaged over all slots for tokens, where those of an empty slot are zeros.
    """

    inputs = 0
    """Number of `Card.inputs` that it requires: none, because it reads a `Perception`."""

    def _fitting(self, sizes: dict[str, tuple[int, ...]]) -> dict[str, tuple[int, int]]:
        required = {"own", "token", "trunk", "last", "action"}
        rule = f"must be {few_of(sorted(required))}, and perhaps query"
        require(set(sizes) - {"query"} == required, "layers", rule, few_of(sorted(sizes)))
        own, features, hidden = sizes["own"][0], sizes["token"][0], sizes["trunk"][0]
        heads = sizes["query"][0] // features if "query" in sizes else 1
        fitting = {"own": (own, len(OWN)), "token": (features, len(TOKEN)), "query": (heads * features, own)}
        fitting |= {"trunk": (hidden, own + heads * features), "last": (sizes["last"][0], hidden)}
        return fitting | {"action": (sizes["action"][0], sizes["last"][0])}

    @property
    def outputs(self) -> int:
        """Number of components of an action."""
        return self.arrays["action.bias"].shape[0]

    def __call__(self, perception: Perception) -> np.ndarray:
        """Return the outputs (W, N, A)."""
        own = np.maximum(self._layer("own", perception.own), 0)
        worlds, robots, count, size = perception.tokens.shape
        features = np.maximum(self._layer("token", perception.tokens.reshape(worlds, robots * count, size)), 0)
        features = features.reshape(worlds, robots, count, -1)
        if "query.weight" in self.arrays:
            query = self._layer("query", own).reshape(worlds, robots, -1, features.shape[-1])
            score = query @ features.swapaxes(2, 3) + (perception.present[:, :, None] - 1) * np.float32(ABSENT)
            weight = np.exp(score - score.max(axis=-1, keepdims=True))
            weight = weight / weight.sum(axis=-1, keepdims=True) * perception.present[:, :, None]
            pooled = (weight @ features).reshape(worlds, robots, -1)
        else:
            pooled = (features * perception.present[..., None]).mean(axis=2)
        hidden = np.maximum(self._layer("trunk", np.concatenate([own, pooled], axis=-1)), 0)
        return self._layer("action", np.maximum(self._layer("last", hidden), 0))


def _numbers(name: str, array: np.ndarray) -> np.ndarray:
    """Return a read-only copy of an array of finite float32 numbers."""
    require(array.dtype == np.float32, name, "must be float32", str(array.dtype))
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    copied = np.array(array, order="C")
    copied.setflags(write=False)
    return copied
