"""Base of the Gymnasium environments of one world in which the whole team is one agent."""

from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from lissajous_env.envs.actions import action_table
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv
from lissajous_env.envs.sampled_env import SampledParallelEnv
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import shown
from lissajous_env.world.observation import layout

if TYPE_CHECKING:
    from lissajous_env.replay import Replay


def team_spaces(scenario: Scenario, num_robots: int, discrete: bool, flat: bool) -> tuple[Any, Any]:
    """Return the spaces of a team of N robots.

    The observation space is a `Box` (N, D); the action space is `Box(-1, 1, (N, action_size))`, flattened if `flat`,
    or `MultiDiscrete` (N,).
    """
    row, size = layout(scenario), scenario.action_size
    low, high = np.tile(row.low, (num_robots, 1)), np.tile(row.high, (num_robots, 1))
    observation = gymnasium.spaces.Box(low, high, dtype=np.float32)
    if discrete:
        return observation, gymnasium.spaces.MultiDiscrete([len(action_table(scenario))] * num_robots)
    shape = (num_robots * size,) if flat else (num_robots, size)
    return observation, gymnasium.spaces.Box(-1.0, 1.0, shape, np.float32)


class TeamEnv(gymnasium.Env):
    """Environment of one world whose agent is the team, padded to the N robots of the largest team.

    Args:
        parallel: Environment of the robots.
        discrete: True if their actions are discrete.
        flat: True for actions (N * action_size,) instead of (N, action_size).
    """

    metadata = LissajousParallelEnv.metadata

    def __init__(self, parallel: LissajousParallelEnv | SampledParallelEnv, discrete: bool, flat: bool):
        self.parallel, self.render_mode = parallel, parallel.render_mode
        n = len(parallel.possible_agents)
        self.observation_space, self.action_space = team_spaces(self.scenario, n, discrete, flat)
        self._is_flat, self._shape = flat and not discrete, (n, self.scenario.action_size)

    @property
    def scenario(self) -> Scenario:
        """Scenario of the episode."""
        return self.parallel.scenario

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Begin an episode, as the `reset` of the environment of the robots."""
        _, infos = self.parallel.reset(seed, options)
        super().reset(seed=None if seed is None else int(seed))
        return self._observed(), self._info({}, infos)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Take one control step with the actions of all robots.

        Raises:
            ResetNeeded: before the first reset, or after the end of an episode.
            ValueError: an action has a wrong shape or is not finite; the state is unchanged.
        """
        parallel, shape = self.parallel, np.shape(action)
        if shape != self.action_space.shape and (self._is_flat or shape[:1] != self._shape[:1]):
            raise ValueError(f"action must have shape {self.action_space.shape}, got {shown(action)}")
        rows = np.reshape(action, self._shape) if self._is_flat else action
        of_robots = dict(zip(parallel.possible_agents, rows, strict=True))
        _, rewards, _, _, infos = parallel.step({agent: of_robots[agent] for agent in parallel.agents})
        info, over = self._info(rewards, infos), not parallel.agents
        terminated = bool(parallel.simulation.terminated.numpy().all())
        if over:
            info["score"] = parallel.score()
        reward = float(info["robot_reward"][: self.scenario.num_robots].mean())
        return self._observed(), reward, terminated, over and not terminated, info

    def render(self) -> Any:
        """Draw the world, as `LissajousParallelEnv.render`."""
        return self.parallel.render()

    def replay(self, policy: str = "") -> "Replay":
        """Return the episode so far as a page, as `LissajousParallelEnv.replay`; requires `record=True`."""
        return self.parallel.replay(policy)

    def close(self) -> None:
        """Close the window, if there is one."""
        self.parallel.close()

    def _observed(self) -> np.ndarray:
        return self.parallel.simulation.observation.numpy()[0].copy()

    def _info(self, rewards: dict[str, float], infos: dict[str, dict]) -> dict[str, Any]:
        agents = self.parallel.possible_agents
        nothing = np.zeros(len(self.parallel.simulation.reward_term_names), np.float32)
        terms = [infos[agent]["reward_terms"] if agent in infos else nothing for agent in agents]
        reward = np.array([rewards.get(agent, 0.0) for agent in agents], dtype=np.float32)
        return {"robot_reward": reward, "reward_terms": np.stack(terms)}
