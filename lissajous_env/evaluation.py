"""Policies against scenarios: episodes that a policy plays to the end, as score rows."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Protocol

import numpy as np

from lissajous_env import library
from lissajous_env.scenario import Scenario
from lissajous_env.score import COLUMNS
from lissajous_env.simulation import Simulation


class ActingPolicy(Protocol):
    """What an evaluation asks of a policy; `baselines.policy.Policy` says more."""

    num_worlds: int

    def reset(self, worlds: Any = None) -> None:
        """Forget what was kept of some worlds, or of all."""

    def act(self, observation: Any) -> Any:
        """Actions (num_worlds, N, action_size) for observations (num_worlds, N, D)."""


def evaluate(
    policy: ActingPolicy, scenario: str | Scenario, seeds: Iterable[int] = range(16), device: Any = "cpu"
) -> list[dict[str, Any]]:
    """Play one episode for each seed, `policy.num_worlds` at a time.

    Returns:
        A score row for each seed, in their order, with the columns of `lissajous_env.score.COLUMNS`.
    """
    return [row for rows in episodes(policy, scenario, seeds, device) for row in rows]


def episodes(
    policy: ActingPolicy,
    scenario: str | Scenario,
    seeds: Iterable[int],
    device: Any = "cpu",
    on_step: Callable[[Simulation], None] | None = None,
) -> Iterator[list[dict[str, Any]]]:
    """Yield the score rows of each batch of episodes when it has ended; `on_step` is called after each step."""
    seeds = list(seeds)
    simulation = Simulation(library.scenario(scenario), policy.num_worlds, device=device)
    name = getattr(policy, "name", type(policy).__name__)
    for first in range(0, len(seeds), policy.num_worlds):
        batch = seeds[first : first + policy.num_worlds]
        # A last batch that is not full plays its last seed in the worlds left over; their rows are dropped.
        padded = batch + batch[-1:] * (policy.num_worlds - len(batch))
        policy.reset()
        observation = simulation.reset(seeds=padded)
        for _ in range(simulation.scenario.task.steps):
            observation, *_ = simulation.step(policy.act(observation))
            if on_step is not None:
                on_step(simulation)
        rows = simulation.score(np.arange(len(batch)))
        yield [
            {column: ({"policy": name, "episode": first + k} | row)[column] for column in COLUMNS}
            for k, row in enumerate(rows)
        ]
