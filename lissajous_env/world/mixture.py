"""A batch of worlds of many scenarios, drawn from a space: groups of worlds, each a `Simulation` of its own."""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from lissajous_env.device.devices import cores
from lissajous_env.device.work import SideBySide, Work
from lissajous_env.parameters.draws import Draws
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.space import ScenarioSpace
from lissajous_env.settings.checks import whole_number
from lissajous_env.world.selection import chosen_worlds, world_mask
from lissajous_env.world.simulation import Simulation


class Mixture:
    """A batch of worlds of many scenarios, with arrays padded to the largest team.

    The W worlds are groups of `group_size` worlds that share a scenario; group g has the worlds g group_size to
    (g + 1) group_size - 1. When all worlds of a group are reset together, the group draws its next scenario, with the
    same number of robots, so that rows stay where they are. Scenarios, and the episodes in them, depend on the seed and
    the number of the group alone.

    Attributes (NumPy; N is the largest number of robots):
        groups: The simulations, one for each group.
        mask: (W, N) bool, True where a world has a robot.
        observation: (W, N, D) float32, 0 where there is no robot.
        reward: (W, N) float32, 0 where there is no robot.
        terminated: (W, N) bool, True where there is no robot.
        truncated: (W, N) bool, True where the time is over, and where there is no robot.

    Args:
        space: A `ScenarioSpace`, or the name or file of one.
        num_groups: Number of groups.
        group_size: Number of worlds in a group.
        split: Split or shift from which scenarios are drawn.
        seed: Whole number from 0 to 2^31 - 1, from which scenarios and seeds of episodes follow.
        device: Warp device.
        threads: CPU threads; all cores by default.

    Raises:
        ValueError: an argument is out of its range, or scenarios of the space have observations or actions of
            different sizes.
    """

    def __init__(
        self,
        space: str | os.PathLike | ScenarioSpace,
        num_groups: int = 8,
        group_size: int = 8,
        split: str = "train",
        seed: int = 0,
        device: Any = "cpu",
        threads: int | None = None,
    ):
        self._draws = Draws(space, split, seed)
        self.num_groups = whole_number("num_groups", num_groups)
        self.group_size = whole_number("group_size", group_size)
        self._device, self._together = device, Together(self.num_groups, threads)
        self.groups = [self._simulation(group) for group in range(self.num_groups)]
        n = max(each.num_robots for each in self.groups)
        rows = self.num_worlds, n
        self.mask = np.zeros(rows, dtype=bool)
        for group, each in enumerate(self.groups):
            self.mask[self._worlds(group), : each.num_robots] = True
        self.observation = np.zeros((*rows, self.groups[0].layout.size), dtype=np.float32)
        self.reward = np.zeros(rows, dtype=np.float32)
        self.terminated, self.truncated = ~self.mask, ~self.mask
        self._collect(range(self.num_groups))

    @property
    def num_worlds(self) -> int:
        """W."""
        return self.num_groups * self.group_size

    @property
    def scenarios(self) -> list[Scenario]:
        """Scenarios of the groups."""
        return [each.scenario for each in self.groups]

    @property
    def action_shape(self) -> tuple[int, int, int]:
        """(W, N, A) shape of the actions of `step`."""
        return (*self.mask.shape, self.groups[0].scenario.action_size)

    @property
    def over(self) -> np.ndarray:
        """(W,) bool: worlds whose episode has ended."""
        return np.concatenate([each.over for each in self.groups])

    def reset(self, worlds: Any = None) -> np.ndarray:
        """Begin a new episode in some worlds, in a new scenario where these are all worlds of a group.

        Args:
            worlds: (W,) mask or indices of the worlds, each once; all by default.

        Returns:
            `observation`.
        """
        chosen = world_mask(chosen_worlds(worlds, self.num_worlds), self.num_worlds)
        changed = []
        for group, each in enumerate(self.groups):
            of = chosen[self._worlds(group)]
            if of.all():
                self.groups[group] = self._simulation(group)
            elif of.any():
                each.reset(of)
            changed += [group] if of.any() else []
        self._collect(changed)
        return self.observation

    def step(self, action: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Advance every world whose episode is running by one control step.

        Args:
            action: `action_shape`, numbers in [-1, 1]; those of places without a robot have no effect.

        Returns:
            observation, reward, terminated, truncated: the arrays of these names, which are overwritten by each step.

        Raises:
            ValueError: the action has another shape, or does not contain real numbers.
        """
        given = np.asarray(action)
        if given.shape != self.action_shape or given.dtype.kind not in "fiu":
            got = f"{given.shape} of {given.dtype}"
            raise ValueError(f"action must be numbers of shape {self.action_shape}, got {got}")
        for group, each in enumerate(self.groups):
            each.take(np.ascontiguousarray(given[self._worlds(group), : each.num_robots], dtype=np.float32))
        self._together.advance(self.groups)
        self._collect(range(self.num_groups))
        return self.observation, self.reward, self.terminated, self.truncated

    def score(self, worlds: Any = None) -> list[dict[str, Any]]:
        """Return the score row of the latest episode of some worlds so far, with the name of the scenario."""
        rows = []
        for world in chosen_worlds(worlds, self.num_worlds):
            group, place = divmod(int(world), self.group_size)
            (row,) = self.groups[group].score([place])
            rows.append({"scenario": self.groups[group].scenario.name} | row)
        return rows

    def _worlds(self, group: int) -> slice:
        return slice(group * self.group_size, (group + 1) * self.group_size)

    def _simulation(self, group: int) -> Simulation:
        """Return worlds of a group's next scenario."""
        made, seed = self._draws.next(group)
        return Simulation(made, self.group_size, self._device, seed, self._together.threads)

    def _collect(self, groups: Any) -> None:
        """Copy the arrays of groups to those of the batch."""
        for group in groups:
            each, rows = self.groups[group], self._worlds(group)
            sizes = each.layout.size, each.scenario.action_size
            if sizes != (self.observation.shape[2], self.groups[0].scenario.action_size):
                names = f"{self.groups[0].scenario.name} and {each.scenario.name}"
                raise ValueError(f"scenarios of a mixture must have rows of one size, got others in {names}")
            for name in ("observation", "reward", "terminated", "truncated"):
                getattr(self, name)[rows, : each.num_robots] = getattr(each, name).numpy()


class Together:
    """Control steps of a fixed number of simulations, in parallel on CPU threads.

    If there are at least as many simulations as threads, one thread steps each of them. Otherwise, on a GPU, and with
    functions of the user's own, the simulations are stepped one after another, and the threads share each step.

    Args:
        count: Number of simulations.
        threads: CPU threads; all cores by default.

    Attributes:
        threads: Number of CPU threads with which each simulation must be created.

    Raises:
        ValueError: the number of threads is below 1.
    """

    def __init__(self, count: int, threads: int | None = None):
        self._all = cores() if threads is None else whole_number("threads", threads)
        self.threads = 1 if count >= self._all else self._all
        self._works: list[Work | None] = []
        self._joined: SideBySide | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the joined work, which contains addresses; it is made anew by the next step."""
        return self.__dict__ | {"_works": [], "_joined": None}

    def advance(self, simulations: Sequence[Simulation]) -> None:
        """Advance all simulations by one control step, with the actions that were stored by `take`."""
        works = [each.stages.work for each in simulations]
        if works != self._works:
            self._works, known = works, [work for work in works if work is not None]
            self._joined = SideBySide(known, self._all) if self.threads == 1 and len(known) == len(works) else None
        if self._joined is not None:
            self._joined()
        else:
            for each in simulations:
                each.advance()
