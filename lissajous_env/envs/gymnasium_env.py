"""The Gymnasium environments of one world in which the whole team of robots is one agent."""

import os
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded

from lissajous_env.envs.actions import action_table, on_host
from lissajous_env.envs.agents import NEEDS_RESET, Around, Timed
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv
from lissajous_env.envs.sampled_env import SampledParallelEnv
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.space import ScenarioSpace
from lissajous_env.wording import shown
from lissajous_env.world.observation import layout


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


class TeamEnv(Around, Timed, gymnasium.Env):
    """Environment of one world whose agent is the team, padded to the N robots of the largest team.

    Args:
        parallel: Environment of the robots.
        discrete: True if their actions are discrete.
        flat: True for actions (N * action_size,) instead of (N, action_size).
    """

    metadata = LissajousParallelEnv.metadata

    def __init__(self, parallel: LissajousParallelEnv | SampledParallelEnv, discrete: bool, flat: bool):
        self.inner, self.render_mode = parallel, parallel.render_mode
        n = len(parallel.possible_agents)
        self.observation_space, self.action_space = team_spaces(self.scenario, n, discrete, flat)
        self._is_flat, self._shape = flat and not discrete, (n, self.scenario.action_size)

    @property
    def scenario(self) -> Scenario:
        """Scenario of the episode."""
        return self.inner.scenario

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Begin an episode, as the `reset` of the environment of the robots."""
        _, infos = self.inner.reset(seed, options)
        super().reset(seed=None if seed is None else int(seed))
        return self._observed(), self._info({}, infos)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Take one control step with the actions of all robots.

        Raises:
            ResetNeeded: before the first reset, or after the end of an episode.
            ValueError: an action has a wrong shape or is not finite; the state is unchanged.
        """
        inner, action = self.inner, on_host(action)
        shape = np.shape(action)
        if shape != self.action_space.shape and (self._is_flat or shape[:1] != self._shape[:1]):
            raise ValueError(f"action must have shape {self.action_space.shape}, got {shown(action)}")
        if not inner.agents:
            raise ResetNeeded(NEEDS_RESET)
        rows = np.reshape(action, self._shape) if self._is_flat else action
        of_robots = dict(zip(inner.possible_agents, rows, strict=True))
        _, rewards, _, _, infos = inner.step({agent: of_robots[agent] for agent in inner.agents})
        info, over = self._info(rewards, infos), not inner.agents
        terminated = bool(inner.simulation.terminated.numpy().all())
        reward = float(info["robot_reward"][: self.scenario.num_robots].mean())
        return self._observed(), reward, terminated, over and not terminated, info

    def _observed(self) -> np.ndarray:
        return self.inner.simulation.observation.numpy()[0].copy()

    def _info(self, rewards: dict[str, float], infos: dict[str, dict]) -> dict[str, Any]:
        agents = self.inner.possible_agents
        nothing = np.zeros(len(self.inner.simulation.reward_term_names), np.float32)
        terms = [infos[agent]["reward_terms"] if agent in infos else nothing for agent in agents]
        score = self.inner.simulation.score_numbers([] if self.inner.agents else [0])[0]
        reward = np.array([rewards.get(agent, 0.0) for agent in agents], dtype=np.float32)
        return {"robot_reward": reward, "reward_terms": np.stack(terms), "score": score}


def refuse_rogue_agents(scenario: Scenario) -> None:
    """Raise ValueError for a scenario whose rogues are agents."""
    if scenario.targets.rogues == AGENTS:
        rule = "must be None or a scripted rogue if the team of robots is the agent"
        raise ValueError(f"targets.rogues {rule}, got {AGENTS}; robots=POLICY makes an environment of the rogues")


class LissajousEnv(TeamEnv):
    """One world as a `gymnasium.Env`; the agent is the team, as in `LissajousVectorEnv`.

    The observation is (N, D), the reward the mean over the robots. The info contains `robot_reward` (N,),
    `reward_terms` (N, terms) in the order of `lissajous_env.world.reward.TERMS`, and `score`, the numbers that
    `score_names` names, infinite until the episode ends.

    Args:
        scenario: Name of a scenario, or a `Scenario`.
        render_mode: None, `rgb_array`, or `human` for a window.
        flat_actions: True for actions (N * action_size,) instead of (N, action_size). Discrete actions (N,) are always
            flat.
        **settings: Settings of `LissajousParallelEnv`, and fields of the scenario.

    Raises:
        UnknownSettingError: an unknown keyword (a `ValueError` and a `TypeError`).
        ValueError: an invalid setting.
    """

    def __init__(
        self,
        scenario: str | Scenario = "experiment",
        render_mode: str | None = None,
        *,
        flat_actions: bool = False,
        **settings: Any,
    ):
        parallel = LissajousParallelEnv(scenario, render_mode, **settings)
        refuse_rogue_agents(parallel.scenario)
        self._steps = parallel.scenario.task.steps
        super().__init__(parallel, settings.get("discrete_actions", False), flat_actions)


class SampledEnv(TeamEnv):
    """Scenarios drawn from a space as a `gymnasium.Env`; the agent is the team, padded to N robots, the largest team.

    A `SampledParallelEnv` draws the scenarios. The observation is (N, D), with rows of zeros where the scenario has no
    robot; actions of these rows have no effect. The reward is the mean over the robots. The info contains `mask` (N,),
    True for the robots of the scenario, `robot_reward` (N,), `reward_terms` (N, terms) in the order of
    `lissajous_env.world.reward.TERMS`, and `score`, the numbers that `score_names` names, infinite until the episode
    ends.

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

    def __init__(
        self,
        space: str | os.PathLike | ScenarioSpace,
        render_mode: str | None = None,
        *,
        flat_actions: bool = False,
        **settings: Any,
    ):
        parallel = SampledParallelEnv(space, render_mode, **settings)
        self._steps = settings.get("max_cycles")
        super().__init__(parallel, settings.get("discrete_actions", False), flat_actions)

    def _observed(self) -> np.ndarray:
        observed = np.zeros(self.observation_space.shape, dtype=np.float32)  # type: ignore[arg-type]
        observed[: self.scenario.num_robots] = self.inner.simulation.observation.numpy()[0]
        return observed

    def _info(self, rewards: dict[str, float], infos: dict[str, dict]) -> dict[str, Any]:
        mask = np.arange(len(self.inner.possible_agents)) < self.scenario.num_robots
        return {"mask": mask} | super()._info(rewards, infos)
