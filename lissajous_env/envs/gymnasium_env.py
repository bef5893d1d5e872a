"""The Gymnasium environment of one world, whose agent is a whole team: the robots, or the rogues."""

import os
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded

from lissajous_env.envs.batch import NEEDS_RESET, Batch
from lissajous_env.envs.one_world import METADATA, OneWorld, Timed
from lissajous_env.envs.sides import Rows
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.space import ScenarioSpace


class LissajousEnv(OneWorld, Timed, gymnasium.Env):
    """One world as a `gymnasium.Env`; the agent is the team of robots, as in `LissajousVectorEnv`.

    The observation is (N, D), the reward the mean over the robots. The info contains `robot_reward` (N,),
    `reward_terms` (N, terms) in the order of `lissajous_env.world.tally.TERMS`, and `score`, the numbers that
    `score_names` names, infinite until the episode ends. The episode is terminated when all robots are removed.

    **With `robots`**, a policy, the agent is the team of rogues. The observation is (N, D), a row of
    `lissajous_env.world.rogues.acting` per target slot, the action (N, 2) velocities [`targets.speed_limit`]. Rows of
    slots without a live rogue are zero, and their actions have no effect. The reward is the time of the step for which
    rogues were undetected, summed over the rogues [s]. The episode is terminated when all rogues that it can have are
    detected. The info contains `rogue_reward` (N,) and `score`.

    **Of a space of scenarios**, each reset draws one, as in `LissajousParallelEnv`. Rows are padded to the N robots of
    the largest team with zeros, and actions of these rows have no effect. The info also contains `mask` (N,), True for
    the robots of the scenario.

    Args:
        scenario: As for `LissajousParallelEnv`.
        render_mode: None, `rgb_array`, or `human` for a window.
        robots: Policy that drives the robots: a name, a policy, or a function; see `Batch`. The rogues are then the
            agent, and `rogues` is `agents`; not with a space.
        discrete_actions: True for actions (N,) that are indices of the table in `lissajous_env.envs.sides`.
        max_cycles: Number of steps of an episode, instead of `task.duration`.
        device: Warp device.
        **overrides: Fields of the scenario, as in `lissajous_env.parameters.scenario`.

    Raises:
        UnknownSettingError: an unknown keyword (a `ValueError` and a `TypeError`).
        ValueError: an invalid setting, or scenarios of a space with rows or actions of different sizes.
    """

    metadata = METADATA

    def __init__(
        self,
        scenario: str | os.PathLike | Scenario | ScenarioSpace = "experiment",
        render_mode: str | None = None,
        *,
        robots: Any = None,
        discrete_actions: bool = False,
        max_cycles: int | None = None,
        device: Any = "cpu",
        **overrides: Any,
    ):
        settings: dict[str, Any] = {"discrete_actions": discrete_actions, "max_cycles": max_cycles, "device": device}
        roles = "robots" if robots is None else "rogues"
        batch = Batch(scenario, roles=roles, robots=robots, **settings, overrides=overrides)
        (self._side,) = batch.sides
        self.observation_space, self.action_space = self._side.team_spaces()
        self._steps = batch.scenario.task.steps if batch.space is None else max_cycles
        self._running = False
        self._set_batch(batch, render_mode)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Begin an episode, as `LissajousParallelEnv.reset`."""
        self._begin(seed)
        super().reset(seed=None if seed is None else int(seed))
        self._running = True
        rows = self.batch.rows(self._side)
        if self.render_mode == "human":
            self.render()
        return rows.observation[0].copy(), self._info(rows)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Take one control step with the actions of the team; numbers outside [-1, 1] are clipped.

        Raises:
            ResetNeeded: before the first reset, or after the end of an episode.
            ValueError: an action has a wrong shape or is not finite; the state is unchanged.
        """
        given = self._side.read_actions(action, self.action_space.shape)  # type: ignore[arg-type]
        if not self._running:
            raise ResetNeeded(NEEDS_RESET)
        self.batch.step({self._side.agent: given})
        rows = self.batch.rows(self._side)
        terminated, over = bool(rows.terminated.all()), bool(self.batch.over[0])
        self._running = not over
        if self.render_mode == "human":
            self.render()
        reward = rows.reward[0]
        total = reward[: self.scenario.num_robots].mean() if self._side.is_robots else reward.sum()
        return rows.observation[0].copy(), float(total), terminated, over and not terminated, self._info(rows)

    def _info(self, rows: Rows) -> dict[str, Any]:
        info: dict[str, Any] = {f"{self._side.agent}_reward": rows.reward[0].copy()}
        if self._side.is_robots:
            info["reward_terms"] = rows.terms[0].copy()
        if self.batch.space is not None:
            info["mask"] = rows.mask[0].astype(bool)
        return info | {"score": self.simulation.score_numbers([] if self._running else [0])[0]}
