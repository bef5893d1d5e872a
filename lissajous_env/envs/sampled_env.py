"""The PettingZoo environment of a space of scenarios: each reset draws a scenario."""

import os
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from lissajous_env.envs.actions import action_space
from lissajous_env.envs.agents import Around, SpacesOfAgents
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv
from lissajous_env.envs.sampler import Sampler
from lissajous_env.envs.true_state import padded_rows, state_size
from lissajous_env.parameters.draws import Draws
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.space import ScenarioSpace
from lissajous_env.world.observation import layout
from lissajous_env.world.selection import drawn_seeds
from lissajous_env.world.simulation import Simulation, fold_seed


class SampledParallelEnv(Around, SpacesOfAgents):
    """Robots in scenarios drawn from a space, as a PettingZoo `ParallelEnv`; `parallel_env` makes it for a space.

    Each reset draws a scenario, and its episode is that of a `LissajousParallelEnv` of the scenario. A reset with a
    seed draws the same scenario and the same episode whatever came before. Later resets without a seed draw a sequence
    of scenarios that depends only on that seed. Without any seed, the sequence comes from the operating system.

    `possible_agents` are those of the largest team among the first 64 scenarios of the split, and `agents` are the
    robots of the scenario. A drawn scenario with more robots or more target slots than all of these is skipped.

    Attributes:
        scenario: Scenario of the episode; before the first reset, the first one of the split.
        simulation: World of the episode; each reset makes another one.

    Args:
        space: Name of a space or SPACE:SPLIT, where SPLIT is a split or a shift, by default `train`; or a
            `ScenarioSpace`.
        render_mode: As for `LissajousParallelEnv`; pictures of two scenarios differ in size.
        discrete_actions: As for `LissajousParallelEnv`.
        max_cycles: As for `LissajousParallelEnv`.
        device: Warp device.
        record: True to record episodes for `replay`.
        **overrides: Fields that are given instead of drawn, as for `ScenarioSpace.overridden`.

    Raises:
        UnknownSettingError: an unknown keyword (a `ValueError` and a `TypeError`).
        ValueError: an invalid setting, rogues that are agents, or scenarios with rows or actions of different sizes.
    """

    metadata = LissajousParallelEnv.metadata

    def __init__(
        self,
        space: str | os.PathLike | ScenarioSpace,
        render_mode: str | None = None,
        *,
        discrete_actions: bool = False,
        max_cycles: int | None = None,
        device: Any = "cpu",
        record: bool = False,
        **overrides: Any,
    ):
        self._sampler = Sampler(space, overrides, max_cycles)
        self.space, self.split = self._sampler.space, self._sampler.split
        self.render_mode = render_mode
        self._settings = {"discrete_actions": discrete_actions, "device": device, "record": record}
        first, most_robots = self._sampler.first, self._sampler.most_robots
        rows = layout(first)
        self.possible_agents = [f"robot_{i}" for i in range(most_robots)]
        self.observation_spaces = {
            agent: gymnasium.spaces.Box(rows.low, rows.high, dtype=np.float32) for agent in self.possible_agents
        }
        self.action_spaces = {agent: action_space(first, discrete_actions) for agent in self.possible_agents}
        size = state_size(most_robots, self._sampler.most_targets, first.messages.size)
        self.state_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self._draws: Draws | None = None
        self.inner: LissajousParallelEnv = _DrawnEnv(first, render_mode, **self._settings)

    @property
    def scenario(self) -> Scenario:
        """Scenario of the episode."""
        return self.inner.scenario

    @property
    def simulation(self) -> Simulation:
        """World of the episode."""
        return self.inner.simulation

    @property
    def agents(self) -> list[str]:  # type: ignore[override]
        """Robots whose episode is running."""
        return self.inner.agents

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Draw a scenario and begin an episode in it, as the class describes."""
        if seed is not None or self._draws is None:
            of_sequence = int(drawn_seeds(1)[0]) if seed is None else fold_seed(seed)
            self._draws = self._sampler.draws(of_sequence)
        self._seed_wrappers(seed)
        made, of_episode = self._sampler.next(self._draws)
        self.inner.close()
        self.inner = _DrawnEnv(made, self.render_mode, **self._settings)
        return self.inner.reset(of_episode, options)

    def step(self, actions: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Take one control step, as `LissajousParallelEnv.step`."""
        return self.inner.step(actions)

    def score(self) -> dict[str, Any]:
        """Return the score of the episode so far, as `LissajousParallelEnv.score`, with the name of the `scenario`."""
        return {"scenario": self.scenario.name} | self.inner.score()

    def state(self) -> np.ndarray:
        """Return the true state of the world, of the size of the largest team.

        It contains the numbers of `lissajous_env.envs.true_state` for `possible_agents` and for the largest number of
        target slots; those of robots and target slots that the scenario does not have are 0.
        """
        return padded_rows(self.simulation, self._sampler.most_robots, self._sampler.most_targets)[0]


class _DrawnEnv(LissajousParallelEnv):
    """Environment of a drawn scenario, which is as it is."""

    def _changed(self, scenario: Any, max_cycles: int | None, overrides: Mapping[str, Any]) -> Scenario:
        return scenario
