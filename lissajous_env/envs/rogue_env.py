"""The Gymnasium environment of one world in which the agent is the team of rogues, against any policy of robots."""

import os
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded

from lissajous_env.envs.actions import on_host
from lissajous_env.envs.agents import NEEDS_RESET, Around, Timed
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv
from lissajous_env.envs.two_sided import TwoSidedParallelEnv
from lissajous_env.episodes.evaluation import ActingPolicy, FunctionPolicy
from lissajous_env.episodes.policies import policy
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import shown
from lissajous_env.world.rogues.rows import rogue_layout


def as_driver(robots: Any, scenario: Scenario, num_worlds: int, device: Any = "cpu") -> ActingPolicy:
    """Return the policy that drives the robots of some worlds.

    Args:
        robots: Name of a policy, or folder of a checkpoint; a policy for so many worlds; or a function
            `act(observation) -> action` on NumPy arrays (W, N, D) and (W, N, action_size).
        scenario: The scenario.
        num_worlds: W.
        device: Warp device.

    Raises:
        ValueError: the policy is unknown, or is for another number of worlds.
    """
    if isinstance(robots, (str, os.PathLike)):
        return policy(robots, scenario, num_worlds, device)
    if hasattr(robots, "act"):
        if robots.num_worlds != num_worlds:
            raise ValueError(f"robots must be driven by a policy for {num_worlds} worlds, got {robots.num_worlds}")
        return robots
    if isinstance(robots, type) or not callable(robots):
        raise ValueError(f"robots must be the name of a policy, a policy or a function, got {shown(robots)}")
    return FunctionPolicy(robots, num_worlds)


class LissajousRogueEnv(Around, Timed, gymnasium.Env):
    """One world as a `gymnasium.Env` whose agent is the team of rogues; a policy drives the robots.

    The observation is (T, D), a row of `lissajous_env.world.rogues.rows` per target slot, the action (T, 2) velocities
    [`targets.speed_limit`]. Rows of slots without a live rogue are zero, and their actions have no effect. The reward
    is the time of the step for which rogues were undetected, summed over the rogues [s]. The episode is terminated when
    all rogues that it can have are detected, and truncated after `task.duration`. The info contains `rogue_reward` (T,)
    and `score`, the numbers that `score_names` names, infinite until the episode ends.

    Args:
        scenario: Name of a scenario, or a `Scenario`.
        robots: Name of the policy that drives the robots, a policy, or a function; see `as_driver`.
        render_mode: None, `rgb_array`, or `human` for a window.
        **settings: Settings of `LissajousParallelEnv`, and fields of the scenario; `rogues` is `agents`.

    Raises:
        UnknownSettingError: an unknown keyword (a `ValueError` and a `TypeError`).
        ValueError: an invalid setting, or one for robots that are agents.
    """

    metadata = LissajousParallelEnv.metadata

    def __init__(
        self,
        scenario: str | Scenario = "experiment",
        robots: Any = "kuramoto-mpcc",
        render_mode: str | None = None,
        **settings: Any,
    ):
        if settings.get("discrete_actions", False):
            raise ValueError("discrete_actions must be False if a policy drives the robots, got True")
        settings = {"rogues": AGENTS} | settings
        self.inner = TwoSidedParallelEnv(LissajousParallelEnv(scenario, render_mode, **settings))
        self.render_mode, self.scenario = render_mode, self.inner.scenario
        self._steps = self.scenario.task.steps
        self._driver = as_driver(robots, self.scenario, 1, self.inner.simulation.device)
        layout, slots = rogue_layout(self.scenario), self.scenario.target_capacity
        low, high = np.tile(layout.low, (slots, 1)), np.tile(layout.high, (slots, 1))
        self.observation_space = gymnasium.spaces.Box(low, high, dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (slots, 2), np.float32)
        self._running = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Begin an episode, as `LissajousParallelEnv.reset`."""
        self.inner.reset(seed, options)
        self._driver.reset()
        super().reset(seed=None if seed is None else int(seed))
        self._running = True
        return self._observed(), self._info(np.zeros(self.scenario.target_capacity, np.float32))

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Take one control step with the actions of all rogues.

        Raises:
            ResetNeeded: before the first reset, or after the end of an episode.
            ValueError: an action has a wrong shape or is not finite; the state is unchanged.
        """
        if not self._running:
            raise ResetNeeded(NEEDS_RESET)
        action = on_host(action)
        if np.shape(action) != self.action_space.shape:
            raise ValueError(f"action must have shape {self.action_space.shape}, got {shown(action)}")
        simulation = self.inner.simulation
        driven = self._driver.act(simulation.observation)
        of_robots = driven.numpy()[0] if hasattr(driven, "numpy") else np.asarray(driven)[0]
        actions = dict(zip(self.inner.possible_robots, of_robots, strict=True))
        actions |= dict(zip(self.inner.possible_rogues, np.asarray(action), strict=True))
        self.inner.step({agent: actions[agent] for agent in self.inner.agents})
        reward = simulation.rogue_reward.numpy()[0].copy()
        terminated = bool(simulation.rogue_terminated.numpy().all())
        truncated = not self.inner.agents and not terminated
        self._running = not (terminated or truncated)
        return self._observed(), float(reward.sum()), terminated, truncated, self._info(reward)

    def _info(self, reward: np.ndarray) -> dict[str, Any]:
        score = self.inner.simulation.score_numbers([] if self._running else [0])[0]
        return {"rogue_reward": reward, "score": score}

    def _observed(self) -> np.ndarray:
        return self.inner.simulation.rogue_observation.numpy()[0].copy()
