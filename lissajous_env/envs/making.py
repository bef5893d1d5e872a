"""Functions that make the environments of one world."""

from typing import Any

import gymnasium
from pettingzoo import AECEnv
from pettingzoo.utils import parallel_to_aec, wrappers

from lissajous_env.envs.gymnasium_env import LissajousEnv
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv
from lissajous_env.envs.rogue_env import LissajousRogueEnv
from lissajous_env.envs.two_sided import TwoSidedParallelEnv
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.parameters.scenario import Scenario


class _NamedAgents(wrappers.OrderEnforcingWrapper):
    """AEC environment with a clear error for an unknown agent."""

    def observe(self, agent: str) -> Any:
        self.observation_space(agent)  # checks the name
        return super().observe(agent)


def parallel_env(
    scenario: str | Scenario = "experiment", render_mode: str | None = None, **settings: Any
) -> LissajousParallelEnv | TwoSidedParallelEnv:
    """Make the PettingZoo `ParallelEnv` of a scenario; see `LissajousParallelEnv` for the settings.

    With `rogues="agents"` it is a `TwoSidedParallelEnv`, whose agents are the robots and the rogues.
    """
    robots = LissajousParallelEnv(scenario, render_mode, **settings)
    if robots.scenario.targets.rogues != AGENTS:
        return robots
    return TwoSidedParallelEnv(robots, settings.get("discrete_actions", False))


def env(scenario: str | Scenario = "experiment", render_mode: str | None = None, **settings: Any) -> AECEnv:
    """Make the `AECEnv` of a scenario, in which the agents act in turn; the arguments are those of `parallel_env`."""
    return _NamedAgents(parallel_to_aec(parallel_env(scenario, render_mode, **settings)))


def gymnasium_env(
    scenario: str | Scenario = "experiment", render_mode: str | None = None, robots: Any = None, **settings: Any
) -> gymnasium.Env:
    """Make the Gymnasium environment of a scenario: `LissajousEnv`, whose agent is the team of robots.

    With `robots`, a policy, it is a `LissajousRogueEnv`, whose agent is the team of rogues.
    """
    if robots is None:
        return LissajousEnv(scenario, render_mode, **settings)
    return LissajousRogueEnv(scenario, robots, render_mode, **settings)
