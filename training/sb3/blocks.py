"""Gradients of a policy by blocks of rows, on threads and over buffers that are made once.

Torch's own threads meet after each operation, which for networks as small as these takes as long as to compute, and
much longer where other programs want the same cores. Here a thread takes blocks of rows all the way, forward and
backward, and the hidden layers of a block stay in its cache. Blocks are of one size and are summed in their order: what
is learned does not depend on how many threads there are.
"""

import copy
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, cast

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn

from lissajous_env.device.devices import side_by_side

BLOCK = 2048
"""Rows of a block on a CPU."""

Loss = Callable[[ActorCriticPolicy, Sequence[torch.Tensor]], tuple[torch.Tensor, torch.Tensor]]
"""Of some rows: their share of the loss, and numbers about it, which are summed over the blocks."""


class Blocks:
    """A policy, ready to be differentiated on some threads.

    Args:
        policy: What is learned; it keeps its weights, which all threads share.
        threads: Most threads of a CPU; a GPU takes all rows at once.
    """

    def __init__(self, policy: ActorCriticPolicy, threads: int):
        self._policy = policy
        self._block = BLOCK if policy.device.type == "cpu" else None
        self._workers = [_own(policy) for _ in range(threads if self._block else 1)]

    def differentiate(self, loss: Loss, rows: Sequence[torch.Tensor]) -> torch.Tensor:
        """Put the gradient of the loss over all rows into the parameters that learn, and return its numbers."""
        learning = [parameter for parameter in self._policy.parameters() if parameter.requires_grad]
        blocks = list(zip(*(each.split(self._block or len(each)) for each in rows), strict=True))
        found: list[Any] = [None] * len(blocks)
        threads = min(len(self._workers), len(blocks))

        def work(first: int) -> None:
            for k in range(first, len(blocks), threads):
                value, numbers = loss(self._workers[first], blocks[k])
                found[k] = numbers.detach(), torch.autograd.grad(value, learning, allow_unused=True)

        side_by_side([partial(work, first) for first in range(threads)], threads)
        numbers, gradients = zip(*found, strict=True)
        for parameter, *parts in zip(learning, *gradients, strict=True):
            parameter.grad = None if parts[0] is None else torch.stack(parts).sum(0)
        return torch.stack(numbers).sum(0)


def _own(policy: ActorCriticPolicy) -> ActorCriticPolicy:
    """Copy what a thread needs of its own: the distribution, which remembers its latest rows, and the hidden layers."""
    own = copy.copy(policy)
    own._modules = dict(policy._modules)
    own.action_dist = copy.copy(policy.action_dist)
    own.mlp_extractor = _TwoTowers(policy.mlp_extractor)  # type: ignore[assignment]
    return own


class _TwoTowers(nn.Module):
    """Hidden layers of actor and critic; each reads as many entries of a row as it has inputs."""

    def __init__(self, extractor: Any):
        super().__init__()
        self.actor, self.critic = _Tower(extractor.policy_net), _Tower(extractor.value_net)

    def forward(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Last hidden layers of both."""
        return self.forward_actor(rows), self.forward_critic(rows)

    def forward_actor(self, rows: torch.Tensor) -> torch.Tensor:
        """Last hidden layer of the actor."""
        return self.actor(rows)

    def forward_critic(self, rows: torch.Tensor) -> torch.Tensor:
        """Last hidden layer of the critic."""
        return self.critic(rows)


class _Tower:
    """Layers of ReLU or tanh, forward and backward over the same buffers: one pass at a time."""

    def __init__(self, net: nn.Sequential):
        self._layers = [layer for layer in net if isinstance(layer, nn.Linear)]
        self._of_tanh = any(isinstance(layer, nn.Tanh) for layer in net)
        self._buffers: list[tuple[torch.Tensor, torch.Tensor]] = []

    def __call__(self, rows: torch.Tensor) -> torch.Tensor:
        if not self._layers:
            return rows
        weights = (parameter for layer in self._layers for parameter in (layer.weight, layer.bias))
        return cast(torch.Tensor, _Pass.apply(self, rows[:, : self._layers[0].in_features], *weights))

    def outputs(self, rows: torch.Tensor) -> list[torch.Tensor]:
        """What each layer makes of the rows, in this tower's buffers."""
        if not self._buffers or len(self._buffers[0][0]) < len(rows):
            shapes = [(len(rows), layer.out_features) for layer in self._layers]
            self._buffers = [(rows.new_empty(shape), rows.new_empty(shape)) for shape in shapes]
        found = []
        for layer, (buffer, _) in zip(self._layers, self._buffers, strict=True):
            rows = torch.addmm(layer.bias, rows, layer.weight.t(), out=buffer[: len(rows)])
            found.append(rows.tanh_() if self._of_tanh else rows.relu_())
        return found

    def gradients(self, rows: torch.Tensor, outputs: Sequence[torch.Tensor], by_last: torch.Tensor) -> list[Any]:
        """Gradients by each weight and bias, from the one by the last layer's outputs."""
        found: list[torch.Tensor] = []
        by_output = by_last
        for k in reversed(range(len(self._layers))):
            by_sum = self._buffers[k][1][: len(rows)]
            if self._of_tanh:
                torch.ops.aten.tanh_backward.grad_input(by_output, outputs[k], grad_input=by_sum)
            else:
                torch.ops.aten.threshold_backward.grad_input(by_output, outputs[k], 0, grad_input=by_sum)
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
