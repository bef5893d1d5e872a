"""The Gymnasium environment of a space of scenarios, in which the whole team is one agent."""

import os
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from lissajous_env.envs.actions import team_action_space
from lissajous_env.envs.sampled_env import SampledParallelEnv
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.space import ScenarioSpace
from lissajous_env.wording import shown

if TYPE_CHECKING:
    from lissajous_env.replay import Replay


class SampledEnv(gymnasium.Env):
    """Scenarios drawn from a space as a `gymnasium.Env`; the agent is the team, padded to N robots, the largest team.

    A `SampledParallelEnv` draws the scenarios. The observation is (N, D), with rows of zeros where the scenario has no
    robot; actions of these rows have no effect. The reward is the mean over the robots. The info contains `mask` (N,),
    True for the robots of the scenario, `robot_reward` (N,), `reward_terms` (N, terms) in the order of
    `lissajous_env.world.reward.TERMS`, and `score` when the episode ends.

    Args:
        space: As for `SampledParallelEnv`.
        render_mode: None, `rgb_array`, or `human` for a window.
        flat_actions: True for actions (N * action_size,) instead of (N, action_size). Discrete actions (N,) are always
            flat.
        **settings: Settings of `SampledParallelEnv`, and fields of all scenarios.

    Raises:
        UnknownSettingError: an unknown keyword (a `ValueError` and a `TypeError`).
        ValueError: an invalid setting, or scenarios with rows or actions of different sizes.
    """

    metadata = SampledParallelEnv.metadata

    def __init__(
        self,
        space: str | os.PathLike | ScenarioSpace,
        render_mode: str | None = None,
        *,
        flat_actions: bool = False,
        **settings: Any,
    ):
        self.parallel = SampledParallelEnv(space, render_mode, **settings)
        self.render_mode = render_mode
        discrete, n = settings.get("discrete_actions", False), len(self.parallel.possible_agents)
        row = self.parallel.observation_space("robot_0")
        assert isinstance(row, gymnasium.spaces.Box)
        self.observation_space = gymnasium.spaces.Box(np.tile(row.low, (n, 1)), np.tile(row.high, (n, 1)))
        self.action_space = team_action_space(self.scenario, discrete, flat_actions, n)
        self._rows = (n,) if discrete else (n, self.scenario.action_size)

    @property
    def scenario(self) -> Scenario:
        """Scenario of the episode."""
        return self.parallel.scenario

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Draw a scenario and begin an episode in it, as `SampledParallelEnv.reset`."""
        _, infos = self.parallel.reset(seed, options)
        super().reset(seed=None if seed is None else int(seed))
        return self._observed(), self._info({}, infos)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Take one control step with the actions of all robots.

        Raises:
            ResetNeeded: before the first reset, or after the end of an episode.
            ValueError: an action has a wrong shape or is not finite; the state is unchanged.
        """
        if np.shape(action) != self.action_space.shape:
            raise ValueError(f"action must have shape {self.action_space.shape}, got {shown(action)}")
        rows = np.reshape(action, self._rows)
        live = {agent: rows[int(agent.removeprefix("robot_"))] for agent in self.parallel.agents}
        _, rewards, _, _, infos = self.parallel.step(live)
        info, over = self._info(rewards, infos), not self.parallel.agents
        terminated = bool(self.parallel.simulation.terminated.numpy().all())
        if over:
            info["score"] = self.parallel.score()
        reward = float(info["robot_reward"][info["mask"]].mean())
        return self._observed(), reward, terminated, over and not terminated, info

    def render(self) -> Any:
        """Draw the world, as `SampledParallelEnv.render`."""
        return self.parallel.render()

    def replay(self, policy: str = "") -> "Replay":
        """Return the episode so far as a page, as `SampledParallelEnv.replay`; requires `record=True`."""
        return self.parallel.replay(policy)

    def close(self) -> None:
        """Close the window, if there is one."""
        self.parallel.close()

    def _observed(self) -> np.ndarray:
        observed = np.zeros(self.observation_space.shape, dtype=np.float32)  # type: ignore[arg-type]
        observed[: self.scenario.num_robots] = self.parallel.simulation.observation.numpy()[0]
        return observed

    def _info(self, rewards: dict[str, float], infos: dict[str, dict]) -> dict[str, Any]:
        agents = self.parallel.possible_agents
        nothing = np.zeros(len(self.parallel.simulation.reward_term_names), np.float32)
        terms = [infos[agent]["reward_terms"] if agent in infos else nothing for agent in agents]
        reward = np.array([rewards.get(agent, 0.0) for agent in agents], dtype=np.float32)
        mask = np.arange(len(agents)) < self.scenario.num_robots
        return {"mask": mask, "robot_reward": reward, "reward_terms": np.stack(terms)}
