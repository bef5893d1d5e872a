"""The batch of worlds as a `VecEnv` of Stable-Baselines3: one row for each robot of each world."""

import time
from typing import Any

import gymnasium
import numpy as np

from lissajous_env import Scenario, Simulation
from lissajous_env.envs.actions import action_space, action_table
from training.learned.card import Card
from training.learned.named_arrays import prefixed, within
from training.learned.wiring import Wiring
from training.sb3.batch_env import Step, WorldsVecEnv
from training.sb3.critic_view import CriticView

GOLDEN = (5**0.5 - 1) / 2
"""Golden ratio, whose multiples are spread evenly modulo 1."""


class RobotVecEnv(WorldsVecEnv):
    """`Simulation` as a `VecEnv` with shared parameters: row k N + i is robot i of world k.

    A world whose robots are all done is reset in the same step. At a time limit, a robot's info contains the final
    observation as `terminal_observation`, and `TimeLimit.truncated`. A removed robot terminates, and its row is
    constant until its world is reset. `seed` seeds world k with seed + k N at the next reset: the N rows of a world use
    the seed of the first.

    Args:
        scenario: Scenario, or its name.
        num_worlds: W; there are W N rows.
        card: Entries of the observation that a row contains, and the base to which its action is added; by default
            the whole observation and no base.
        device: Warp device.
        seed: Seed of world 0; world k has seed + k, and draws its next seeds from it. Without a seed here or by
            `seed`, the first reset draws seeds from the operating system.
        threads: CPU threads; all cores by default.
        central: Append the `CriticView` of the world to each row, for a central critic.
        critic_places: Number of robots for which that view has room; as many as there are by default.
        short: Fraction of the worlds, the first ones, whose episodes end after `short_time`.
        short_time: Duration of these episodes [s].
        staggered: Let the first episodes end at different times, so that the rows of a step are from all phases of an
            episode instead of the same one.
        discrete_actions: True for actions that are indices of `lissajous_env.envs.actions.action_table`, as for DQN.
        render_mode: None, or `rgb_array` for pictures of the worlds, as for `VecVideoRecorder`.
        **overrides: Fields of the scenario, as in `lissajous_env.scenario`.
    """

    agent = "robot"

    def __init__(
        self,
        scenario: str | Scenario,
        num_worlds: int = 1,
        card: Card | None = None,
        device: Any = "cpu",
        seed: int | None = None,
        threads: int | None = None,
        central: bool = False,
        critic_places: int | None = None,
        short: float = 0.0,
        short_time: float = 3.0,
        staggered: bool = False,
        discrete_actions: bool = False,
        render_mode: str | None = None,
        **overrides: Any,
    ):
        simulation = Simulation(scenario, num_worlds, device=device, seed=seed or 0, threads=threads, **overrides)
        made = simulation.scenario
        self.card = card or Card.of(made)
        self._wiring = Wiring(self.card, made, num_worlds, device)
        self._view = CriticView(simulation, critic_places) if central else None
        steps = made.task.steps
        self._last_step = np.full(num_worlds, steps)
        self._last_step[: round(short * num_worlds)] = min(max(round(short_time / made.task.step), 1), steps)
        # Multiples of the golden ratio are spread evenly also over the first worlds only.
        spread = np.arange(num_worlds) * GOLDEN % 1.0 if staggered else np.ones(num_worlds)
        self._first_end = np.ceil(np.maximum(spread, 1 / steps) * self._last_step).astype(np.int64)
        self._end = self._first_end.copy()
        self._began = time.monotonic()
        self.all_over = False
        """True if the episodes of all worlds ended in the latest step."""
        more = np.full(0 if self._view is None else self._view.size, np.inf, dtype=np.float32)
        low, high = np.concatenate([self._wiring.low, -more]), np.concatenate([self._wiring.high, more])
        rows, actions = gymnasium.spaces.Box(low, high), action_space(made, discrete_actions)
        table = action_table(made) if discrete_actions else None
        super().__init__(simulation, seed is not None, made.num_robots, rows, actions, table, render_mode)

    def reset(self) -> np.ndarray:
        """Begin an episode in every world; return the rows (W N, inputs)."""
        self._reset_worlds()
        self._done = np.zeros(self.num_envs, dtype=bool)
        self._end = self._first_end.copy()
        self._wiring.reset()
        return self._rows(self._wiring.read(self.simulation.observation.numpy()))

    def end_first_after(self, share: float) -> None:
        """End the first episodes of all worlds after a share of their steps, above 0 and at most 1.

        To be called before the first `reset`.
        """
        self._first_end[:] = np.maximum(np.ceil(share * self._last_step), 1)

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy everything that changes during steps, by name."""
        own = {"end": self._end, "returns": self._returns, "lengths": self._lengths}
        return prefixed("world", self.simulation.save_state()) | self._wiring.save_state() | own

    def load_state(self, saved: dict[str, np.ndarray]) -> None:
        """Resume from what `save_state` returned."""
        self.simulation.load_state(within("world", saved))
        self._seeded = True
        self._done = self.simulation.terminated.numpy().astype(bool).reshape(-1)
        self._end = saved["end"].copy()
        self._returns, self._lengths = saved["returns"].copy(), saved["lengths"].copy()
        self._wiring.load_state(saved)

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions of the next step: (W N, action_size), clipped to [-1, 1], or (W N,) indices of the table.

        Raises:
            ValueError: actions have another shape, are not finite, or are no indices.
        """
        self._actions = self._read(actions, self.scenario.action_size)

    def _step(self) -> Step:
        self.take_actions()
        self.simulation.advance()
        return self.finish_step()

    def take_actions(self) -> None:
        """Pass the stored actions on to the simulation, whose `advance` makes the step."""
        self.simulation.take(self._wiring.actions(self._actions))

    def finish_step(self) -> Step:
        """Return the rows of the step that the simulation made, and begin new episodes where they are over."""
        simulation, wiring = self.simulation, self._wiring
        rewards = simulation.reward.numpy().reshape(-1).copy()
        terminated = simulation.terminated.numpy().astype(bool).reshape(-1)
        over = simulation.over | (simulation.clock.step.numpy() >= self._end)
        self.all_over = bool(over.all())
        ended = terminated | np.repeat(over, simulation.num_robots)
        dones = ended & ~self._done | np.repeat(over, simulation.num_robots)
        # The base's action is that of the previous step: a final observation is used for its value only.
        last = self._rows(wiring.rows(simulation.observation.numpy()), dones)
        episodes = self._finished(rewards, dones)
        if over.any():
            self.scores.extend(simulation.score(simulation.over))
            simulation.reset(over)
            wiring.reset(over)
            self._end[over] = self._last_step[over]
            ended = simulation.terminated.numpy().astype(bool).reshape(-1)
        self._done = ended
        rows = self._rows(wiring.read(simulation.observation.numpy()))
        return Step(rows, rewards, dones, dones & ~terminated, last, episodes)

    def _finished(self, rewards: np.ndarray, dones: np.ndarray) -> dict[int, dict[str, float]]:
        """Count a step, and return the episodes that ended with it."""
        self._returns += rewards
        self._lengths += 1
        at = round(time.monotonic() - self._began, 6)
        ended = np.flatnonzero(dones & ~self._done)
        found = {int(k): {"r": float(self._returns[k]), "l": int(self._lengths[k]), "t": at} for k in ended}
        self._returns[dones], self._lengths[dones] = 0.0, 0
        return found

    def _rows(self, rows: np.ndarray, chosen: np.ndarray | None = None) -> np.ndarray:
        """Return a copy (W N, inputs) of the rows (W, N, ...), or of the chosen ones (W N,), with the `CriticView`."""
        flat = rows.reshape(self.num_envs, -1)
        if chosen is None:
            return flat.copy() if self._view is None else np.concatenate([flat, self._view.rows()], axis=1)
        if self._view is None:
            return flat[chosen]
        if not chosen.any():
            return np.zeros((0, flat.shape[1] + self._view.size), np.float32)
        worlds = np.asarray(chosen.reshape(self.simulation.num_worlds, -1).any(axis=1))
        return np.concatenate([flat[chosen], self._view.rows(worlds)[chosen]], axis=1)
