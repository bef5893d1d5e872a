"""The two sides of a batch, robots and rogues: names, rows, actions, and tables of discrete actions.

`state_rows` returns the true state of each world, for centralized critics.
"""

import operator
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import warp as wp
from gymnasium.vector.utils import batch_space

from lissajous_env.device.devices import as_floats, is_torch
from lissajous_env.parameters import named
from lissajous_env.parameters.robot_models import REST_OR_DIRECTION
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import is_whole
from lissajous_env.wording import require
from lissajous_env.world.observation import layout
from lissajous_env.world.rogues.acting import rogue_layout
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import PRESENT, WORKING

LARGE = 1e30
"""Sum of squares of all actions above which each is checked: the sum is not finite if a number is not."""
_OF_ROBOT = ("x", "y", "cos_heading", "sin_heading", "speed", "cos_phase", "sin_phase", "works")
_OF_TARGET = ("waiting", "x", "y")


class Rows(NamedTuple):
    """Results of a step for a side of W worlds, with N slots for agents: NumPy arrays, or torch tensors on the device.

    Slots without an agent, as in scenarios with smaller teams, are terminated, with rows and rewards of zeros. The
    arrays are copies, or views of the simulation's memory that the next step overwrites.
    """

    observation: Any
    """(W, N, D) rows."""
    mask: Any
    """(W, N) True for each robot of the scenario, also if it was removed, and each rogue that acts in the next step."""
    reward: Any
    """(W, N) rewards."""
    terminated: Any
    """(W, N) True from the step on in which a robot was removed or a rogue detected."""
    truncated: Any
    """(W, N) True where the episode has reached its time limit."""
    terms: Any
    """(W, N, terms) the terms of a robot's reward, whose names are `simulation.reward_term_names`; a rogue has one."""


