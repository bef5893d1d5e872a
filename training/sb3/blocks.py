"""Gradients of a policy by blocks of rows, on threads and over buffers that are made once.

Torch's own threads meet after each operation, which for networks as small as these takes as long as to compute, and
much longer where other programs want the same cores. Here a thread takes blocks of rows all the way, forward and
backward, and the hidden layers of a block stay in its cache. Blocks are of one size and are summed in their order: what
is learned does not depend on how many threads there are.
"""

import copy
import math
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any, cast

import torch
from stable_baselines3.common.distributions import DiagGaussianDistribution
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn

BLOCK = 4096
"""Rows of a block on a CPU."""

_HALF_LOG_TWO_PI = 0.5 * math.log(2 * math.pi)

Loss = Callable[[ActorCriticPolicy, Sequence[torch.Tensor]], tuple[torch.Tensor, torch.Tensor]]
"""Of some rows: their share of the loss, and numbers about it, which are summed over the blocks."""


class Blocks:
    """A policy, ready to be evaluated and differentiated on some threads.

    `parameters` lists its parameters, once: to gather them takes torch as long as a small batch does.

    Args:
        policy: What is learned; it keeps its weights, which all threads share.
        threads: Most threads of a CPU; a GPU takes all rows at once.
    """

    def __init__(self, policy: ActorCriticPolicy, threads: int):
        self.parameters = list(policy.parameters())
        self._block = BLOCK if policy.device.type == "cpu" else None
        self._workers = [_own(policy) for _ in range(threads if self._block else 1)]
        self._begin_pool()

    def _begin_pool(self) -> None:
        self._pool = ThreadPoolExecutor(max(len(self._workers) - 1, 1), thread_name_prefix="lissajous")
        self._process = os.getpid()

    def differentiate(self, loss: Loss, tensors: Sequence[torch.Tensor], chosen: torch.Tensor) -> torch.Tensor:
        """Put the gradient of the loss over the chosen rows into the parameters that learn, and return its numbers."""
        learning = [parameter for parameter in self.parameters if parameter.requires_grad]

        def work(policy: ActorCriticPolicy, block: slice) -> tuple[torch.Tensor, tuple[torch.Tensor, ...]]:
            value, numbers = loss(policy, [tensor.index_select(0, chosen[block]) for tensor in tensors])
            return numbers.detach(), torch.autograd.grad(value, learning, allow_unused=True)

        numbers, gradients = zip(*self._map(work, len(chosen)), strict=True)
        for parameter, *parts in zip(learning, *gradients, strict=True):
            several = len(parts) > 1 and parts[0] is not None
            parameter.grad = torch.stack(parts).sum(0) if several else parts[0]
        return torch.stack(numbers).sum(0)

    def values(self, rows: torch.Tensor) -> torch.Tensor:
        """What the critic expects after each row."""

        def work(policy: ActorCriticPolicy, block: slice) -> torch.Tensor:
            with torch.no_grad():
                # A copy: the next block takes the same buffers.
                return policy.predict_values(rows[block]).flatten().clone()

        return torch.cat(self._map(work, len(rows)))

    def _map(self, work: Callable[[ActorCriticPolicy, slice], Any], rows: int) -> list[Any]:
        """What `work` returns for each block of some rows, in their order."""
        size = self._block or rows
        blocks = [slice(first, min(first + size, rows)) for first in range(0, rows, size)]
        found: list[Any] = [None] * len(blocks)
        threads = min(len(self._workers), len(blocks))

        def run(first: int) -> None:
            for k in range(first, len(blocks), threads):
                found[k] = work(self._workers[first], blocks[k])

        if self._process != os.getpid():  # threads do not survive a fork
            self._begin_pool()
        waiting = [self._pool.submit(run, first) for first in range(1, threads)]
        run(0)
        for future in waiting:
            future.result()
        return found


def _own(policy: ActorCriticPolicy) -> ActorCriticPolicy:
    """Copy what a thread needs of its own: layers with buffers, and the distribution, which keeps its latest rows."""
    own = copy.copy(policy)
    own._modules = dict(policy._modules)
    actor, critic = policy.mlp_extractor.policy_net, policy.mlp_extractor.value_net
    if isinstance(policy.action_dist, DiagGaussianDistribution):
        own.action_dist = _Gaussian(policy.action_dist.action_dim)
        towers = _Towers(_Tower([*actor, policy.action_net]), _Tower([*critic, policy.value_net]))
        own.action_net = nn.Identity()
    else:
        # The noise of gSDE is a function of the last hidden layer.
        own.action_dist = copy.copy(policy.action_dist)
        first = next(layer for layer in (*actor, policy.action_net) if isinstance(layer, nn.Linear))
        towers = _Towers(_Tower(actor, first.in_features), _Tower([*critic, policy.value_net]))
    own.mlp_extractor, own.value_net = towers, nn.Identity()  # type: ignore[assignment]
    return own


