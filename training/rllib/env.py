"""The environment for RLlib: one world as a `MultiAgentEnv` of its new API stack."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from ray.rllib.env.multi_agent_env import MultiAgentEnv

import baselines
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv
from training.learned.checkpoint import Card

_APART = 100_000
"""Distance of the seeds of two processes that collect episodes."""


class LissajousMultiAgentEnv(MultiAgentEnv):
    """One world; the agents are `robot_0` ... in this order, the same in every episode.

        config.environment(LissajousMultiAgentEnv, env_config={"scenario": "intruders", "task.duration": 60.0})

    A robot that a fault stops keeps observing and acting, without effect. One that is removed, with
    `task.on_collision` or `task.boundary` set to `remove`, is terminated: it has no observation after that of the step
    in which it goes.
    When the time is over, only `truncateds["__all__"]` says so. A flag for each robot as well would make RLlib call
    the whole episode terminated, and value its last states at zero. `terminateds["__all__"]` is set when the last robot
    was removed before that. Seeds and observations are those of `LissajousParallelEnv`; infos are empty.

    Args:
        config: `scenario` (name, or one that was made), `render_mode`, `card` (a `training.learned.card.Card`: which
            entries of the observation the agents get, and which policy's action theirs is added to),
            `residual_penalty` (reward that an action which is added costs, per step and mean square), and anything else
            that `LissajousParallelEnv` takes, fields of the scenario among it. In RLlib's own processes, each adds a
            number of its own to the seeds, so that no two of them play the same worlds.

    Raises:
        ValueError: what the scenario, the card or an action is refused for.
    """

    def __init__(self, config: Mapping[str, Any] | None = None):
        given = dict(config or {})
        card: Card | None = given.pop("card", None)
        self._penalty = float(given.pop("residual_penalty", 0.0))
        self.parallel = LissajousParallelEnv(
            given.pop("scenario", "experiment"), given.pop("render_mode", None), **given
        )
        self.possible_agents = list(self.parallel.possible_agents)
        self.agents = list(self.possible_agents)
        super().__init__()
        self.scenario, self.render_mode = self.parallel.scenario, self.parallel.render_mode
        self.metadata = dict(self.parallel.metadata)  # RLlib writes into it
        self.observation_spaces = self.parallel.observation_spaces
        self.action_spaces = self.parallel.action_spaces
        self._card, self._base = card, None
        if card is not None:
            self._read(card)
        self._seeds_from = _APART * int(getattr(config, "worker_index", 0))

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Begin an episode: with the given seed, or with the next that the world draws from its last."""
        observations, _ = self.parallel.reset(None if seed is None else seed + self._seeds_from, options)
        self.agents = list(self.parallel.agents)
        if self._base is not None:
            self._base.reset()
        return self._observed(observations), {}

    def step(self, action_dict: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Take one control step with an action for each robot that is there."""
        given = action_dict
        if self._card is not None and self._base is not None:
            given = {agent: np.clip(action, -1.0, 1.0) for agent, action in action_dict.items()}
            action_dict = {
                agent: np.clip(self._base_action[agent] + self._card.residual * action, -1.0, 1.0)
                for agent, action in given.items()
            }
        observations, rewards, terminated, truncated, _ = self.parallel.step(action_dict)
        if self._base is not None and self._penalty > 0:
            rewards = {a: reward - self._penalty * float(np.square(given[a]).mean()) for a, reward in rewards.items()}
        self.agents = list(self.parallel.agents)
        timed_out = any(truncated[agent] and not terminated[agent] for agent in truncated)
        gone = not self.agents and not timed_out
        return self._observed(observations), rewards, terminated | {"__all__": gone}, {"__all__": timed_out}, {}

    def score(self) -> dict[str, Any]:
        """Score of the episode so far: the columns of `lissajous_env.world.score.COLUMNS`."""
        return self.parallel.score()

    def render(self) -> Any:
        """Draw the world, as `LissajousParallelEnv.render`."""
        return self.parallel.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        self.parallel.close()

    def _read(self, card: Card) -> None:
        """Let the agents observe, and act, as a card says."""
        self._columns = card.columns(self.scenario)
        ends = np.ones(0, dtype=np.float32)
        if card.base is not None:
            self._base = baselines.make(card.base, self.scenario, 1, self.parallel.simulation.device)
            ends = np.ones(card.action_size, dtype=np.float32)
        layout = self.parallel.simulation.layout
        low, high = np.append(layout.low[self._columns], -ends), np.append(layout.high[self._columns], ends)
        self.observation_spaces = {agent: gymnasium.spaces.Box(low, high) for agent in self.possible_agents}

    def _observed(self, observations: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        if self._card is None:
            return observations
        rows = {agent: row[self._columns] for agent, row in observations.items()}
        if self._base is not None:
            actions = self._base.act(self.parallel.simulation.observation.numpy())[0]
            self._base_action = dict(zip(self.possible_agents, actions, strict=True))
            rows = {agent: np.append(row, self._base_action[agent]) for agent, row in rows.items()}
        return rows
