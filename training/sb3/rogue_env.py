"""The batch of worlds as a `VecEnv` of Stable-Baselines3 for rogues: one row for each target slot of each world."""

from collections import deque
from typing import Any

import gymnasium
import numpy as np

from lissajous_env import Scenario, Simulation
from lissajous_env.envs.actions import rogue_action_space, rogue_table
from lissajous_env.envs.rogue_env import as_driver
from lissajous_env.world.rogues.rows import rogue_layout
from lissajous_env.world.seeding import drawn_seeds
from training.sb3.batch_env import BatchVecEnv, Step

_RECENT = 256
"""Number of latest episodes whose scores are stored."""


class RogueVecEnv(BatchVecEnv):
    """`Simulation` as a `VecEnv` with shared parameters: row k T + t is the rogue in target slot t of world k.

    A policy drives the robots. The episode of a row ends when its rogue is detected, or at the time limit, with
    `TimeLimit.truncated`; the info then contains the final observation as `terminal_observation`, and `episode` with
    return `r` [s] and length `l` [steps], as of `Monitor`. A row without a live rogue is zero, with reward 0 and
    actions without effect. A world whose rogues are all detected, or whose time is over, is reset in the same step.

    Args:
        scenario: Scenario, or its name; `rogues` is `agents`.
        num_worlds: W; there are W T rows.
        robots: Policy that drives the robots: a name, a policy for W worlds, or a function of the observation.
        device: Warp device.
        seed: Seed of world 0; world k has seed + k, and draws its next seeds from it. Without a seed here or by
            `seed`, the first reset draws seeds from the operating system.
        threads: CPU threads; all cores by default.
        normal: Mean and standard deviation (D,) of each entry, if rows are to be normalized.
        discrete_actions: True for actions that are indices of `lissajous_env.envs.actions.rogue_table`: rest, or one
            of eight directions at full speed.
        **overrides: Fields of the scenario, as in `lissajous_env.scenario`.

    Raises:
        ValueError: an invalid setting, or rogues that are no agents.
    """

    def __init__(
        self,
        scenario: str | Scenario,
        num_worlds: int = 1,
        robots: Any = "kuramoto-mpcc",
        device: Any = "cpu",
        seed: int | None = None,
        threads: int | None = None,
        normal: tuple[np.ndarray, np.ndarray] | None = None,
        discrete_actions: bool = False,
        **overrides: Any,
    ):
        settings = {"rogues": "agents"} | overrides
        self.simulation = Simulation(scenario, num_worlds, device=device, seed=seed or 0, threads=threads, **settings)
        self.scenario = self.simulation.scenario
        if self.scenario.targets.rogues != "agents":
            raise ValueError(f"targets.rogues must be agents to be trained, got {self.scenario.targets.rogues}")
        self._driver = as_driver(robots, self.scenario, num_worlds, device)
        self._seeded, self.normal = seed is not None, normal
        self._table = rogue_table() if discrete_actions else None
        self.live = np.zeros(num_worlds * self.scenario.target_capacity, dtype=bool)
        self.scores: deque[dict[str, Any]] = deque(maxlen=_RECENT)
        self.render_mode = None
        self._slots, layout = self.scenario.target_capacity, rogue_layout(self.scenario)
        rows = num_worlds * self._slots
        self._returns, self._lengths = np.zeros(rows), np.zeros(rows, dtype=np.int64)
        super().__init__(rows, gymnasium.spaces.Box(layout.low, layout.high), rogue_action_space(discrete_actions))

    def reset(self) -> np.ndarray:
        """Begin an episode in every world; return the rows (W T, D)."""
        seeds = None
        if self._seeds[0] is not None:
            seeds = np.array(self._seeds[:: self._slots], dtype=np.int64) % 2**31
        elif not self._seeded:
            seeds = drawn_seeds(self.simulation.num_worlds)
        self._seeded = True
        self.simulation.reset(seeds=seeds)
        self._driver.reset()
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0.0, 0
        return self._rows()

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions of the next step: (W T, 2), or (W T,) indices of the table.

        Raises:
            ValueError: actions have another shape, are not finite, or are no indices.
        """
        given = np.asarray(actions)
        if self._table is not None:
            chosen = self._table[self._indices(given, len(self._table))]
        else:
            self._check(given, (self.num_envs, 2), "fiu", "numbers")
            finite = np.isfinite(given).all(axis=1)
            if not finite.all():
                row = int(np.flatnonzero(~finite)[0])
                raise ValueError(f"action of {self._who(row)} must be finite, got {given[row].tolist()}")
            chosen = np.clip(given, -1.0, 1.0).astype(np.float32)
        self._actions = chosen.reshape(-1, self._slots, 2)

    def _indices(self, given: np.ndarray, count: int) -> np.ndarray:
        self._check(given, (self.num_envs,), "iu", "whole numbers")
        wrong = (given < 0) | (given >= count)
        if wrong.any():
            row = int(np.flatnonzero(wrong)[0])
            raise ValueError(f"action of {self._who(row)} must be from 0 to {count - 1}, got {given[row]}")
        return given

    def _check(self, given: np.ndarray, shape: tuple[int, ...], kinds: str, words: str) -> None:
        if given.shape != shape or given.dtype.kind not in kinds:
            raise ValueError(f"actions must be {words} of shape {shape}, got {given.shape} of {given.dtype}")

    def _who(self, row: int) -> str:
        return f"rogue_{row % self._slots} in world {row // self._slots}"

    def _step(self) -> Step:
        simulation = self.simulation
        acted = simulation.rogue_present.numpy().astype(bool).reshape(-1)
        simulation.step(self._driver.act(simulation.observation), self._actions)
        rewards = simulation.rogue_reward.numpy().reshape(-1).copy()
        terminated = simulation.rogue_terminated.numpy().astype(bool)
        late = simulation.rogue_truncated.numpy().astype(bool).reshape(-1)
        over = simulation.over | terminated.all(axis=1)
        dones = acted & (terminated.reshape(-1) | late)
        self._returns += rewards
        self._lengths += acted
        last = self._rows()[dones]
        ended = np.flatnonzero(dones)
        episodes = {int(k): {"r": float(self._returns[k]), "l": int(self._lengths[k])} for k in ended}
        if over.any():
            self.scores.extend(simulation.score(over))
            simulation.reset(over)
            self._driver.reset(over)
        finished = dones | np.repeat(over, self._slots)
        self._returns[finished], self._lengths[finished] = 0.0, 0
        return Step(self._rows(), rewards, dones, dones & late, last, episodes)

    def seed(self, seed: int | None = None) -> Any:
        """Seed world k with seed + k T at the next reset: T rows share a world, which uses the seed of the first."""
        return super().seed(seed)

    def _rows(self) -> np.ndarray:
        """Return a copy of the rows, and store which of them act next."""
        self.live = self.simulation.rogue_present.numpy().astype(bool).reshape(-1)
        rows = self.simulation.rogue_observation.numpy().reshape(self.num_envs, -1)
        return rows.copy() if self.normal is None else (rows - self.normal[0]) / self.normal[1]
