"""The Gymnasium environment of one world, in which the whole team is one agent."""

from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from lissajous_env.envs.actions import team_action_space
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import shown
from lissajous_env.world.simulation import Simulation

if TYPE_CHECKING:
    from lissajous_env.replay import Replay


def team_spaces(simulation: Simulation, discrete: bool, flat: bool) -> tuple[gymnasium.spaces.Box, gymnasium.Space]:
    """Return the observation space (N, D) and the action space of the team of one world."""
    layout, n = simulation.layout, simulation.num_robots
    low, high = np.tile(layout.low, (n, 1)), np.tile(layout.high, (n, 1))
    observation = gymnasium.spaces.Box(low, high, dtype=np.float32)
    return observation, team_action_space(simulation.scenario, discrete, flat)


def refuse_rogue_agents(scenario: Scenario) -> None:
    """Raise ValueError for a scenario whose rogues are agents."""
    if scenario.targets.rogues == AGENTS:
        rule = "must be None or a scripted rogue if the team of robots is the agent"
        raise ValueError(f"targets.rogues {rule}, got {AGENTS}; robots=POLICY makes an environment of the rogues")


class LissajousEnv(gymnasium.Env):
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

    metadata = LissajousParallelEnv.metadata

    def __init__(
        self,
        scenario: str | Scenario = "experiment",
        render_mode: str | None = None,
        *,
        flat_actions: bool = False,
        **settings: Any,
    ):
        self.parallel = LissajousParallelEnv(scenario, render_mode, **settings)
        refuse_rogue_agents(self.parallel.scenario)
        self.render_mode = render_mode
        self.scenario = self.parallel.scenario
        discrete = settings.get("discrete_actions", False)
        spaces = team_spaces(self.parallel.simulation, discrete, flat_actions)
        self.observation_space, self.action_space = spaces
        self._rows = None if discrete or not flat_actions else (self.scenario.num_robots, self.scenario.action_size)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Begin an episode, as `LissajousParallelEnv.reset`."""
        observations, infos = self.parallel.reset(seed, options)
        super().reset(seed=None if seed is None else int(seed))
        return self._observed(), self._info(dict.fromkeys(observations, 0.0), infos)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Take one control step with the actions of all robots.

        Raises:
            ResetNeeded: before the first reset, or after the end of an episode.
            ValueError: an action has a wrong shape or is not finite; the state is unchanged.
        """
        if self._rows is not None:
            if np.shape(action) != self.action_space.shape:
                raise ValueError(f"action must have shape {self.action_space.shape}, got {shown(action)}")
            action = np.reshape(action, self._rows)
        if np.shape(action)[:1] != (self.scenario.num_robots,):
            raise ValueError(
                f"action must have a row for each of {self.scenario.num_robots} robots, got {shown(action)}"
            )
        rows = dict(zip(self.parallel.possible_agents, action, strict=True))
        live = {agent: rows[agent] for agent in self.parallel.agents}
        _, rewards, _, _, infos = self.parallel.step(live)
        info = self._info(rewards, infos)
        over = not self.parallel.agents
        terminated = bool(self.parallel.simulation.terminated.numpy().all())
        if over:
            info["score"] = self.parallel.score()
        return self._observed(), float(info["robot_reward"].mean()), terminated, over and not terminated, info

    def render(self) -> Any:
        """Draw the world, as `LissajousParallelEnv.render`."""
        return self.parallel.render()

    def replay(self, policy: str = "") -> "Replay":
        """Return the episode so far as a page, as `LissajousParallelEnv.replay`; requires `record=True`."""
        return self.parallel.replay(policy)

    def close(self) -> None:
        """Close the window, if there is one."""
        self.parallel.close()

    def _observed(self) -> np.ndarray:
        return self.parallel.simulation.observation.numpy()[0].copy()

    def _info(self, rewards: dict[str, float], infos: dict[str, dict]) -> dict[str, Any]:
        agents = self.parallel.possible_agents
        nothing = np.zeros(len(self.parallel.simulation.reward_term_names), np.float32)
        terms = [infos[agent]["reward_terms"] if agent in infos else nothing for agent in agents]
        reward = np.array([rewards.get(agent, 0.0) for agent in agents], dtype=np.float32)
        return {"robot_reward": reward, "reward_terms": np.stack(terms)}
