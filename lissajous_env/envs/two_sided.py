"""The PettingZoo environment of one world with two sides: an agent per robot and an agent per rogue."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np

from lissajous_env.envs.actions import ActionReader, check_agents, rogue_action_space, rogue_table
from lissajous_env.envs.agents import Around, SpacesOfAgents
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.wording import shown
from lissajous_env.world.rogues.rows import rogue_layout


class TwoSidedParallelEnv(Around, SpacesOfAgents):
    """Robots against rogues, as a PettingZoo `ParallelEnv`; `parallel_env` makes it where `rogues` is `agents`.

    The agents are `robot_0` ..., as in `LissajousParallelEnv`, and `rogue_0` ..., one for each target that an episode
    can have. Only live agents are in `agents`: a rogue from the step in which it appears until it is detected, which
    terminates it, or until the episode ends, which truncates it. A detected rogue does not return in this episode; the
    next arrival is the next agent. A rogue that appears within a sensing disc is detected at once, and never an agent.

    The action of a rogue is a velocity [`targets.speed_limit`], shortened to length 1; walls stop it.
    `lissajous_env.world.rogues.rows` describes its observation. Its reward is the time of the step for which it was
    undetected [s], so that its return is its detection time. Its info is empty.

    Args:
        robots: Environment of the robots' side, for a scenario with `targets.rogues` = `agents`.
        discrete_actions: True for rogues whose actions are indices of `lissajous_env.envs.actions.rogue_table`.

    Raises:
        ValueError: the rogues of the scenario are not agents.
    """

    metadata = LissajousParallelEnv.metadata

    def __init__(self, robots: LissajousParallelEnv, discrete_actions: bool = False):
        if robots.scenario.targets.rogues != AGENTS:
            raise ValueError(f"targets.rogues must be {AGENTS}, got {robots.scenario.targets.rogues}")
        self.inner = robots
        self.scenario, self.simulation, self.render_mode = robots.scenario, robots.simulation, robots.render_mode
        self.possible_robots = list(robots.possible_agents)
        self.possible_rogues = [f"rogue_{t}" for t in range(self.scenario.target_capacity)]
        self.possible_agents = [*self.possible_robots, *self.possible_rogues]
        self.agents: list[str] = []
        layout = rogue_layout(self.scenario)
        self.observation_spaces = dict(robots.observation_spaces)
        self.action_spaces = dict(robots.action_spaces)
        for agent in self.possible_rogues:
            self.observation_spaces[agent] = gymnasium.spaces.Box(layout.low, layout.high, dtype=np.float32)
            self.action_spaces[agent] = rogue_action_space(discrete_actions)
        self.state_space = robots.state_space
        self._discrete_actions = discrete_actions
        self._reader = ActionReader(2, rogue_table() if discrete_actions else None)
        self._live: list[int] = []
        """Slots of the rogues that act in the next step."""
        self._bind()

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Begin an episode, as `LissajousParallelEnv.reset`."""
        observations, infos = self.inner.reset(seed, options)
        self._seed_wrappers(seed)
        rows, _, present, _, _ = self._fetched()
        self._live = np.flatnonzero(present).tolist()
        for t in self._live:
            observations[self.possible_rogues[t]], infos[self.possible_rogues[t]] = rows[t].copy(), {}
        self.agents = list(observations)
        return observations, infos

    def step(self, actions: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Take one control step with an action for each live agent; numbers outside [-1, 1] are clipped.

        After the end of an episode, a step without actions returns empty dicts.

        Raises:
            ResetNeeded: before the first reset, or with actions after the end of an episode.
            ValueError: an agent is missing or unknown, or an action has a wrong shape or is not finite; the state is
                unchanged.
        """
        if not self.agents:
            return self.inner.step(actions)
        check_agents(actions, self.agents)
        self._read_rogues(actions)
        results = self.inner.step({agent: actions[agent] for agent in self.inner.agents})
        observations, rewards, terminated, truncated, infos = results
        rows, reward, present, gone, late = self._fetched()
        rows, acted, self._live = rows.copy(), self._live, np.flatnonzero(present).tolist()
        reward, gone, late = reward.tolist(), gone.tolist(), late.tolist()
        for t in sorted({*acted, *self._live}):
            agent = self.possible_rogues[t]
            observations[agent], rewards[agent], infos[agent] = rows[t], reward[t], {}
            terminated[agent], truncated[agent] = gone[t], late[t]
        self.agents = [*self.inner.agents, *(self.possible_rogues[t] for t in self._live)]
        return results

    def state(self) -> np.ndarray:
        """Return the true state of the world, for centralized critics; see `lissajous_env.envs.true_state`."""
        return self.inner.state()

    def _bind(self) -> None:
        """Set up the arrays of a step, which on the CPU are views of the simulation's memory."""
        self._views = self._fetch() if self.simulation.device.is_cpu else None
        self._action = self.simulation.rogue_action.numpy()[0] if self.simulation.device.is_cpu else None

    def _fetch(self) -> tuple[np.ndarray, ...]:
        sim = self.simulation
        arrays = sim.rogue_observation, sim.rogue_reward, sim.rogue_present, sim.rogue_terminated, sim.rogue_truncated
        return tuple(array.numpy()[0] for array in arrays)

    def _fetched(self) -> tuple[np.ndarray, ...]:
        """Return the rogues' rows, rewards, and whether they are present, terminated and truncated, on the host."""
        return self._fetch() if self._views is None else self._views

    def _read_rogues(self, actions: Mapping[str, Any]) -> None:
        """Copy the actions of the live rogues; those of other slots have no effect.

        Raises:
            ValueError: an action has a wrong shape or is not finite.
        """
        given = [actions[self.possible_rogues[t]] for t in self._live]
        rows = np.zeros((len(self.possible_rogues), 2))
        if not self._discrete_actions and all(
            type(row) is np.ndarray and row.shape == (2,) and row.dtype.kind == "f" for row in given
        ):
            rows[self._live] = given or 0.0
        else:
            for t, row in zip(self._live, given, strict=True):
                self._reader.read(self.possible_rogues[t], row, rows[t])
        self._reader.check(self.possible_rogues, rows)
        if self._action is None:
            self.simulation.rogue_action.assign(rows[None].astype(np.float32))
        else:
            self._action[:] = rows

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in ("_views", "_action", "simulation")}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__dict__.update(saved)
        self.simulation = self.inner.simulation
        self._bind()

    def _check_agent(self, agent: Any) -> None:
        if not isinstance(agent, str) or agent not in self.action_spaces:
            last = self.possible_robots[-1], self.possible_rogues[-1]
            raise ValueError(f"agent must be one of robot_0 to {last[0]} or rogue_0 to {last[1]}, got {shown(agent)}")
