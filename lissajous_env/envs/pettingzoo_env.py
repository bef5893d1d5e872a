"""The PettingZoo environment of one world, with one agent per robot and, against rogues that learn, one per rogue."""

import os
from collections.abc import Mapping, Sequence
from itertools import repeat
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils.seeding import np_random
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils import parallel_to_aec

from lissajous_env.envs.batch import NEEDS_RESET, Batch
from lissajous_env.envs.one_world import METADATA, OneWorld
from lissajous_env.envs.sides import Rows, Side, check_agents
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
    `lissajous_env.world.rogues.acting` describes its observation. Its reward is the time of the step for which it was
    undetected [s], so that its return is its detection time. Its info is empty.

    **With a space of scenarios**, each reset draws one. A reset with a seed always draws the same scenario and episode;
    later resets without a seed draw a sequence that depends only on that seed. `possible_agents` are those of the
    largest team among the first 64 scenarios of the split, and `agents` the robots of the scenario. A drawn scenario
    with more robots or more target slots than all of these is skipped.

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
        spaces = {name: side.spaces() for side in batch.sides for name in side.names}
        self.possible_agents = list(spaces)
        self.agents: list[str] = []
        self.observation_spaces = {name: of_agent[0] for name, of_agent in spaces.items()}
        self.action_spaces = {name: of_agent[1] for name, of_agent in spaces.items()}
        self.state_space = gymnasium.spaces.Box(-np.inf, np.inf, batch.state()[0].shape, np.float32)
        self.np_random: np.random.Generator | None = None
        """Generator for wrappers, which `reset` with a seed seeds; the environment itself does not use it."""
        self._begun = False
        self._sides: list[Side] = batch.sides
        self._live: list[list[int]] = []
        """Indices of the agents that act in the next step, for each side."""
        self._set_batch(batch, render_mode)

    def observation_space(self, agent: str) -> gymnasium.spaces.Space:
        """Return the observation space of an agent, always the same object."""
        return self.observation_spaces[self._checked(agent)]

    def action_space(self, agent: str) -> gymnasium.spaces.Space:
        """Return the action space of an agent, always the same object."""
        return self.action_spaces[self._checked(agent)]

    def _checked(self, agent: Any) -> str:
        if not isinstance(agent, str) or agent not in self.action_spaces:
            known = " or ".join(f"{side.names[0]} to {side.names[-1]}" for side in self._sides)
            raise ValueError(f"agent must be one of {known}, got {shown(agent)}")
        return agent

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Begin an episode with the given seed, or with one that follows from the previous seed.

        Without a seed, that of the first episode comes from the operating system; `score()["seed"]` contains it.
        """
        self._begin(seed)
        if seed is not None or self.np_random is None:
            self.np_random = np_random(None if seed is None else int(seed))[0]
        self._begun = True
        self._live = [list(range(self.scenario.num_robots)), []][: len(self._sides)]
        observations, *_, infos = self._results()
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
        if type(actions) is not dict or len(actions) != len(self.agents):
            check_agents(actions, self.agents)
        try:
            self._sides[0].read_agent_actions(actions, self._live[0], self._actions[0])
            if len(self._sides) > 1:  # a loop would take 3 % of a step
                self._sides[1].read_agent_actions(actions, self._live[1], self._actions[1])
        except KeyError:
            check_agents(actions, self.agents)
            raise
        if self._on_device:
            for array, given in zip(self._arrays, self._actions, strict=True):
                array.assign(given.reshape(array.shape))
        self.simulation.advance()
        return self._results()

    def _results(self) -> tuple[dict, dict, dict, dict, dict]:
        """Return the results of the agents that acted or that act in the next step; store the latter in `agents`."""
        if self._on_device:
            self._fetch()
        live, agents = self._live[0], self._names
        observation, _, reward, terminated, truncated, terms = self._rows[0]
        infos = [{"reward_terms": row} for row in terms.copy()]
        columns = [observation.copy(), reward.tolist(), terminated.tolist(), truncated.tolist(), infos]
        if len(live) < len(agents):
            agents, *columns = [[column[i] for i in live] for column in (agents, *columns)]
        # The lengths are equal; a strict zip would double the time.
        results: Any = tuple(map(dict, map(zip, repeat(agents), columns)))
        if True in columns[2] or True in columns[3]:
            agents = [agent for agent in agents if not (results[2][agent] or results[3][agent])]
            self._live[0] = [self._names.index(agent) for agent in agents]
        self.agents = agents
        if len(self._rows) > 1:
            self._add_rogues(self._sides[1], self._rows[1], results)
        if self.render_mode == "human":
            self.render()
        return results

    def _add_rogues(self, side: Side, rows: Rows, results: Sequence[dict]) -> None:
        """Add the rogues that acted in the step, or that act in the next one, to its results and to `agents`."""
        live = np.flatnonzero(rows.mask).tolist()
        slots = sorted({*self._live[1], *live})
        names, self._live[1] = [side.names[t] for t in slots], live
        results[0].update(zip(names, rows.observation[slots], strict=True))
        for result, column in zip(results[1:4], (rows.reward, rows.terminated, rows.truncated), strict=True):
            result.update(zip(names, column[slots].tolist(), strict=True))
        results[4].update((name, {}) for name in names)
        self.agents = [*self.agents, *(side.names[t] for t in live)]

    def state(self) -> np.ndarray:
        """Return the true state of the world, for centralized critics; see `lissajous_env.envs.sides.state_names`.

        Of a space, it has the size of the largest team and of the largest number of target slots.
        """
        return self.batch.state()[0]

    def _use_simulation(self) -> None:
        super()._use_simulation()
        self._bind()

    def _bind(self) -> None:
        """Set up the arrays of a step, which on the CPU are views of the simulation's memory."""
        self._on_device = not self.simulation.device.is_cpu
        self._names = self._sides[0].names[: self.simulation.num_robots]
        rogues = [self.simulation.rogues.action] if len(self._sides) > 1 else []
        self._arrays = [self.simulation.action, *rogues]
        self._actions = [array.numpy().reshape(-1) for array in self._arrays]
        self._fetch()

    def _fetch(self) -> None:
        """Copy the results of a step to the host; on the CPU they are views of the simulation's memory."""
        self._rows = [Rows(*(array[0] for array in self.batch.views(0, side))) for side in self._sides]

    def __getstate__(self) -> dict[str, Any]:
        return super().__getstate__() | {"_rows": None, "_arrays": None, "_actions": None}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__dict__.update(saved)
        self._bind()


def env(scenario: Any = "experiment", render_mode: str | None = None, **settings: Any) -> AECEnv:
    """Make the `AECEnv` of a scenario, in which the agents act in turn.

    The arguments are those of `LissajousParallelEnv`.
    """
    return parallel_to_aec(LissajousParallelEnv(scenario, render_mode, **settings))
