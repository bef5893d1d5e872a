"""The Gymnasium environment of one world, in which the whole team is one agent."""

from typing import Any

from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv
from lissajous_env.envs.team_env import TeamEnv
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.parameters.scenario import Scenario


def refuse_rogue_agents(scenario: Scenario) -> None:
    """Raise ValueError for a scenario whose rogues are agents."""
    if scenario.targets.rogues == AGENTS:
        rule = "must be None or a scripted rogue if the team of robots is the agent"
        raise ValueError(f"targets.rogues {rule}, got {AGENTS}; robots=POLICY makes an environment of the rogues")


class LissajousEnv(TeamEnv):
    """One world as a `gymnasium.Env`; the agent is the team, as in `LissajousVectorEnv`.

    The observation is (N, D), the reward the mean over the robots. The info contains `robot_reward` (N,),
    `reward_terms` (N, terms) in the order of `lissajous_env.world.reward.TERMS`, and `score` when the episode ends.

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
        super().__init__(parallel, settings.get("discrete_actions", False), flat_actions)
