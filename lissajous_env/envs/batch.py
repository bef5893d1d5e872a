"""The batch behind every environment: worlds of one scenario, or of a space of scenarios with padded teams.

An environment for another library is a shell around a `Batch`. It declares the spaces of `Batch.sides`, calls `reset`
and `step`, and converts the arrays of `rows` to those of the library.
"""

import itertools
import os
from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded

from lissajous_env.device.copies import Stateful
from lissajous_env.device.devices import cores
from lissajous_env.device.work import Work
from lissajous_env.envs.sides import Rows, Side, padded, sides_of, state_rows
from lissajous_env.episodes.evaluation import ActingPolicy
from lissajous_env.parameters import named
from lissajous_env.parameters.named import space_and_split
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.space import Draws, ScenarioSpace
from lissajous_env.settings.checks import whole_number
from lissajous_env.wording import require, shown
from lissajous_env.world.observation import layout
from lissajous_env.world.selection import chosen_worlds, drawn_seeds, fold_seed, world_mask
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import ENDED, RUNNING

NEEDS_RESET = "step needs a running episode: call reset first"
FIRST_SCENARIOS = 64
"""Number of scenarios at the beginning of a split whose largest team and most target slots are those of a batch."""
_FROM_SYSTEM, _NEXT = -2, -1
"""Codes for a world's next seed: the system draws it at the reset, another one in each copy; it follows the latest."""