class _Gaussian(DiagGaussianDistribution):
    """The library's normal distribution in closed form, without the checks that torch's makes at each use."""

    def proba_distribution(self, mean_actions: torch.Tensor, log_std: torch.Tensor) -> "_Gaussian":
        """Take means (rows, components) and logarithms of standard deviations (components,)."""
        self._mean, self._log_std = mean_actions, log_std
        return self

    def log_prob(self, actions: torch.Tensor) -> torch.Tensor:
        """Logarithm of the density at actions, (rows,)."""
        apart = ((actions - self._mean) * (-self._log_std).exp()).square().sum(1)
        return -0.5 * apart - self._log_std.sum() - len(self._log_std) * _HALF_LOG_TWO_PI

    def entropy(self) -> torch.Tensor:
        """Entropy, (rows,)."""
        each = self._log_std.sum() + len(self._log_std) * (0.5 + _HALF_LOG_TWO_PI)
        return each.expand(len(self._mean))

    def mode(self) -> torch.Tensor:
        """Means."""
        return self._mean


class _Towers(nn.Module):
    """What the policy takes for its extractor of features: the layers of actor and critic."""

    def __init__(self, actor: "_Tower", critic: "_Tower"):
        super().__init__()
        self.actor, self.critic = actor, critic

    def forward(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Outputs of both."""
        return self.actor(rows), self.critic(rows)

    def forward_actor(self, rows: torch.Tensor) -> torch.Tensor:
        """Output of the actor."""
        return self.actor(rows)

    def forward_critic(self, rows: torch.Tensor) -> torch.Tensor:
        """Output of the critic."""
        return self.critic(rows)


class _Tower:
    """Linear layers, with ReLU or tanh where one follows, forward and backward over the same buffers: a pass at a time.

    It reads the first `inputs` entries of a row, by default as many as its first layer does.
    """

    def __init__(self, modules: Iterable[nn.Module], inputs: int | None = None):
        modules = list(modules)
        self._layers = [layer for layer in modules if isinstance(layer, nn.Linear)]
        self._inputs = inputs or self._layers[0].in_features
        self._bends = [type(after) for layer, after in pairwise([*modules, None]) if isinstance(layer, nn.Linear)]
        self._buffers: list[tuple[torch.Tensor, torch.Tensor]] = []

    def __call__(self, rows: torch.Tensor) -> torch.Tensor:
        rows = rows[:, : self._inputs]
        if not self._layers:
            return rows
        weights = (parameter for layer in self._layers for parameter in (layer.weight, layer.bias))
        return cast(torch.Tensor, _Pass.apply(self, rows, *weights))

    def outputs(self, rows: torch.Tensor) -> list[torch.Tensor]:
        """What each layer makes of the rows, in this tower's buffers."""
        if not self._buffers or len(self._buffers[0][0]) < len(rows):
            shapes = [(len(rows), layer.out_features) for layer in self._layers]
            self._buffers = [(rows.new_empty(shape), rows.new_empty(shape)) for shape in shapes]
        found = []
        for layer, bend, (buffer, _) in zip(self._layers, self._bends, self._buffers, strict=True):
            rows = torch.addmm(layer.bias, rows, layer.weight.t(), out=buffer[: len(rows)])
            if bend is nn.ReLU:
                rows.relu_()
            elif bend is nn.Tanh:
                rows.tanh_()
            found.append(rows)
        return found

    def gradients(self, rows: torch.Tensor, outputs: Sequence[torch.Tensor], by_last: torch.Tensor) -> list[Any]:
        """Gradients by each weight and bias, from the one by the last layer's outputs."""
        found: list[torch.Tensor] = []
        by_output = by_last
        for k in reversed(range(len(self._layers))):
            by_sum = self._buffers[k][1][: len(rows)]
            if self._bends[k] is nn.ReLU:
                torch.ops.aten.threshold_backward.grad_input(by_output, outputs[k], 0, grad_input=by_sum)
            elif self._bends[k] is nn.Tanh:
                torch.ops.aten.tanh_backward.grad_input(by_output, outputs[k], grad_input=by_sum)
            else:
                by_sum = by_output
            found = [by_sum.t().mm(outputs[k - 1] if k else rows), by_sum.sum(0), *found]
            if k:
                by_output = torch.mm(by_sum, self._layers[k].weight, out=self._buffers[k - 1][1][: len(rows)])
        return found


class _Pass(torch.autograd.Function):
    """A pass over a tower, for torch to differentiate."""

    @staticmethod
    def forward(context: Any, tower: _Tower, rows: torch.Tensor, *_: torch.Tensor) -> torch.Tensor:  # type: ignore[override]
        """Last hidden layer."""
        context.tower, context.rows, context.outputs = tower, rows, tower.outputs(rows)
        return context.outputs[-1].view_as(context.outputs[-1])

    @staticmethod
    def backward(context: Any, by_last: torch.Tensor) -> Any:  # type: ignore[override]
        """Gradients by the parameters."""
        return None, None, *context.tower.gradients(context.rows, context.outputs, by_last)
