"""Parts of several environments: the spaces of agents, and what an environment around another one passes on."""

from typing import TYPE_CHECKING, Any

import gymnasium
from pettingzoo import ParallelEnv

from lissajous_env.wording import shown

if TYPE_CHECKING:
    from lissajous_env.replay import Replay


class Around:
    """Part of an environment around another one, `inner`."""

    inner: Any

    def render(self) -> Any:
        """Draw the world, as `LissajousParallelEnv.render`."""
        return self.inner.render()

    def replay(self, policy: str = "") -> "Replay":
        """Return the episode so far as a page, as `LissajousParallelEnv.replay`; requires `record=True`."""
        return self.inner.replay(policy)

    def close(self) -> None:
        """Close the window, if there is one."""
        self.inner.close()


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
