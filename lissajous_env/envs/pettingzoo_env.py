"""The PettingZoo environment of one world, with one agent per robot and, against rogues that learn, one per rogue."""

import operator
import os
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils.seeding import np_random
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import parallel_to_aec, wrappers

from lissajous_env.envs.batch import Batch
from lissajous_env.envs.one_world import METADATA, NEEDS_RESET, OneWorld
from lissajous_env.envs.sides import LARGE, Side, check_agents
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.space import ScenarioSpace
from lissajous_env.wording import shown


class LissajousParallelEnv(OneWorld, ParallelEnv):
    """Robots that monitor a rectangle and detect targets, as a PettingZoo `ParallelEnv`.

    **Robots** are `robot_0` ... A failed robot remains an agent: it still observes, with `works` at 0 and actions
    without effect. Robots are terminated only if `task.on_collision` or `task.boundary` is `remove`. Every episode is
    truncated after `task.duration`. Without a seed, every run starts with a different random episode.
    `lissajous_env.world.observation` describes the observation. The reward is the sum of the terms in `reward_terms` of
    the info, in the order of `lissajous_env.world.tally.TERMS`.

    **Rogues** `rogue_0` ... are agents if `targets.rogues` is `agents`, one for each target that an episode can have.
    Only live agents are in `agents`: a rogue from the step in which it appears until it is detected, which terminates
    it, or until the episode ends, which truncates it. A detected rogue does not return in this episode; the next
    arrival is the next agent. A rogue that appears within a sensing disc is detected at once, and never an agent. Its
    action is a velocity [`targets.speed_limit`], shortened to length 1; walls stop it.
    `lissajous_env.world.rogues.rows` describes its observation. Its reward is the time of the step for which it was
    undetected [s], so that its return is its detection time. Its info is empty.

    **Of a space of scenarios**, each reset draws one. A reset with a seed draws the same scenario and the same episode
    whatever came before; later resets without a seed draw a sequence that depends only on that seed. `possible_agents`
    are those of the largest team among the first 64 scenarios of the split, and `agents` the robots of the scenario. A
    drawn scenario with more robots or more target slots than all of these is skipped.

    Args:
        scenario: Name of a scenario, or a `Scenario`; a space of scenarios, or SPACE:SPLIT, where SPLIT is a split or a
            shift, by default `train`.
        render_mode: None, `rgb_array`, or `human` for a window; pictures of two scenarios differ in size.
        discrete_actions: True for actions that are indices of `lissajous_env.envs.sides.action_table`, and of
            `rogue_table` for rogues.
        max_cycles: Number of steps of an episode, instead of `task.duration`.
        device: Warp device.
        **overrides: Fields of the scenario, as in `lissajous_env.parameters.scenario`; of a space, those that are given
            instead of drawn.

    Raises:
        UnknownSettingError: an unknown keyword (a `ValueError` and a `TypeError`).
        ValueError: an invalid setting, or scenarios of a space with rows or actions of different sizes.
    """

    metadata = METADATA
    _np_random: np.random.Generator | None = None

    def __init__(
        self,
        scenario: str | os.PathLike | Scenario | ScenarioSpace = "experiment",
        render_mode: str | None = None,
        *,
        discrete_actions: bool = False,
        max_cycles: int | None = None,
        device: Any = "cpu",
        **overrides: Any,
    ):
        settings: dict[str, Any] = {"discrete_actions": discrete_actions, "max_cycles": max_cycles, "device": device}
        batch = Batch(scenario, **settings, overrides=overrides)
        sides = {name: side for side in batch.sides for name in side.names}
        self.possible_agents = list(sides)
        self.agents: list[str] = []
        self.observation_spaces = {name: side.row_space() for name, side in sides.items()}
        self.action_spaces = {name: side.action_space() for name, side in sides.items()}
        self.state_space = gymnasium.spaces.Box(-np.inf, np.inf, (batch.state_size,), np.float32)
        self._robots: Side = batch.sides[0]
        self._rogues: Side | None = batch.sides[1] if len(batch.sides) > 1 else None
        self._begun = False
        self._live_robots: list[str] = []
        self._live_rogues: list[int] = []
        """Slots of the rogues that act in the next step."""
        self._start(batch, render_mode)

    @property
    def np_random(self) -> np.random.Generator:
        """Generator for wrappers, which `reset` with a seed seeds; the environment itself does not use it."""
        if self._np_random is None:
            self._np_random = np_random()[0]
        return self._np_random

    def observation_space(self, agent: str) -> gymnasium.spaces.Space:
        """Return the observation space of an agent, always the same object."""
        return self.observation_spaces[self._checked(agent)]

    def action_space(self, agent: str) -> gymnasium.spaces.Space:
        """Return the action space of an agent, always the same object."""
        return self.action_spaces[self._checked(agent)]

    def _checked(self, agent: Any) -> str:
        if not isinstance(agent, str) or agent not in self.action_spaces:
            known = " or ".join(f"{side.names[0]} to {side.names[-1]}" for side in self.batch.sides)
            raise ValueError(f"agent must be one of {known}, got {shown(agent)}")
        return agent

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Begin an episode with the given seed, or with one that follows from the previous seed.

        Without a seed, that of the first episode comes from the operating system; `score()["seed"]` contains it.
        """
        self._begin(seed)
        if seed is not None:
            self._np_random = np_random(int(seed))[0]
        self._begun = True
        if self._on_device:
            self._fetch()
        self._live_robots = self._names
        observations = dict(zip(self._names, self._observation.copy(), strict=True))
        infos = {agent: {"reward_terms": row} for agent, row in zip(self._names, self._terms.copy(), strict=True)}
        if self._rogues is not None:
            rows = self.batch.rows(self._rogues)
            self._live_rogues = np.flatnonzero(rows.mask[0]).tolist()
            for t in self._live_rogues:
                name = self._rogues.names[t]
                observations[name], infos[name] = rows.observation[0, t].copy(), {}
        self.agents = list(observations)
        if self.render_mode == "human":
            self.render()
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
            if not self._begun or not isinstance(actions, Mapping) or actions:
                raise ResetNeeded(NEEDS_RESET)
            return {}, {}, {}, {}, {}
        if not self._read_at_once(actions):
            self._read(actions)
        if self._on_device:
            self.simulation.action.assign(self._action.reshape(self.simulation.action_shape))
        self.simulation.advance()
        if self._on_device:
            self._fetch()
        agents = self._live_robots
        observation, terms = self._observation.copy(), self._terms.copy()
        rewards, terminated, truncated = self._reward.tolist(), self._terminated.tolist(), self._truncated.tolist()
        infos = [{"reward_terms": row} for row in terms]
        if len(agents) < len(self._names):
            live = [self._index[agent] for agent in agents]
            observation, rewards, terminated, truncated, infos = (
                [column[i] for i in live] for column in (observation, rewards, terminated, truncated, infos)
            )
        # The lengths are equal; a strict zip would double the time.
        results = (
            dict(zip(agents, observation)),  # noqa: B905
            dict(zip(agents, rewards)),  # noqa: B905
            dict(zip(agents, terminated)),  # noqa: B905
            dict(zip(agents, truncated)),  # noqa: B905
            dict(zip(agents, infos)),  # noqa: B905
        )
        if True in terminated or True in truncated:
            agents = [agent for agent in agents if not (results[2][agent] or results[3][agent])]
        self._live_robots = self.agents = agents
        if self._rogues is not None:
            self._add_rogues(self._rogues, results)
        if self.render_mode == "human":
            self.render()
        return results

    def _add_rogues(self, side: Side, results: tuple[dict, dict, dict, dict, dict]) -> None:
        """Add the rogues that acted in a step, and those that act in the next one, to its results."""
        rows, acted = self.batch.rows(side), self._live_rogues
        self._live_rogues = np.flatnonzero(rows.mask[0]).tolist()
        for t in sorted({*acted, *self._live_rogues}):
            values = rows.observation[0, t].copy(), float(rows.reward[0, t]), bool(rows.terminated[0, t])
            for column, value in zip(results, (*values, bool(rows.truncated[0, t]), {}), strict=True):
                column[side.names[t]] = value
        self.agents = [*self._live_robots, *(side.names[t] for t in self._live_rogues)]

    def state(self) -> np.ndarray:
        """Return the true state of the world, for centralized critics; see `lissajous_env.envs.true_state`.

        Of a space, it has the size of the largest team and of the largest number of target slots.
        """
        return self.batch.state()[0]

    def _use_simulation(self) -> None:
        super()._use_simulation()
        self._bind()

    def _bind(self) -> None:
        """Set up the arrays of a step, which on the CPU are views of the simulation's memory."""
        sim, count = self.simulation, self.simulation.num_robots
        self._names = self._robots.names[:count]
        self._index = {agent: i for i, agent in enumerate(self._names)}
        self._on_device = not sim.device.is_cpu
        self._fetch()
        self._action = sim.action.numpy().reshape(-1)
        at_once = count > 1 and self._robots.table is None and self._rogues is None
        self._pick = operator.itemgetter(*self._names) if at_once else None
        self._shapes = [sim.action_shape[2:]] * count

    def _read_at_once(self, actions: Any) -> bool:
        """Copy regular actions, one float32 array per agent; return False if the actions need individual checks."""
        if self._pick is None or type(actions) is not dict or len(actions) != len(self.agents):
            return False
        try:
            rows = self._pick(actions)
            np.concatenate(rows, out=self._action, casting="no")
            regular = [row.shape for row in rows] == self._shapes
        except (KeyError, TypeError, ValueError, AttributeError, RuntimeError):
            return False
        # The sum of squares is not finite if any number is not.
        return regular and bool(self._action.dot(self._action) < LARGE)

    def _read(self, actions: Any) -> None:
        """Check and copy the actions one by one.

        Raises:
            ValueError: an agent is missing or unknown, or an action has a wrong shape or is not finite.
        """
        check_agents(actions, self.agents)
        rows = np.zeros(self.simulation.action_shape[1:], np.float32)
        for agent in self._live_robots:
            self._robots.read_one(agent, actions[agent], rows[self._index[agent]])
        if self._rogues is not None:
            of_rogues = np.zeros((1, self._rogues.places, self._rogues.action_size), np.float32)
            for t in self._live_rogues:
                self._rogues.read_one(self._rogues.names[t], actions[self._rogues.names[t]], of_rogues[0, t])
            self.simulation.rogues.action.assign(of_rogues)
        self._action[:] = rows.ravel()

    def _fetch(self) -> None:
        """Copy the results of a step to the host; on the CPU they are views of the simulation's memory."""
        sim = self.simulation
        arrays = sim.observation, sim.reward, sim.reward_terms, sim.terminated, sim.truncated
        self._observation, self._reward, self._terms, self._terminated, self._truncated = (
            array.numpy()[0] for array in arrays
        )

    def __getstate__(self) -> dict[str, Any]:
        bound = ("_observation", "_reward", "_terminated", "_truncated", "_terms", "_renderer", "_action", "_pick")
        return {name: value for name, value in self.__dict__.items() if name not in bound}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__dict__.update(saved)
        self._renderer = None
        self._bind()


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