class Batch(Stateful):
    """W worlds in groups of one scenario each.

    Without a space all worlds are one group. With a space, each group draws its first scenario at its first reset, and
    the next one whenever all of its worlds are reset together. Scenarios, and the episodes in them, depend on the seed
    and on the number of the group alone. Scenarios with more robots or more target slots than any of the first
    `FIRST_SCENARIOS` of the split are skipped. `save_state` and `load_state` are for batches without a space; they
    include the arrays of the policy that drives the robots, if it is a `baselines.Policy`.

    Attributes:
        sides: The sides whose actions `step` requires.
        simulations: The simulation of each group.
        robot_policy: Policy that drives the robots if only the rogues act, or None.
        space, split: Space of scenarios and the name of its split or shift, or None.

    Args:
        scenario: Name of a scenario, or a `Scenario`; a space of scenarios, its file, or SPACE:SPLIT, where SPLIT is a
            split or a shift, by default `train`.
        num_worlds: W.
        num_groups: Number of groups that draw from a space, a divisor of W.
        roles: `any`: robots act, and rogues where `targets.rogues` is `agents`; `robots` or `rogues` for one side.
        robots: Policy that drives the robots if, and only if, `roles` is `rogues`; not of a space: a name, a folder,
            a policy for `num_worlds` worlds, a factory, or a function `act(observation) -> action` on NumPy arrays
            (W, N, D) and (W, N, action_size), as `baselines.policies.registry.as_factory` accepts it.
        discrete_actions: True for actions that are indices of a table.
        max_cycles: Number of steps of an episode, instead of `task.duration`.
        device: Warp device.
        threads: CPU threads; all cores by default.
        seed: Seed of world 0 (world k has seed + k), or of the draws from a space; by default, the operating system
            draws one.
        overrides: Fields of the scenario, or of all scenarios of the space.

    Raises:
        UnknownSettingError: an unknown keyword (a `ValueError` and a `TypeError`).
        ValueError: an invalid setting, or scenarios of a space with rows or actions of different sizes.
    """

    def __init__(
        self,
        scenario: str | os.PathLike | Scenario | ScenarioSpace,
        num_worlds: int = 1,
        *,
        num_groups: int = 1,
        roles: str = "any",
        robots: Any = None,
        discrete_actions: bool = False,
        max_cycles: int | None = None,
        device: Any = "cpu",
        threads: int | None = None,
        seed: int | None = None,
        overrides: Mapping[str, Any] = MappingProxyType({}),
    ):
        self.num_worlds = whole_number("num_worlds", num_worlds)
        self.group_size, rest = divmod(self.num_worlds, whole_number("num_groups", num_groups))
        require(rest == 0, "num_worlds", f"must be a multiple of num_groups ({num_groups})", num_worlds)
        self._device, self._cores = device, cores() if threads is None else whole_number("threads", threads)
        # With many groups, each is stepped by one thread; with few, all threads share the worlds of each.
        self._threads = 1 if num_groups > 1 and num_groups >= self._cores else threads
        self._joined: Work | None = None
        require(roles in ("any", "robots", "rogues"), "roles", "must be any, robots or rogues", roles)
        rule = "must be given if, and only if, roles is rogues"
        require((robots is None) == (roles != "rogues"), "robots", rule, robots)
        self._max_cycles = max_cycles
        space = space_and_split(scenario)
        if space is None:
            self.space, self.split = None, None
            require(num_groups == 1, "num_groups", "must be 1 without a space of scenarios", num_groups)
            given = {"rogues": AGENTS} | dict(overrides) if roles == "rogues" else overrides
            samples = [self._resolved(named.scenario(scenario, **given))]  # type: ignore[arg-type]
        else:
            require(robots is None, "robots", "must be None with a space, whose rogues are no agents", robots)
            self.space, self.split = space[0].overridden(overrides), space[1]
            first_of_split = itertools.islice(self.space.scenarios(self.split), FIRST_SCENARIOS)
            samples = [self._resolved(sample) for sample in first_of_split]
            for sample in samples:
                self._check(sample, samples[0])
        # Until the first reset, a space is represented by the first scenario of its split.
        self._first = samples[0]
        self._most_robots = max(sample.num_robots for sample in samples)
        self._most_targets = max(sample.target_capacity for sample in samples)
        self.sides = sides_of(self._first, self._most_robots, discrete_actions, roles)
        self.simulations = [self._simulation(self._first)] * num_groups
        self.robot_policy: ActingPolicy | None = None
        if robots is not None:
            registry = import_module("baselines.policies.registry")  # not at the top, because it imports this package
            policy: ActingPolicy = registry.as_factory(robots, shown(robots))(self.scenario, num_worlds, device)
            rule = f"must be driven by a policy for {num_worlds} worlds"
            require(policy.num_worlds == num_worlds, "robots", rule, policy.num_worlds)
            self.robot_policy = policy
        self._draws: Draws | None = None
        self._views: dict[tuple[int, str, str], Rows] = {}
        self._statuses: list[np.ndarray] = []
        self._seeds = np.full(self.num_worlds, _FROM_SYSTEM, dtype=np.int64)
        self.seed(seed)

    @property
    def scenario(self) -> Scenario:
        """Scenario of the first group."""
        return self.simulations[0].scenario

    @property
    def simulation(self) -> Simulation:
        """Simulation of the first group."""
        return self.simulations[0]

    def worlds_of(self, group: int) -> slice:
        """Return the slice of the worlds of a group."""
        return slice(group * self.group_size, (group + 1) * self.group_size)

    def of_group(self, rows: Any, group: int) -> Any:
        """Return the part of rows (W, N, ...) of robots that are in the worlds of a group, without padding."""
        return rows[self.worlds_of(group), : self.simulations[group].num_robots]

    def seed(self, seed: Any, worlds: Any = None) -> None:
        """Set the seeds of the next episodes of some worlds; None leaves them as they are.

        Args:
            seed: A whole number of at least 0, where world k has seed + k, or one for each of these worlds. With a
                space, a number from which the sequence of its scenarios follows.
            worlds: (W,) mask or indices of the worlds, each once; all by default. A space has one seed for all.

        Raises:
            ValueError: there are no such worlds, or seed is no such number and no list with one for each of them.
        """
        if seed is None:
            return
        if self.space is not None:
            self._draws = None
            self._seeds[:] = fold_seed(seed)
            return
        chosen = chosen_worlds(worlds, self.num_worlds)
        if not np.ndim(seed):
            fold_seed(seed)  # raises an error if it is not a whole number
            seed = [int(seed) + int(k) for k in chosen]
        require(len(seed) == len(chosen), "seed", f"must be a number, or one for each of {len(chosen)} worlds", seed)
        self._seeds[chosen] = [fold_seed(number) for number in seed]

    def reset(self, worlds: Any = None) -> None:
        """Begin an episode in some worlds, with the seeds that `seed` has set, or those that follow from the latest.

        Args:
            worlds: (W,) mask or indices of the worlds, each once; all by default.

        Raises:
            ValueError: there are no such worlds.
        """
        chosen = world_mask(worlds, self.num_worlds)
        if self.space is not None:
            self._reset_groups(chosen)
            return
        simulation = self.simulations[0]
        unseeded = chosen & (self._seeds == _FROM_SYSTEM)
        self._seeds[unseeded] = drawn_seeds(int(unseeded.sum()))
        seeded = chosen & (self._seeds != _NEXT)
        if seeded.any():
            simulation.reset(seeded, self._seeds[seeded])
        if (rest := chosen & ~seeded).any():
            simulation.reset(rest)
        self._seeds[chosen] = _NEXT
        if self.robot_policy is not None:
            self.robot_policy.reset(chosen)

    def _reset_groups(self, chosen: np.ndarray) -> None:
        """Begin episodes in the worlds of a space; groups that are reset as a whole draw their next scenario.

        The first reset after a seed resets all worlds.
        """
        if self._draws is None:
            seed = int(drawn_seeds(1)[0]) if self._seeds[0] == _FROM_SYSTEM else int(self._seeds[0])
            self._draws = Draws(self.space, self.split, seed, self._resolved, self._fits)  # type: ignore[arg-type]
            chosen = np.ones_like(chosen)
        for group, simulation in enumerate(self.simulations):
            of_group = chosen[self.worlds_of(group)]
            if of_group.all():
                scenario, seed = self._draws.next(group)
                self._check(scenario, self._first)
                self.simulations[group] = self._simulation(scenario, seed)
                self._views, self._statuses, self._joined = {}, [], None
            elif of_group.any():
                simulation.reset(of_group)

    def step(self, actions: Mapping[str, Any]) -> None:
        """Advance every world whose episode is running by one control step.

        Args:
            actions: For each side, by its name `robot` or `rogue`, actions (W, N, action_size) that `Side.read_actions`
                returned, or a tensor on the device; those of slots without an agent have no effect.

        Raises:
            ResetNeeded: the worlds of a space have not been reset yet.
            ValueError: as of `Simulation.step`.
        """
        if self.space is not None and self._draws is None:
            raise ResetNeeded(NEEDS_RESET)
        for group, simulation in enumerate(self.simulations):
            policy = self.robot_policy
            of_robots = actions["robot"] if policy is None else policy.act(simulation.observation)
            if self.space is not None:
                of_robots = self.of_group(of_robots, group)
            simulation.take(of_robots, actions.get("rogue"))
        self._advance()

    def _advance(self) -> None:
        """Advance all groups: many of them in parallel, except on a GPU or with a user's Python functions."""
        works, device = [simulation.stages.work for simulation in self.simulations], self.simulation.device
        if self._joined is None and len(works) > 1 and self._threads == 1 and device.is_cpu and None not in works:
            tasks = [[launch for task in work.tasks for launch in task] for work in works if work is not None]
            self._joined = Work(tasks, device, self._cores)
        if self._joined is not None:
            self._joined()
        else:
            for simulation in self.simulations:
                simulation.advance()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without views and launches, which a copy makes for its own memory."""
        return self.__dict__ | {"_views": {}, "_statuses": [], "_joined": None}

    def views(self, group: int, side: Side, library: Any = np) -> Rows:
        """Return the rows of a side of a group, without padding; they are views, except NumPy arrays on a GPU."""
        key = group, side.agent, library.__name__
        rows = self._views.get(key) or side.rows(self.simulations[group], library)
        if library is not np or self.simulation.device.is_cpu:
            self._views[key] = rows
        return rows

    def rows(self, side: Side, library: Any = np) -> Rows:
        """Return the rows of a side; `library` is `numpy`, or `torch` for tensors on the device."""
        parts = [self.views(group, side, library) for group in range(len(self.simulations))]
        for k, part in enumerate(parts):
            if missing := side.slots - part.observation.shape[1]:
                parts[k] = Rows(*(padded(array, missing, library) for array in part))
                parts[k].terminated[:, -missing:] = True
        return parts[0] if len(parts) == 1 else Rows(*map(library.concatenate, zip(*parts, strict=True)))

    def live(self, side: Side) -> np.ndarray:
        """Return (W, N) bool: robots that are in their world, or rogues that act in the next step."""
        rows = self.rows(side)
        return rows.mask & ~rows.terminated

    @property
    def over(self) -> np.ndarray:
        """(W,) bool on the host: worlds whose episode has ended or, if only rogues act, that have no rogue left."""
        over = self._status() != RUNNING
        if self.robot_policy is not None:
            over = over | self.simulation.rogues.terminated.numpy().astype(bool).all(axis=1)
        return over

    @property
    def just_ended(self) -> np.ndarray:
        """(W,) bool on the host: worlds whose episode the latest step ended."""
        return self._status() == ENDED

    def _status(self) -> np.ndarray:
        """Return the status (W,) of the worlds on the host; on a CPU, from views of the simulations' memory."""
        if not (self._statuses and self.simulation.device.is_cpu):
            self._statuses = [simulation.clock.status.numpy() for simulation in self.simulations]
        return np.concatenate(self._statuses)

    def score(self, worlds: np.ndarray) -> list[dict[str, Any]]:
        """Return the score rows, so far, of the worlds of a mask (W,)."""
        groups = enumerate(self.simulations)
        return [row for group, simulation in groups for row in simulation.score(worlds[self.worlds_of(group)])]

    def state(self, library: Any = np) -> Any:
        """Return the true state (W, S) of each world; see `lissajous_env.envs.sides.state_names`.

        It has room for the largest team and the most target slots; the numbers of those that a scenario lacks are 0.
        """
        most = self._most_robots, self._most_targets
        parts = [state_rows(simulation, library, *most) for simulation in self.simulations]
        return parts[0] if len(parts) == 1 else library.concatenate(parts)

    def _simulation(self, scenario: Scenario, seed: int = 0) -> Simulation:
        return Simulation(scenario, self.group_size, device=self._device, seed=seed, threads=self._threads)

    def _resolved(self, scenario: Scenario) -> Scenario:
        """Return a scenario with `max_cycles` as its number of steps, and with all derived fields."""
        return named.with_cycles(scenario, self._max_cycles).resolve()

    def _fits(self, scenario: Scenario) -> bool:
        return scenario.num_robots <= self._most_robots and scenario.target_capacity <= self._most_targets

    def _check(self, scenario: Scenario, first: Scenario) -> None:
        """Raise ValueError for a scenario of a space whose rows or actions differ from those of the first one."""
        if scenario.targets.rogues == AGENTS:
            rule = "must be None or a scripted rogue in an environment of a space"
            raise ValueError(f"targets.rogues {rule}, got {AGENTS} in {scenario.name}")
        if (layout(scenario).names, scenario.action_names) != (layout(first).names, first.action_names):
            rule = "must have rows and actions of one size"
            raise ValueError(f"scenarios of a space {rule}, got others in {first.name} and {scenario.name}")
