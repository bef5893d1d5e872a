"""Spaces of the agents of a PettingZoo environment."""

from typing import Any

import gymnasium
from pettingzoo import ParallelEnv

from lissajous_env.wording import shown


class SpacesOfAgents(ParallelEnv):
    """Environment whose spaces, `observation_spaces` and `action_spaces`, never change."""

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
