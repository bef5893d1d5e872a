"""Parts of several environments: the spaces of agents, and what an environment around another one passes on."""

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.seeding import np_random
from pettingzoo import ParallelEnv

from lissajous_env.wording import shown

if TYPE_CHECKING:
    from lissajous_env.replay import Replay


NEEDS_RESET = "step needs a running episode: call reset first"


def nothing_done(begun: bool, actions: Any) -> tuple[dict, dict, dict, dict, dict]:
    """Return the empty results of a step without actions after the end of an episode.

    Raises:
        ResetNeeded: no episode has begun, or there are actions.
    """
    if not begun or not isinstance(actions, Mapping) or actions:
        raise ResetNeeded(NEEDS_RESET)
    return {}, {}, {}, {}, {}


class Around:
    """Part of an environment around another one, `inner`."""

    inner: Any

    def render(self) -> Any:
        """Draw the world, as `LissajousParallelEnv.render`."""
        return self.inner.render()

    @property
    def score_names(self) -> tuple[str, ...]:
        """Names of the numbers in `score` of an info of Gymnasium."""
        return self.inner.simulation.score_names

    def score(self) -> dict[str, Any]:
        """Return the score of the episode so far, with the columns of `lissajous_env.world.columns.NAMES`."""
        return self.inner.score()

    def replay(self, policy: str = "") -> "Replay":
        """Return the episode so far as a page, as `LissajousParallelEnv.replay`; requires `record=True`."""
        return self.inner.replay(policy)

    def close(self) -> None:
        """Close the window, if there is one."""
        self.inner.close()


class Timed:
    """Part of a Gymnasium environment: its `spec` states the number of steps of an episode, which ends by itself."""

    _steps: int | None = None
    """Number of steps of an episode; None if it varies."""
    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """Specification by which `gymnasium.make` made the environment."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = copy.copy(spec)
        if self._spec is not None and self._steps is not None:
            self._spec.max_episode_steps = self._steps


class SpacesOfAgents(ParallelEnv):
    """Environment whose spaces, `observation_spaces` and `action_spaces`, never change."""

    _np_random: np.random.Generator | None = None

    @property
    def np_random(self) -> np.random.Generator:
        """Generator for wrappers, which `reset` with a seed seeds; the environment itself does not use it."""
        if self._np_random is None:
            self._np_random = np_random()[0]
        return self._np_random

    def _seed_wrappers(self, seed: int | None) -> None:
        if seed is not None:
            self._np_random = np_random(int(seed))[0]

    def observation_space(self, agent: str) -> gymnasium.spaces.Space:
        """Return the observation space of an agent, always the same object."""
        self._check_agent(agent)
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> gymnasium.spaces.Space:
        """Return the action space of an agent, always the same object."""
        self._check_agent(agent)
        return self.action_spaces[agent]

    def _check_agent(self, agent: Any) -> None:
        if not isinstance(agent, str) or agent not in self.action_spaces:
            last = self.possible_agents[-1]
            raise ValueError(f"agent must be one of robot_0 to {last}, got {shown(agent)}")
