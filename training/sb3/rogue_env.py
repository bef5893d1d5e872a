"""The batch of worlds as a `VecEnv` of Stable-Baselines3 for rogues: one row for each target slot of each world."""

from typing import Any

import gymnasium
import numpy as np

from lissajous_env import Scenario, Simulation
from lissajous_env.envs.actions import rogue_action_space, rogue_table
from lissajous_env.envs.rogue_env import as_driver
from lissajous_env.world.rogues.rows import rogue_layout
from training.sb3.batch_env import Step, WorldsVecEnv


class RogueVecEnv(WorldsVecEnv):
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
        render_mode: None, or `rgb_array` for pictures of the worlds.
        **overrides: Fields of the scenario, as in `lissajous_env.scenario`.

    Raises:
        ValueError: an invalid setting, or rogues that are no agents.
    """

    agent = "rogue"

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
        render_mode: str | None = None,
        **overrides: Any,
    ):
        settings = {"rogues": "agents"} | overrides
        simulation = Simulation(scenario, num_worlds, device=device, seed=seed or 0, threads=threads, **settings)
        made = simulation.scenario
        if made.targets.rogues != "agents":
            raise ValueError(f"targets.rogues must be agents to be trained, got {made.targets.rogues}")
        self._driver, self.normal = as_driver(robots, made, num_worlds, device), normal
        slots, layout = made.target_capacity, rogue_layout(made)
        self.live = np.zeros(num_worlds * slots, dtype=bool)
        row, action = gymnasium.spaces.Box(layout.low, layout.high), rogue_action_space(discrete_actions)
        table = rogue_table() if discrete_actions else None
        super().__init__(simulation, seed is not None, slots, row, action, table, render_mode)

    def reset(self) -> np.ndarray:
        """Begin an episode in every world; return the rows (W T, D)."""
        self._reset_worlds()
        self._driver.reset()
        return self._rows()

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions of the next step: (W T, 2), or (W T,) indices of the table.

        Raises:
            ValueError: actions have another shape, are not finite, or are no indices.
        """
        self._actions = self._read(actions, 2)

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
        finished = dones | np.repeat(over, self._rows_each)
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
