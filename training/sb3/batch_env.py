"""Base of the `VecEnv`s over a batch of worlds, in which several rows share a world."""

from collections import deque
from typing import Any, NamedTuple, Protocol

import gymnasium
import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from lissajous_env import LissajousParallelEnv, Simulation
from lissajous_env.envs.actions import on_host
from lissajous_env.wording import shown
from lissajous_env.world.selection import drawn_seeds

RECENT = 256
"""Number of latest episodes whose scores are stored."""


class Step(NamedTuple):
    """Result of a step of R rows."""

    rows: np.ndarray
    """(R, inputs) next observations."""
    rewards: np.ndarray
    """(R,) rewards."""
    dones: np.ndarray
    """(R,) True where an episode ended."""
    truncated: np.ndarray
    """(R,) True where it ended because of its time limit."""
    last: np.ndarray
    """(D, inputs) final observations of the rows whose episode ended, in order."""
    episodes: dict[int, dict[str, float]]
    """Return `r`, length `l` [steps] and, for robots, time `t` since construction [s] of the ended episodes, by row.
    The episode of a removed robot ends with its removal, so that it has none at the end of its world's episode."""

    def infos(self) -> list[dict[str, Any]]:
        """Return an info for each row, in which ended episodes are reported as `Monitor` does."""
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": late} for late in self.truncated.tolist()]
        for k, last in zip(np.flatnonzero(self.dones), self.last, strict=True):
            infos[k]["terminal_observation"] = last
        for k, episode in self.episodes.items():
            infos[k]["episode"] = episode
        return infos


class RowsEnv(Protocol):
    """Environments that PPO learns in: rows without a dictionary each."""

    num_envs: int
    observation_space: gymnasium.spaces.Space
    action_space: gymnasium.spaces.Space
    live: np.ndarray | None

    def seed(self, seed: int | None = None) -> Any:
        """Seed the environments at the next reset."""

    def reset(self) -> Any:
        """Begin an episode in every environment; return the rows (R, inputs)."""

    def step_rows(self, actions: np.ndarray) -> Step:
        """Take a step of all rows."""
        ...


class BatchVecEnv(VecEnv):
    """`VecEnv` whose rows have no attributes or methods of their own."""

    live: np.ndarray | None = None
    """(R,) True for the rows that act in the next step; None if all do."""

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Take the step; return rows, rewards, dones and infos, which report ended episodes as `Monitor` does."""
        step = self._step()
        return step.rows, step.rewards, step.dones, step.infos()

    def step_rows(self, actions: np.ndarray) -> Step:
        """Take a step as `step` does, without a dictionary per row."""
        self.step_async(actions)
        return self._step()

    def _step(self) -> Step:
        """Take a step with the actions that `step_async` has stored."""
        raise NotImplementedError

    def close(self) -> None:
        """Do nothing: there is nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the batch, repeated for each requested row."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the whole batch; rows have no attributes of their own."""
        if indices is not None and len(list(self._get_indices(indices))) != self.num_envs:
            raise ValueError(f"{attr_name} must be set for all rows at once, got indices {indices!r}")
        setattr(self, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call a method of the batch once; return its result, repeated for each requested row."""
        result = getattr(self, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each row: rows are not wrapped."""
        return [False for _ in self._get_indices(indices)]


class WorldsVecEnv(BatchVecEnv):
    """`VecEnv` of a simulation with `rows` rows of each world.

    If it is not `seeded`, the first reset draws seeds from the operating system. With a `table`, actions are indices
    of its rows. `render_mode` is None or `rgb_array`.
    """

    agent: str
    """Kind of agent of a row, for messages."""

    def __init__(
        self,
        simulation: Simulation,
        seeded: bool,
        rows: int,
        observations: gymnasium.Space,
        actions: gymnasium.Space,
        table: np.ndarray | None = None,
        render_mode: str | None = None,
    ):
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode must be None or rgb_array, got {shown(render_mode)}")
        self.simulation, self.scenario, self._seeded, self._rows_each = simulation, simulation.scenario, seeded, rows
        self.scores: deque[dict[str, Any]] = deque(maxlen=RECENT)
        self.render_mode, self._table, self._gallery = render_mode, table, None
        count = simulation.num_worlds * rows
        self._returns, self._lengths = np.zeros(count), np.zeros(count, dtype=np.int64)
        super().__init__(count, observations, actions)
        self.metadata["render_fps"] = LissajousParallelEnv.metadata["render_fps"]

    def get_images(self) -> list[np.ndarray]:
        """Return a picture of each world, for `render` and `VecVideoRecorder`."""
        if self._gallery is None:
            from lissajous_env.render import Gallery

            self._gallery = Gallery(self.scenario, self.simulation.num_worlds)
        return self._gallery.draw(self.simulation)

    def _reset_worlds(self) -> None:
        """Begin an episode in every world, whose rows use the seed of the first of them."""
        seeds = None
        if self._seeds[0] is not None:
            seeds = np.array(self._seeds[:: self._rows_each], dtype=np.int64) % 2**31
        elif not self._seeded:
            seeds = drawn_seeds(self.simulation.num_worlds)
        self._seeded = True
        self.simulation.reset(seeds=seeds)
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0.0, 0

    def _read(self, actions: Any, size: int) -> np.ndarray:
        """Return actions (rows, size), or indices (rows,) of the table, as float32 in [-1, 1] by world.

        Raises:
            ValueError: another shape, a number that is not finite, or an index outside the table.
        """
        given = np.asarray(on_host(actions))
        if self._table is not None:
            self._check(given, (self.num_envs,), "iu", "whole numbers")
            wrong, last = (given < 0) | (given >= len(self._table)), len(self._table) - 1
            if wrong.any():
                row = int(np.flatnonzero(wrong)[0])
                raise ValueError(f"action of {self._name_of(row)} must be from 0 to {last}, got {given[row]}")
            return self._table[given].reshape(-1, self._rows_each, size)
        self._check(given, (self.num_envs, size), "fiu", "numbers")
        finite = np.isfinite(given).all(axis=1)
        if not finite.all():
            row = int(np.flatnonzero(~finite)[0])
            raise ValueError(f"action of {self._name_of(row)} must be finite, got {given[row].tolist()}")
        clipped = np.clip(given, -1.0, 1.0).astype(np.float32, copy=False)
        return clipped.reshape(-1, self._rows_each, size)

    def _check(self, given: np.ndarray, shape: tuple[int, ...], kinds: str, words: str) -> None:
        if given.shape != shape or given.dtype.kind not in kinds:
            raise ValueError(f"actions must be {words} of shape {shape}, got {given.shape} of {given.dtype}")

    def _name_of(self, row: int) -> str:
        return f"{self.agent}_{row % self._rows_each} in world {row // self._rows_each}"
