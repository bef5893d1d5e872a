"""Fit the prior of a portfolio anew: `python benchmarks/prior.py portfolio --scenarios 400 --episodes 8 --seed 0`.

Each patrol of the portfolio is played in scenarios of the split `train` of a space. A network, the mean of 16 small
ones, is fitted to the costs of the patrols (`baselines.planning.rehearse`) less the smallest one in the scenario; its
errors are measured in every fourth scenario, with a network that is fitted to the others. The result replaces
`baselines/planning/priors/NAME.json`, from which the patrols are read: edit the list there to try others. The table
compares each patrol with the network's choice, without rehearsals, on the split `validation`. If the command is
interrupted and called again, it resumes. It takes 20 to 40 minutes on two cores.
"""

import argparse
import dataclasses
import itertools
import json
import math
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import figures
import numpy as np
import torch
from torch import nn

from baselines.planning.plans import absolute
from baselines.planning.portfolio import (
    DETECTION,
    FOLDER,
    MOST_COLLISIONS,
    NAMES,
    Layer,
    Prior,
    cost_of,
    costs_of,
    features_of,
    result_of,
)
from baselines.policies.settings import PolicySettings
from lissajous_env import Scenario, ScenarioSpace, scenario, scenario_space
from lissajous_env.parameters.assumptions import quietly

FIRST_SEED = 900_000
LONGEST = 20.0
"""Largest time of a patrol that counts, over the shortest of all patrols; one that does not suit a scenario has it."""
MARGIN = 1.0
"""Largest distance of a number of a scenario from those of the space and its shifts, as a share of their range."""
MEMBERS, UNITS = 16, 32
"""Networks whose mean is the result, and hidden units of each."""
PASSES, LEARNING_RATE, DECAY = 150, 1e-2, 1.0
"""Steps of AdamW over all scenarios, its learning rate, and its weight decay."""


def scenarios_of(space: ScenarioSpace, split: str, count: int, objective: str) -> Iterator[Scenario]:
    """Yield the first scenarios of a split or shift, without the fields that the objective does not need."""
    spare: dict[str, Any] = {"task.grid": None} | ({"task.contamination": None} if objective == DETECTION else {})
    for drawn in itertools.islice(space.scenarios(split), count):
        yield scenario(drawn, **spare)


def label(patrol: PolicySettings) -> str:
    """Return the name of a patrol for tables, such as `sweep-safe(cruise=0.9)`."""
    parameters = ", ".join(f"{name}={value}" for name, value in patrol.parameters.items())
    return f"{patrol.policy}({parameters})" if parameters else patrol.policy


def results(path: Path, prior: Prior, tasks: Sequence[Scenario], episodes: int) -> np.ndarray:
    """Return the time [s] and the collisions (S, K, 2) of each patrol in each scenario; play what is not in the file.

    A patrol that does not suit a scenario has an infinite time there.
    """
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    known = {tuple(key): result for key, result in map(json.loads, lines)}

    def played(task: Scenario) -> list[Any]:
        rows = []
        for patrol in prior.patrols:
            key = task.digest(), label(patrol), episodes
            if key not in known:
                result = result_of(absolute(patrol, task), task, episodes, prior.objective, FIRST_SEED)
                known[key] = (math.inf, MOST_COLLISIONS) if result is None else result
                rows.append((key, known[key]))
        return rows

    with path.open("a", encoding="utf-8") as file, ThreadPoolExecutor(os.cpu_count()) as threads:
        for k, rows in enumerate(threads.map(played, tasks), start=1):
            file.writelines(json.dumps(row) + "\n" for row in rows)
            file.flush()
            print(f"{k} of {len(tasks)} scenarios", flush=True)
    table = np.array([[known[task.digest(), label(patrol), episodes] for patrol in prior.patrols] for task in tasks])
    steps = np.array([task.task.step for task in tasks])
    times = np.maximum(table[..., 0], steps[:, None])
    return np.stack([np.minimum(times, LONGEST * times.min(axis=1, keepdims=True)), table[..., 1]], axis=-1)


def costs(table: np.ndarray) -> np.ndarray:
    """Return the cost (S, K) of each patrol less that of the shortest time in the scenario, from `results`."""
    times, collisions = table[..., 0], table[..., 1]
    return cost_of(times / times.min(axis=1, keepdims=True), collisions)


def fit(numbers: np.ndarray, wanted: np.ndarray, seed: int) -> tuple[Layer, Layer]:
    """Return the layers of a network that predicts costs.

    The mean of several small networks, each with other initial weights, predicts unseen scenarios better than one. As
    each has one hidden layer, their mean is a network with one hidden layer, too.

    Args:
        numbers: Numbers (S, F) of S scenarios.
        wanted: Cost (S, K) of each of K patrols in each scenario.
        seed: Seed of the initial weights.
    """
    torch.manual_seed(seed)
    mean, deviation = numbers.mean(axis=0), numbers.std(axis=0)
    deviation = np.where(deviation > 0, deviation, 1.0)
    values = -(wanted - wanted.mean(axis=1, keepdims=True))
    inputs = torch.from_numpy((numbers - mean) / deviation)
    targets = torch.from_numpy(values - values.mean(axis=0))
    weights, biases, last_weights, last_biases = zip(*(member(inputs, targets) for _ in range(MEMBERS)), strict=True)
    first = np.concatenate(weights) / deviation
    last_bias = np.mean(last_biases, axis=0) + values.mean(axis=0)
    return Layer(first, np.concatenate(biases) - first @ mean), Layer(
        np.concatenate(last_weights, axis=1) / MEMBERS, last_bias
    )


