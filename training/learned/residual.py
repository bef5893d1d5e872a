"""Sum of a classical policy's action and a learned one: action = clip(base + residual * clip(own)), all in [-1, 1].

T. Johannink et al., "Residual Reinforcement Learning for Robot Control" (ICRA 2019). Training and evaluation launch
the same function, so that a policy acts bit for bit as it was trained.
"""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.copies import Copyable
from lissajous_env.device.devices import compile_quietly

# Fuse a multiplication with the addition after it, and use whole vector registers.
_CPU_FLAGS = "-march=native -ffp-contract=fast -mprefer-vector-width=512"
OPTIONS = {"enable_backward": False, "max_unroll": 1, "cpu_compiler_flags": _CPU_FLAGS}
"""Compiler options of the kernels of learned policies."""

wp.set_module_options(OPTIONS)


@wp.func
def limited(x: float, bound: float) -> float:
    """Clip x to [-bound, bound]; NaN stays NaN, which a simulation reports."""
    return wp.where(x > bound, bound, wp.where(x < -bound, -bound, x))


@wp.func
def added(base: float, residual: float, own: float) -> float:
    """Return clip(base + residual * clip(own))."""
    return limited(base + residual * limited(own, 1.0), 1.0)


@wp.kernel
def add(
    base: wp.array3d(dtype=float), residual: float, own: wp.array3d(dtype=float), action_out: wp.array3d(dtype=float)
):
    """Add each component of an action to the base's."""
    w, i, k = wp.tid()
    action_out[w, i, k] = added(base[w, i, k], residual, own[w, i, k])


class Adder(Copyable):
    """Function on the host that adds actions of one shape to a base's."""

    def __init__(self, shape: tuple[int, ...], residual: float):
        base, own, action = (wp.zeros(shape, dtype=wp.float32, device="cpu") for _ in range(3))
        self._base, self._own, self._action = base.numpy(), own.numpy(), action.numpy()
        with compile_quietly():
            self._launch: Any = wp.launch(
                add, shape, inputs=[base, residual, own], outputs=[action], device="cpu", record_cmd=True
            )

    def __call__(self, base: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Return the actions in [-1, 1] for a base's actions and those added to them."""
        self._base[:], self._own[:] = base, own
        self._launch.launch()
        return self._action.copy()