class Side:
    """One side of a batch: `robot` or `rogue` agents, which share their spaces.

    Args:
        agent: `robot` or `rogue`, the prefix of the agents' names.
        scenario: A scenario of the batch.
        slots: N, the number of robots of the largest team, or of target slots.
        discrete: True for actions that are indices of a table.
    """

    def __init__(self, agent: str, scenario: Scenario, slots: int, discrete: bool = False):
        self.agent, self.slots, self.is_robots = agent, slots, agent == "robot"
        self.names = [f"{agent}_{i}" for i in range(slots)]
        self.layout = layout(scenario) if self.is_robots else rogue_layout(scenario)
        self.action_size = scenario.action_size if self.is_robots else 2
        self._sizes = [self.action_size] * slots
        self._pick_all = operator.itemgetter(*self.names) if slots > 1 else None
        table = action_table(scenario) if self.is_robots else rogue_table()
        self.table = table if discrete else None
        """(K, action_size) actions from which a discrete action selects; None for continuous actions."""

    def spaces(self) -> tuple[gymnasium.spaces.Box, gymnasium.Space]:
        """Return the spaces of one agent: its row (D,), and its action, in [-1, 1] or an index of the table."""
        rows = gymnasium.spaces.Box(self.layout.low, self.layout.high, dtype=np.float32)
        if self.table is not None:
            return rows, gymnasium.spaces.Discrete(len(self.table))
        return rows, gymnasium.spaces.Box(-1.0, 1.0, (self.action_size,), np.float32)

    def team_spaces(self) -> tuple[gymnasium.spaces.Box, gymnasium.Space]:
        """Return the spaces of all agents together: rows (N, D); actions (N, action_size), or indices (N,)."""
        return tuple(batch_space(space, self.slots) for space in self.spaces())  # type: ignore[return-value]

    def rows(self, simulation: Simulation, library: Any = np) -> Rows:
        """Return the rows of this side of a simulation, as arrays of `numpy`, or of `torch` on its device."""
        read = wp.array.numpy if library is np else wp.to_torch
        if self.is_robots:
            ends = read(simulation.terminated), read(simulation.truncated)
            mask, terms = library.ones_like(ends[0]), read(simulation.reward_terms)
            return Rows(read(simulation.observation), mask, read(simulation.reward), *ends, terms)
        rogues = simulation.rogues
        reward, ends = read(rogues.reward), (read(rogues.terminated), read(rogues.truncated))
        return Rows(read(rogues.observation), read(rogues.present), reward, *ends, reward[..., None])

    def read_actions(self, actions: Any, shape: tuple[int, ...], finite: bool = True) -> np.ndarray:
        """Return actions as float32 (W, N, action_size), clipped to [-1, 1].

        Args:
            actions: Actions of all slots of W worlds: numbers or, with a table, indices, in an array of any library.
            shape: Shape that they must have; any that can be reshaped to W, N and the rest.
            finite: True if every number must be finite; False to convert actions alone, without clipping them.

        Raises:
            ValueError: another shape, an index outside the table, or a number that is not finite.
        """
        given = np.asarray(on_host(actions))
        kinds, words = ("fiu", "numbers") if self.table is None else ("iu", "whole numbers")
        if given.shape != shape or given.dtype.kind not in kinds:
            raise ValueError(f"actions must be {words} of shape {shape}, got {given.shape} of {given.dtype}")
        if self.table is not None:
            if not ((given >= 0) & (given < len(self.table))).all():
                self._refuse(given.reshape(-1))
            return self.table[given].reshape(-1, self.slots, self.action_size)
        rows = given.reshape(-1, self.slots, self.action_size)
        if not finite:  # the simulation clips them, and reports those that are not finite
            return as_floats("actions", rows)
        if not np.vdot(rows, rows) < LARGE and not np.isfinite(rows).all():
            self._refuse(rows.reshape(-1, self.action_size))
        return np.clip(rows, -1.0, 1.0).astype(np.float32, copy=False)

    def _refuse(self, actions: np.ndarray) -> None:
        """Raise ValueError for the first action (W N, ...) that is an index outside the table, or is not finite."""
        for k, action in enumerate(actions.tolist()):
            self._read_one(f"{self.names[k % self.slots]} in world {k // self.slots}", action)

    def read_agent_actions(self, actions: Mapping[str, Any], slots: Sequence[int], flat_out: np.ndarray) -> None:
        """Write the actions of the agents in `slots` into `flat_out` (N * action_size,), and zeros for the others.

        Raises:
            KeyError: an agent is missing.
            ValueError: an action has a wrong shape, is an index outside the table, or is not finite; `flat_out` is 0.
        """
        if self._pick_all and len(slots) == self.slots:
            given = self._pick_all(actions)
        else:
            given = [actions[self.names[slot]] for slot in slots]
        if len(flat_out) == len(given) * self.action_size and self.table is None:
            try:  # Actions that are all float32 arrays are copied together, which is faster.
                np.concatenate(given, out=flat_out, casting="no")
                if [*map(len, given)] == self._sizes and flat_out.dot(flat_out) < LARGE:
                    return
            except (TypeError, ValueError, RuntimeError):
                pass
        flat_out[:] = 0.0  # so that no number that is refused stays
        rows = [self._read_one(self.names[slot], on_host(action)) for slot, action in zip(slots, given, strict=True)]
        flat_out.reshape(-1, self.action_size)[list(slots)] = np.reshape(rows, (len(rows), self.action_size))

    def _read_one(self, agent: str, action: Any) -> np.ndarray:
        """Return the row of an action."""
        if self.table is not None:
            index = action.item() if isinstance(action, np.ndarray) and action.size == 1 else action
            fits, last = is_whole(index) and 0 <= index < len(self.table), len(self.table) - 1
            require(fits, f"action of {agent}", f"must be a whole number from 0 to {last}", action)
            return self.table[index]
        values, size = np.asarray(action), self.action_size
        # Some libraries squeeze an action with one component to a number.
        fits = values.shape == (size,) or (values.shape == () and size == 1)
        fits = fits and values.dtype.kind in "fiu"
        require(fits, f"action of {agent}", f"must be numbers of shape {(size,)}", action)
        require(np.isfinite(values).all(), f"action of {agent}", "must be finite", np.ravel(values).tolist())
        return np.clip(values, -1.0, 1.0)  # float32 has a smaller range than float64


def sides_of(scenario: Scenario, robots: int, discrete: bool, roles: str = "any") -> list[Side]:
    """Return the sides of a batch: robots, and rogues where these are agents.

    Args:
        scenario: A scenario of the batch.
        robots: Number of robots of the largest team.
        discrete: True for discrete actions.
        roles: `any`; or `robots` or `rogues` for an environment of one side.

    Raises:
        ValueError: the rogues of the scenario do not fit the roles.
    """
    are_agents, rule = scenario.targets.rogues == AGENTS, "must be None or a scripted rogue"
    if roles == "robots" and are_agents:
        raise ValueError(f"targets.rogues {rule} if the robots alone are agents, got {AGENTS}")
    if roles == "rogues" and not are_agents:
        raise ValueError(f"targets.rogues must be {AGENTS} if the rogues are agents, got {scenario.targets.rogues}")
    if are_agents and scenario.target_capacity == 0:
        raise ValueError("targets.count or targets.arrival_rate must be above 0 if the rogues are agents, got 0 and 0")
    rogues = [Side("rogue", scenario, scenario.target_capacity, discrete)] if are_agents else []
    return rogues if roles == "rogues" else [Side("robot", scenario, robots, discrete), *rogues]


def check_agents(actions: Any, live: Sequence[str]) -> None:
    """Raise ValueError unless actions are a mapping that names each live agent once."""
    require(isinstance(actions, Mapping), "actions", "must be a dict of agents and their actions", actions)
    missing = [agent for agent in live if agent not in actions]
    unknown = [agent for agent in actions if agent not in live]
    if missing or unknown:
        raise ValueError(f"actions must name each live agent once: missing {missing}, unknown or not live {unknown}")