def member(inputs: torch.Tensor, targets: torch.Tensor) -> list[np.ndarray]:
    """Return the weight and bias of both layers of one network after its fit."""
    network = nn.Sequential(nn.Linear(inputs.shape[1], UNITS), nn.Tanh(), nn.Linear(UNITS, targets.shape[1])).double()
    optimizer = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=DECAY)
    for _ in range(PASSES):
        optimizer.zero_grad()
        (network(inputs) - targets).square().mean().backward()
        optimizer.step()
    return [parameter.detach().numpy() for parameter in network.parameters()]


def errors(numbers: np.ndarray, wanted: np.ndarray, seed: int) -> np.ndarray:
    """Return the costs less the predicted ones (E, K) in every fourth scenario, predicted by a fit to the others.

    Both are relative to the mean over the patrols.
    """
    left = np.arange(len(wanted)) % 4 == 0
    layers = fit(numbers[~left], wanted[~left], seed)
    predicted = np.array([costs_of(layers, features) for features in numbers[left]])
    return wanted[left] - wanted[left].mean(axis=1, keepdims=True) - predicted


def refitted(
    prior: Prior, table: np.ndarray, tasks: Sequence[Scenario], shifted: Sequence[Scenario], seed: int
) -> Prior:
    """Return a prior that is fitted to the results of scenarios, and accepts these and shifted ones."""
    numbers = np.array([features_of(task) for task in tasks])
    every = np.array([*numbers, *(features_of(task) for task in shifted)])
    low, high = every.min(axis=0), every.max(axis=0)
    return dataclasses.replace(
        prior,
        layers=fit(numbers, costs(table), seed),
        errors=errors(numbers, costs(table), seed),
        limits=np.stack([low - MARGIN * (high - low), high + MARGIN * (high - low)], axis=1),
        seen=np.stack([numbers.min(axis=0), numbers.max(axis=0)], axis=1),
    )


def as_text(prior: Prior) -> str:
    """Return the contents of the file of a prior; costs have five digits, more than the choice depends on."""

    def rounded(array: np.ndarray) -> Any:
        return [rounded(row) for row in array] if array.ndim > 1 else [float(f"{value:.5g}") for value in array]

    patrols = [{"policy": patrol.policy, "parameters": dict(patrol.parameters)} for patrol in prior.patrols]
    layers = [{"weight": rounded(layer.weight), "bias": rounded(layer.bias)} for layer in prior.layers]
    values = {"about": dict(prior.about), "objective": prior.objective, "patrols": patrols,
              "limits": prior.limits.tolist(), "seen": prior.seen.tolist(), "errors": rounded(prior.errors),
              "layers": layers}  # fmt: skip
    return json.dumps(values, allow_nan=False) + "\n"


def compared(prior: Prior, table: np.ndarray, tasks: Sequence[Scenario]) -> figures.Table:
    """Return a row for each patrol: its time over that of the network's choice, and collisions, the shortest first."""
    picked = np.array([int(prior.predicted(task.resolve()).argmin()) for task in tasks])
    every = np.arange(len(tasks))
    ratios = np.exp(np.log(table[..., 0] / table[every, picked, 0][:, None]).mean(axis=0))
    rows = [["the network's choice", "1.00", f"{table[every, picked, 1].mean():.2f}", "100"]]
    for k in np.argsort(ratios):
        share = 100 * np.mean(picked == k)
        rows.append([label(prior.patrols[k]), f"{ratios[k]:.2f}", f"{table[:, k, 1].mean():.2f}", f"{share:.0f}"])
    titles = ["patrol", "time over the network's choice", "collisions per episode", "chosen for [% of scenarios]"]
    return {"columns": titles, "rows": rows}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("portfolio", choices=NAMES)
    parser.add_argument("--space", default="monitoring-v1", help="name or .toml file of a space of scenarios with cars")
    parser.add_argument("--scenarios", type=int, default=400, help="scenarios of the split `train`")
    parser.add_argument("--validation", type=int, default=64, help="scenarios of the split `validation`")
    parser.add_argument("--episodes", type=int, default=8, help="episodes of each patrol in each scenario")
    parser.add_argument("--seed", type=int, default=0, help="seed of the network")
    parser.add_argument("--out", type=Path, default=Path("results/prior"), help="folder of the results")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    prior, space = Prior.read(options.portfolio), scenario_space(options.space)
    about = {name: getattr(options, name) for name in ("space", "scenarios", "episodes", "seed")}
    words = [f"--{name} {value}" for name, value in about.items() if name != "space" or value != "monitoring-v1"]
    about["command"] = f"python benchmarks/prior.py {options.portfolio} {' '.join(words)}"
    with quietly():
        tasks, validation, *shifted = (
            list(scenarios_of(space, split, count, prior.objective))
            for split, count in (("train", options.scenarios), ("validation", options.validation),
                                 *((shift, options.scenarios) for shift in space.shifts))
        )  # fmt: skip
        path = options.out / f"{options.portfolio}.jsonl"
        table = results(path, prior, [*tasks, *validation], options.episodes)
        prior = refitted(prior, table[: len(tasks)], tasks, [*itertools.chain.from_iterable(shifted)], options.seed)
    prior = dataclasses.replace(prior, about=about)
    (FOLDER / f"{options.portfolio}.json").write_text(as_text(prior), encoding="utf-8")
    figures.show(f"{len(validation)} scenarios of {options.space}:validation",
                 compared(prior, table[len(tasks) :], validation))  # fmt: skip


if __name__ == "__main__":
    main()
