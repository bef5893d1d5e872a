"""The network of learned rogues as plain arrays."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from lissajous_env.wording import few_of


@dataclass(frozen=True)
class RogueNetwork:
    """Network of rogues: y = W_k s(... s(W_1 x + b_1) ...) + b_k in float32, with s(x) = max(x, 0) between layers.

    Its arrays are read-only copies.

    Raises:
        ValueError: layers do not fit together or are empty, or numbers are not finite in float32.
    """

    weights: tuple[np.ndarray, ...]
    """W of each layer, (outputs, inputs)."""
    biases: tuple[np.ndarray, ...]
    """b of each layer, (outputs,)."""

    def __post_init__(self) -> None:
        if not len(self.weights) or len(self.weights) != len(self.biases):
            count = f"{len(self.weights)} and {len(self.biases)}"
            raise ValueError(f"weights and biases must have the same number of layers, at least one, got {count}")
        for name in ("weights", "biases"):
            object.__setattr__(self, name, tuple(numbers(name, array) for array in getattr(self, name)))
        for weight, bias in zip(self.weights, self.biases, strict=True):
            if weight.ndim != 2 or 0 in weight.shape:
                raise ValueError(f"weights must have shape (outputs, inputs), both at least 1, got {weight.shape}")
            if bias.shape != weight.shape[:1]:
                raise ValueError(f"bias must have shape {weight.shape[:1]}, got {bias.shape}")
        for before, after in pairwise(self.weights):
            if after.shape[1] != before.shape[0]:
                raise ValueError(
                    f"layer must have {before.shape[0]} inputs, the outputs of the previous, got {after.shape[1]}"
                )

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        """Return y (W, ..., outputs) for rows (W, ..., n), cut or padded with zeros to the size of x.

        Each world is computed by matrix products of its own, so that it does not depend on the others of a batch.
        """
        count = min(rows.shape[-1], self.inputs)
        values = rows[..., :count] @ self.weights[0][:, :count].T
        values += self.biases[0]
        for weight, bias in zip(self.weights[1:], self.biases[1:], strict=True):
            values = np.maximum(values, 0, out=values) @ weight.T
            values += bias
        return values

    @property
    def inputs(self) -> int:
        """Number of entries of x."""
        return self.weights[0].shape[1]

    @property
    def outputs(self) -> int:
        """Number of entries of y."""
        return self.weights[-1].shape[0]

    @property
    def hidden(self) -> tuple[int, ...]:
        """Sizes of the hidden layers."""
        return tuple(weight.shape[0] for weight in self.weights[:-1])

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays by name, as stored in a checkpoint: `policy.K.weight`, `policy.K.bias` of layer K."""
        named = {}
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            named |= {f"policy.{k}.weight": weight, f"policy.{k}.bias": bias}
        return named

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray]) -> "RogueNetwork":
        """Return the network that `to_arrays` converted; other arrays are ignored.

        Raises:
            ValueError: the arrays do not fit together.
        """
        count = sum(name.startswith("policy.") and name.endswith(".weight") for name in arrays)
        try:
            weights = tuple(arrays[f"policy.{k}.weight"] for k in range(count))
            biases = tuple(arrays[f"policy.{k}.bias"] for k in range(count))
        except KeyError as error:
            raise ValueError(f"weights must contain {error.args[0]}, got {few_of(sorted(arrays))}") from None
        return cls(weights, biases)


def numbers(name: str, array: Any) -> np.ndarray:
    """Return a read-only float32 copy of an array; `name` is that of errors.

    Raises:
        ValueError: the array has other contents than finite numbers.
    """
    given = np.asarray(array)
    if given.dtype.kind not in "fiu":
        raise ValueError(f"{name} must be numbers, got an array of {given.dtype}")
    with np.errstate(over="ignore"):
        copied = np.array(given, dtype=np.float32, order="C")
    if not np.isfinite(copied).all():
        raise ValueError("weights and biases must be finite in float32")
    copied.setflags(write=False)
    return copied
