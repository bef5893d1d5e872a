"""The fit of a network that predicts the cost of each candidate from the numbers of a scenario."""

import numpy as np
import torch
from torch import nn

from training.choosing.chooser import outputs
from training.learned.network import Network

_MEMBERS, _UNITS = 16, 32
"""Networks whose mean is the result, and hidden units of each."""
_PASSES, _LEARNING_RATE, _DECAY = 150, 1e-2, 1.0
"""Steps of AdamW over all scenarios, its learning rate, and its weight decay."""
_LEFT_OUT = 4
"""One in so many scenarios is left out of the fit whose errors are measured."""


def fit(numbers: np.ndarray, costs: np.ndarray, seed: int) -> Network:
    """Return a network whose largest output belongs to the candidate with the smallest predicted cost.

    The mean of several small networks, each with other initial weights, predicts unseen scenarios better than one. As
    each has one hidden layer, their mean is a network with one hidden layer, too.

    Args:
        numbers: Numbers (S, F) of S scenarios.
        costs: Cost (S, K) of each of K candidates in each scenario; all finite.
        seed: Seed of the initial weights.
    """
    torch.manual_seed(seed)
    mean, deviation = numbers.mean(axis=0), numbers.std(axis=0)
    deviation = np.where(deviation > 0, deviation, 1.0)
    values = -(costs - costs.mean(axis=1, keepdims=True))
    inputs = torch.from_numpy((numbers - mean) / deviation)
    targets = torch.from_numpy(values - values.mean(axis=0))
    weights, biases, last_weights, last_biases = zip(*(_member(inputs, targets) for _ in range(_MEMBERS)), strict=True)
    first = np.concatenate(weights) / deviation
    first_bias = np.concatenate(biases) - first @ mean
    last = np.concatenate(last_weights, axis=1) / _MEMBERS
    last_bias = np.mean(last_biases, axis=0) + values.mean(axis=0)
    return Network((first, last), (first_bias, last_bias), "tanh")


def errors(numbers: np.ndarray, costs: np.ndarray, seed: int) -> np.ndarray:
    """Return the costs less the predicted ones (E, K) in every fourth scenario, predicted by a fit to the others.

    Both are relative to the mean over the candidates.
    """
    left = np.arange(len(costs)) % _LEFT_OUT == 0
    network = fit(numbers[~left], costs[~left], seed)
    predicted = -np.array([outputs(network, each) for each in numbers[left]])
    return costs[left] - costs[left].mean(axis=1, keepdims=True) - predicted


def _member(inputs: torch.Tensor, targets: torch.Tensor) -> list[np.ndarray]:
    """Return the weight and bias of both layers of one network after its fit."""
    made = nn.Sequential(nn.Linear(inputs.shape[1], _UNITS), nn.Tanh(), nn.Linear(_UNITS, targets.shape[1])).double()
    optimizer = torch.optim.AdamW(made.parameters(), lr=_LEARNING_RATE, weight_decay=_DECAY)
    for _ in range(_PASSES):
        optimizer.zero_grad()
        (made(inputs) - targets).square().mean().backward()
        optimizer.step()
    return [each.detach().numpy() for each in made.parameters()]
