"""Environment for RLlib: a `MultiAgentEnv` of its new API stack."""

from collections.abc import Mapping
from typing import Any

from ray.rllib.env.multi_agent_env import MultiAgentEnv

from lissajous_env import Scenario, parallel_env
from lissajous_env.envs.agents import Around

_APART = 100_000
"""Difference between the seeds of two processes that collect episodes."""


class LissajousMultiAgentEnv(Around, MultiAgentEnv):
    """Environment whose agents are `robot_0`, `robot_1` ... in every episode of a scenario.

        config.environment(LissajousMultiAgentEnv, env_config={"scenario": "intruders", "task.duration": 60.0})

    Of a space of scenarios, such as `monitoring-v1`, each reset draws one, and the agents of an episode are its robots;
    `possible_agents` are those of the largest team, as in `SampledParallelEnv`.
    With `rogues` = `agents` the rogues are agents too, `rogue_0` ..., each from its appearance to its detection, which
    terminates it; `training.rllib.two_sided` has the two modules and their mapping.
    A failed robot continues to observe and act, without effect. A removed robot (`task.on_collision` or `task.boundary`
    set to `remove`) terminates: its last observation is that of the step in which it is removed.
    At the time limit, only `truncateds["__all__"]` is set. With a flag for each robot, RLlib would treat the episode as
    terminated and assign zero value to its last states. `terminateds["__all__"]` is set when the last robot has been
    removed earlier. Seeds and observations are those of `LissajousParallelEnv`; infos are empty.

    Args:
        config: `scenario` (name or object, also of a space), `render_mode`, and further arguments of
            `LissajousParallelEnv`, including fields of the scenario. Each of RLlib's processes adds its own offset to
            the seeds, so that no two of them play the same episodes.

    Raises:
        ValueError: the scenario or an action is invalid.
    """

    def __init__(self, config: Mapping[str, Any] | None = None):
        given = dict(config or {})
        self.inner = parallel_env(given.pop("scenario", "experiment"), given.pop("render_mode", None), **given)
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
        """Take a control step with an action for each robot that has not been removed."""
        acted = set(self.agents)
        observations, rewards, terminated, truncated, _ = self.inner.step(action_dict)
        self.agents = list(self.inner.agents)
        timed_out = any(truncated[agent] and not terminated[agent] for agent in truncated)
        gone = not self.agents and not timed_out
        if len(observations) > len(acted):  # a rogue that has just appeared has no reward yet
            rewards, terminated = ({a: of[a] for a in of if a in acted} for of in (rewards, terminated))
        return observations, rewards, terminated | {"__all__": gone}, {"__all__": timed_out}, {}
