"""Evaluation of a network in a kernel: a thread maps a few observations to actions, each row independently.

The action for a row is therefore bit-identical in any batch, at any position and for any number of threads, unlike with
a matrix product, whose rounding depends on the number of rows.

On a CPU the inner loop runs over the inputs, with WIDTH outputs of ROWS rows in vector registers, so that additions are
independent and each weight is read once for all these rows.
"""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.devices import compile_quietly, cores
from lissajous_env.device.work import shared_launch
from training.learned.network import Network

# Fuse a multiplication with the addition after it, and use whole vector registers.
_CPU_FLAGS = "-march=native -ffp-contract=fast -mprefer-vector-width=512"
wp.set_module_options({"enable_backward": False, "max_unroll": 1, "cpu_compiler_flags": _CPU_FLAGS})

WIDTH = wp.constant(32)
"""Number of outputs that are computed together."""
ROWS = wp.constant(4)
"""Number of rows per thread; `layer` is unrolled for them."""
SMALLEST_SHARE = 128
"""Smallest number of kernel threads for which another CPU thread is used."""

ABSURD = wp.constant(1.0e6)
"""Magnitude to which entries of the observation, of order 1, are clipped so that sums do not overflow."""

block = wp.types.vector(length=32, dtype=wp.float32)


@wp.struct
class Layers:
    """Layers of a network."""

    sizes: wp.array(dtype=wp.vec2i)
    """Number of inputs, and of blocks of outputs, of each layer."""
    weights: wp.array(dtype=block)
    """For each block of outputs: biases, then weights of each input, padded with zeros."""


@wp.func
def limited(x: float, bound: float) -> float:
    """Clip x to [-bound, bound]; NaN stays NaN, which a simulation reports."""
    return wp.where(x > bound, bound, wp.where(x < -bound, -bound, x))


@wp.func
def activated(y: block, is_last: bool) -> block:
    """Return max(y, 0) for each of a block's outputs, or those of the last layer as they are; NaN stays NaN."""
    if not is_last:
        for j in range(WIDTH):
            y[j] = wp.where(y[j] < 0.0, 0.0, y[j])
    return y


@wp.func
def layer(
    inputs: int,
    blocks: int,
    is_last: bool,
    first: int,
    weights: wp.array(dtype=block),
    row: int,
    x: wp.array2d(dtype=float),
    y_out: wp.array2d(dtype=block),
) -> int:
    """Write y = max(W x + b, 0) of one layer for ROWS rows from `row` on; return the index of the next layer's weights.

    The last layer is y = W x + b.
    """
    at = first
    for b in range(blocks):
        y0 = weights[at]
        y1 = weights[at]
        y2 = weights[at]
        y3 = weights[at]
        for j in range(inputs):
            at += 1
            y0 += x[row, j] * weights[at]
            y1 += x[row + 1, j] * weights[at]
            y2 += x[row + 2, j] * weights[at]
            y3 += x[row + 3, j] * weights[at]
        at += 1
        y_out[row, b] = activated(y0, is_last)
        y_out[row + 1, b] = activated(y1, is_last)
        y_out[row + 2, b] = activated(y2, is_last)
        y_out[row + 3, b] = activated(y3, is_last)
    return at


@wp.kernel
def act_by_network(
    layers: Layers,
    columns: wp.array(dtype=int),
    first: int,
    observation: wp.array3d(dtype=float),
    blocks: wp.array3d(dtype=block),
    values: wp.array3d(dtype=float),
    action_out: wp.array3d(dtype=float),
):
    """Write the actions of ROWS agents, the network's output, clipped to [-1, 1]; row w N + i is agent i of world w.

    The network reads the entries `columns` of the observation. Components of an action beyond its outputs are zero.
    Inputs and outputs of a layer are in `blocks` (2, rows, blocks); `values` (2, rows, numbers) is the same memory.
    """
    row = ROWS * (first + wp.tid())
    robots = observation.shape[1]
    end = wp.min(row + ROWS, observation.shape[0] * robots)
    for r in range(row, end):
        w, i = r // robots, r % robots
        for k in range(columns.shape[0]):
            values[0, r, k] = limited(observation[w, i, columns[k]], ABSURD)
    last = layers.sizes.shape[0] - 1
    at = int(0)
    for k in range(last + 1):
        of = layers.sizes[k]
        at = layer(of[0], of[1], k == last, at, layers.weights, row, values[k % 2], blocks[1 - k % 2])
    for r in range(row, end):
        w, i = r // robots, r % robots
        for k in range(action_out.shape[2]):
            own = float(0.0)
            if k < WIDTH * layers.sizes[last][1]:
                own = values[(last + 1) % 2, r, k]
            action_out[w, i, k] = limited(own, 1.0)


class Forward:
    """Recorded evaluation of a network for W N rows on a device; CPU threads share many rows.

    Args:
        network: Network to evaluate.
        columns: Indices of the observation's entries that it reads.
        observation: (W, N, D) array of observations.
        action: (W, N, action_size) array for the actions.
        threads: CPU threads; all cores by default.
    """

    def __init__(
        self,
        network: Network,
        columns: np.ndarray,
        observation: wp.array,
        action: wp.array,
        threads: int | None = None,
    ):
        device: Any = observation.device
        rows = observation.shape[0] * observation.shape[1]
        layers, width = _layers(network, device)
        tasks = -(-rows // int(ROWS))
        blocks = wp.zeros((2, tasks * int(ROWS), width), dtype=block, device=device)
        self._blocks = blocks  # whose memory the next array shows
        numbers = (*blocks.shape[:2], width * int(WIDTH))
        values = wp.array(ptr=blocks.ptr, shape=numbers, dtype=wp.float32, device=device)
        read = wp.array(np.asarray(columns, dtype=np.int32), dtype=wp.int32, device=device)

        def inputs(low: int) -> list[Any]:
            return [layers, read, low, observation, blocks, values]

        threads = threads or cores()
        with compile_quietly():
            self._work = shared_launch(act_by_network, tasks, inputs, [action], device, threads, SMALLEST_SHARE)

    def launch(self) -> None:
        """Write the actions for the observation."""
        self._work()


def _layers(network: Network, device: Any) -> tuple[Any, int]:
    """Return the kernel's constants, and the largest number of blocks of inputs or outputs of a layer."""
    packed, sizes = [], []
    for weight, bias in zip(network.weights, network.biases, strict=True):
        outputs, inputs = weight.shape
        blocks = _blocks_of(outputs)
        whole = np.zeros((blocks * WIDTH, 1 + inputs), dtype=np.float32)
        whole[:outputs, 0], whole[:outputs, 1:] = bias, weight
        packed.append(whole.reshape(blocks, WIDTH, 1 + inputs).transpose(0, 2, 1).reshape(-1, WIDTH))
        sizes.append((inputs, blocks))
    layers: Any = Layers()
    layers.sizes = wp.array(np.array(sizes), dtype=wp.vec2i, device=device)
    layers.weights = wp.array(np.concatenate(packed), dtype=block, device=device)
    return layers, max(_blocks_of(size) for size in (network.inputs, *network.hidden, network.outputs))


def _blocks_of(numbers: int) -> int:
    return -(-numbers // int(WIDTH))
