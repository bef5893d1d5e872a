"""Functions that make the environments of one world."""

from typing import Any

from pettingzoo import AECEnv
from pettingzoo.utils import parallel_to_aec, wrappers

from lissajous_env.envs.gymnasium_env import LissajousEnv
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv

parallel_env = LissajousParallelEnv
gymnasium_env = LissajousEnv


class _NamedAgents(wrappers.OrderEnforcingWrapper):
    """AEC environment with a clear error for an unknown agent."""

    def observe(self, agent: str) -> Any:
        self.observation_space(agent)  # checks the name
        return super().observe(agent)


def env(scenario: Any = "experiment", render_mode: str | None = None, **settings: Any) -> AECEnv:
    """Make the `AECEnv` of a scenario, in which the agents act in turn.

    The arguments are those of `LissajousParallelEnv`.
    """
    return _NamedAgents(parallel_to_aec(LissajousParallelEnv(scenario, render_mode, **settings)))
