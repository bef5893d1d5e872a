"""Functions that make the environments of one world."""

import os
from typing import Any

import gymnasium
from pettingzoo import AECEnv
from pettingzoo.utils import parallel_to_aec, wrappers

from lissajous_env.envs.gymnasium_env import LissajousEnv, SampledEnv
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv
from lissajous_env.envs.rogue_env import LissajousRogueEnv
from lissajous_env.envs.sampled_env import SampledParallelEnv
from lissajous_env.envs.two_sided import TwoSidedParallelEnv
from lissajous_env.parameters.named import space_and_split
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.space import ScenarioSpace
from lissajous_env.wording import shown


class _NamedAgents(wrappers.OrderEnforcingWrapper):
    """AEC environment with a clear error for an unknown agent."""

    def observe(self, agent: str) -> Any:
        self.observation_space(agent)  # checks the name
        return super().observe(agent)


def parallel_env(
    scenario: str | os.PathLike | Scenario | ScenarioSpace = "experiment",
    render_mode: str | None = None,
    **settings: Any,
) -> LissajousParallelEnv | TwoSidedParallelEnv | SampledParallelEnv:
    """Make the PettingZoo `ParallelEnv` of a scenario; see `LissajousParallelEnv` for the settings.

    With `rogues="agents"` it is a `TwoSidedParallelEnv`, whose agents are the robots and the rogues. Of a space of
    scenarios, such as `monitoring-v1` or `monitoring-v1:validation`, it is a `SampledParallelEnv`, in which each reset
    draws a scenario.
    """
    if space_and_split(scenario) is not None:
        return SampledParallelEnv(scenario, render_mode, **settings)  # type: ignore[arg-type]
    robots = LissajousParallelEnv(scenario, render_mode, **settings)  # type: ignore[arg-type]
    if robots.scenario.targets.rogues != AGENTS:
        return robots
    return TwoSidedParallelEnv(robots, settings.get("discrete_actions", False))


def env(
    scenario: str | os.PathLike | Scenario | ScenarioSpace = "experiment",
    render_mode: str | None = None,
    **settings: Any,
) -> AECEnv:
    """Make the `AECEnv` of a scenario, in which the agents act in turn; the arguments are those of `parallel_env`."""
    return _NamedAgents(parallel_to_aec(parallel_env(scenario, render_mode, **settings)))


def gymnasium_env(
    scenario: str | os.PathLike | Scenario | ScenarioSpace = "experiment",
    render_mode: str | None = None,
    robots: Any = None,
    **settings: Any,
) -> gymnasium.Env:
    """Make the Gymnasium environment of a scenario: `LissajousEnv`, whose agent is the team of robots.

    With `robots`, a policy, it is a `LissajousRogueEnv`, whose agent is the team of rogues. Of a space of scenarios it
    is a `SampledEnv`.

    Raises:
        ValueError: an invalid setting, or `robots` with a space.
    """
    if space_and_split(scenario) is not None:
        if robots is not None:
            raise ValueError(f"robots must be None in an environment of a space of scenarios, got {shown(robots)}")
        return SampledEnv(scenario, render_mode, **settings)  # type: ignore[arg-type]
    if robots is None:
        return LissajousEnv(scenario, render_mode, **settings)  # type: ignore[arg-type]
    return LissajousRogueEnv(scenario, robots, render_mode, **settings)  # type: ignore[arg-type]


gymnasium_env.metadata = LissajousParallelEnv.metadata  # type: ignore[attr-defined] - for `rgb_array_list` of `make`
