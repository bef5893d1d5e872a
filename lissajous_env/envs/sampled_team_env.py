"""The Gymnasium environment of a space of scenarios, in which the whole team is one agent."""

import os
from typing import Any

import numpy as np

from lissajous_env.envs.sampled_env import SampledParallelEnv
from lissajous_env.envs.team_env import TeamEnv
from lissajous_env.parameters.space import ScenarioSpace


class SampledEnv(TeamEnv):
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

    def __init__(
        self,
        space: str | os.PathLike | ScenarioSpace,
        render_mode: str | None = None,
        *,
        flat_actions: bool = False,
        **settings: Any,
    ):
        parallel = SampledParallelEnv(space, render_mode, **settings)
        super().__init__(parallel, settings.get("discrete_actions", False), flat_actions)

    def _observed(self) -> np.ndarray:
        observed = np.zeros(self.observation_space.shape, dtype=np.float32)  # type: ignore[arg-type]
        observed[: self.scenario.num_robots] = self.parallel.simulation.observation.numpy()[0]
        return observed

    def _info(self, rewards: dict[str, float], infos: dict[str, dict]) -> dict[str, Any]:
        mask = np.arange(len(self.parallel.possible_agents)) < self.scenario.num_robots
        return {"mask": mask} | super()._info(rewards, infos)
