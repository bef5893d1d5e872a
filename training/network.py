"""The network of a policy: a multilayer perceptron, as plain arrays that NumPy or torch evaluates."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

_NUMPY_ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "relu": lambda x: np.maximum(x, 0.0, out=x),
    "tanh": lambda x: np.tanh(x, out=x),
}
ACTIVATIONS = tuple(_NUMPY_ACTIVATIONS)


@dataclass(frozen=True)
class Network:
    """y = W_k s(... s(W_1 x + b_1) ...) + b_k: float32, the activation s between layers, none after the last."""

    weights: tuple[np.ndarray, ...]
    """W of each layer, (outputs, inputs)."""
    biases: tuple[np.ndarray, ...]
    """b of each layer, (outputs,)."""
    activation: str
    """relu or tanh."""

    def __post_init__(self) -> None:
        if self.activation not in ACTIVATIONS:
            raise ValueError(f"activation must be one of {', '.join(ACTIVATIONS)}, got {self.activation!r}")
        if not self.weights or len(self.weights) != len(self.biases):
            count = f"{len(self.weights)} and {len(self.biases)}"
            raise ValueError(f"weights and biases must be of the same layers, at least one, got {count}")
        for weight, bias in zip(self.weights, self.biases, strict=True):
            if weight.ndim != 2 or bias.shape != weight.shape[:1]:
                raise ValueError(f"bias must have shape {weight.shape[:1]}, got {bias.shape}")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise ValueError("weights and biases must be finite")
        for before, after in pairwise(self.weights):
            if after.shape[1] != before.shape[0]:
                raise ValueError(f"layer must take the {before.shape[0]} outputs before it, got {after.shape[1]}")

    @property
    def inputs(self) -> int:
        """Entries of x."""
        return self.weights[0].shape[1]

    @property
    def outputs(self) -> int:
        """Entries of y."""
        return self.weights[-1].shape[0]

    @property
    def hidden(self) -> tuple[int, ...]:
        """Sizes of the layers between."""
        return tuple(weight.shape[0] for weight in self.weights[:-1])

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Outputs (rows, outputs) for inputs (rows, inputs), both float32."""
        activate = _NUMPY_ACTIVATIONS[self.activation]
        last = len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = x @ weight.T
            x += bias
            if k < last:
                x = activate(x)
        return x

    def to_torch(self, device: Any) -> Any:
        """Make the same network as a `torch.nn.Sequential` on a device, without gradients."""
        import torch
        from torch import nn

        activation = {"relu": nn.ReLU, "tanh": nn.Tanh}[self.activation]
        layers: list[nn.Module] = []
        for weight, bias in zip(self.weights, self.biases, strict=True):
            layer = nn.Linear(weight.shape[1], weight.shape[0])
            layer.weight.data = torch.from_numpy(weight.copy())
            layer.bias.data = torch.from_numpy(bias.copy())
            layers += [layer, activation()]
        return nn.Sequential(*layers[:-1]).to(device).requires_grad_(False)

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Arrays by name, as a checkpoint stores them: `policy.K.weight`, `policy.K.bias` of layer K."""
        named = {}
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            named |= {f"policy.{k}.weight": weight, f"policy.{k}.bias": bias}
        return named

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray], activation: str) -> "Network":
        """Make the network of `to_arrays`; other arrays are ignored.

        Raises:
            ValueError: the arrays do not fit together.
        """
        count = sum(name.startswith("policy.") and name.endswith(".weight") for name in arrays)
        try:
            weights = tuple(np.ascontiguousarray(arrays[f"policy.{k}.weight"], dtype=np.float32) for k in range(count))
            biases = tuple(np.ascontiguousarray(arrays[f"policy.{k}.bias"], dtype=np.float32) for k in range(count))
        except KeyError as error:
            raise ValueError(f"weights must hold {error.args[0]}, got {', '.join(sorted(arrays))}") from None
        return cls(weights, biases, activation)
