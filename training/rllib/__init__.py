"""RLlib: a `MultiAgentEnv` of its new API stack; `examples/rllib_ppo.py` trains on it."""

from collections.abc import Mapping
from typing import Any

from lissajous_env import LissajousParallelEnv, Scenario
from lissajous_env.plugins import requiring

with requiring("training.rllib", "cluster"):
    from ray.rllib.env.multi_agent_env import MultiAgentEnv

__all__ = ["LissajousMultiAgentEnv"]

_APART = 100_000
"""Difference between the seeds of RLlib's processes."""


class LissajousMultiAgentEnv(MultiAgentEnv):
    """The environment `inner`, a `LissajousParallelEnv`, for RLlib.

        config.environment(LissajousMultiAgentEnv, env_config={"scenario": "intruders", "task.duration": 60.0})

    A failed robot continues to observe and act, without effect. An agent that is terminated has its last observation in
    that step. At the time limit, only `truncateds["__all__"]` is set. With a flag for each agent, RLlib would treat the
    episode as terminated and assign zero value to its last states. `terminateds["__all__"]` is set when the last robot
    has been removed earlier. Infos are empty.

    Args:
        config: Arguments of `LissajousParallelEnv`, including fields of the scenario. Each of RLlib's processes adds
            its own offset to the seeds, so that no two of them play the same episodes.

    Raises:
        ValueError: the scenario or an action is invalid.
    """

    def __init__(self, config: Mapping[str, Any] | None = None):
        self.inner = LissajousParallelEnv(**dict(config or {}))
        self.possible_agents = list(self.inner.possible_agents)
        self.agents = list(self.possible_agents)
        super().__init__()
        self.render_mode = self.inner.render_mode
        self.metadata = dict(self.inner.metadata)  # RLlib writes into it
        self.observation_spaces = self.inner.observation_spaces
        self.action_spaces = self.inner.action_spaces
        self._seeds_from = _APART * int(getattr(config, "worker_index", 0))

    @property
    def scenario(self) -> Scenario:
        """Scenario of the episode."""
        return self.inner.scenario

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Begin an episode with the given seed, or with one drawn from the previous seed."""
        observations, _ = self.inner.reset(None if seed is None else seed + self._seeds_from, options)
        self.agents = list(self.inner.agents)
        return observations, {}

    def step(self, action_dict: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Take a control step with an action for each live agent."""
        acted = self.agents
        observations, rewards, terminated, truncated, _ = self.inner.step(action_dict)
        self.agents = list(self.inner.agents)
        timed_out = any(truncated[agent] and not terminated[agent] for agent in truncated)
        all_removed = not self.agents and not timed_out
        # A rogue that has just appeared has no reward yet.
        rewards, terminated = ({agent: values[agent] for agent in acted} for values in (rewards, terminated))
        return observations, rewards, terminated | {"__all__": all_removed}, {"__all__": timed_out}, {}

    def render(self) -> Any:
        """Draw the world, as `LissajousParallelEnv.render`."""
        return self.inner.render()

    def score(self) -> dict[str, Any]:
        """Return the score of the episode so far, with the columns of `lissajous_env.world.columns.NAMES`."""
        return self.inner.score()

    def close(self) -> None:
        """Close the window, if there is one."""
        self.inner.close()