def action_table(scenario: str | Scenario) -> np.ndarray:
    """Return the actions (K, action_size) from which a discrete action selects.

    They are steering x throttle for cars, speed x yaw rate for differential drives, phase rates for points, or, where
    actions are velocities, rest and eight directions. With messages of k numbers, the table contains every motion with
    each of k + 1 messages: first zeros, then 1 in component 0 and zeros elsewhere, and so on.
    """
    scenario = named.build(scenario)
    moves = np.array(scenario.model.table, dtype=np.float32)
    messages = np.eye(scenario.messages.size + 1, dtype=np.float32)[:, 1:]
    return np.hstack([np.tile(moves, (len(messages), 1)), np.repeat(messages, len(moves), axis=0)])


def rogue_table() -> np.ndarray:
    """Return the actions (9, 2) from which a rogue's discrete action selects: rest, and eight directions."""
    return np.array(REST_OR_DIRECTION, dtype=np.float32)


def on_host(actions: Any) -> Any:
    """Return arrays of other libraries as NumPy arrays, also torch's on a GPU, with a gradient, or of bfloat16."""
    if isinstance(actions, (list, tuple)):
        return [on_host(action) for action in actions]
    if is_torch(actions) and hasattr(actions, "detach"):
        is_short = actions.is_floating_point() and actions.element_size() < 4  # NumPy does not have all of these types
        return (actions.float() if is_short else actions).numpy(force=True)
    return np.asarray(actions) if hasattr(actions, "__array__") else actions


def state_names(scenario: str | Scenario) -> tuple[str, ...]:
    """Return the names of the S = (8 + `messages.size`) N + 3 T + 1 numbers of a world's true state, in order.

    They are, for each robot, x [half_width], y [half_height], cos and sin of the heading, the speed [top speed of a
    car, or of a point in the equilibrium], cos and sin of the phase, and 1 if it works; for each target slot, 1 if its
    target is present and undetected, with x [half_width] and y [half_height], otherwise zeros; and the elapsed share of
    the episode. If policies send messages, the numbers of a robot end with the message that it sends.
    """
    scenario = named.build(scenario)
    of_robot = (*_OF_ROBOT, *(f"message_{m}" for m in range(scenario.messages.size)))
    robots = [f"robot_{i}_{name}" for i in range(scenario.num_robots) for name in of_robot]
    targets = [f"target_{t}_{name}" for t in range(scenario.target_capacity) for name in _OF_TARGET]
    return (*robots, *targets, "elapsed")


def state_rows(simulation: Simulation, library: Any = np, num_robots: int = 0, num_targets: int = 0) -> Any:
    """Return the true states as float32 rows (W, S), in the order of `state_names`.

    Args:
        simulation: The worlds.
        library: `numpy`, or `torch` for a tensor on the simulation's device, without a copy to the host.
        num_robots: Number of robots in a row, if it is larger than that of the scenario; the additional ones are 0.
        num_targets: Number of target slots in a row, likewise.
    """
    read = wp.array.numpy if library is np else wp.to_torch
    robots, targets, scenario = simulation.robots, simulation.targets, simulation.scenario

    def columns(slots: int, *numbers: Any) -> Any:
        # The phase is float64.
        rows = library.stack([library.asarray(column, dtype=library.float32) for column in numbers], -1)
        return padded(rows, max(slots - rows.shape[1], 0), library).reshape(simulation.num_worlds, -1)

    def scaled(position: Any) -> tuple[Any, Any]:
        return position[..., 0] / scenario.curve.half_width, position[..., 1] / scenario.curve.half_height

    heading, phase = read(robots.heading), read(robots.phase)
    of_robots = columns(
        num_robots,
        *scaled(read(robots.position)),
        library.cos(heading),
        library.sin(heading),
        read(robots.speed) / simulation.speed_unit,
        library.cos(phase),
        library.sin(phase),
        read(robots.status) == WORKING,
        *(read(simulation.messages.sending)[..., m] for m in range(scenario.messages.size)),
    )
    waiting = read(targets.status) == PRESENT
    position = scaled(read(targets.position))
    of_targets = columns(num_targets, waiting, *(waiting * coordinate for coordinate in position))
    elapsed = columns(1, (read(simulation.clock.step) / scenario.task.steps)[:, None])
    return library.concatenate([of_robots, of_targets, elapsed], 1)


def padded(array: Any, missing: int, library: Any) -> Any:
    """Return an array (W, n, ...) with `missing` more slots, which are zero: (W, n + missing, ...)."""
    if not missing:
        return array
    zeros = library.zeros((len(array), missing, *array.shape[2:]), dtype=array.dtype, device=array.device)
    return library.concatenate([array, zeros], 1)
