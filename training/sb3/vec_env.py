"""Batches as `VecEnv`s of Stable-Baselines3: a row for each robot, or for each rogue, of each world."""

import time
from collections import deque
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from lissajous_env import Scenario
from lissajous_env.envs.batch import Batch

RECENT = 256
"""Number of latest episodes whose scores are stored."""


class BatchVecEnv(VecEnv):
    """`VecEnv` of a batch of one side of a scenario: row k N + i is agent i of world k.

    Several rows share a world, and rows have no attributes or methods of their own. A world whose episode is over is
    reset in the same step, and all of its rows are done. The row of an agent that ended earlier is done in that step,
    too; afterwards it is constant, with reward 0 and actions without effect. Infos contain `TimeLimit.truncated` and,
    where a row is done, `terminal_observation`; they report the episodes of agents as `Monitor` does.

    Args:
        scenario: Scenario, or its name.
        num_worlds: W; there are W N rows.
        roles: The side that learns, `robots` or `rogues`.
        robots: Policy that drives the robots if rogues learn: a name, a policy for W worlds, or a function.
        device: Warp device.
        seed: Seed of world 0; world k has seed + k, and draws its next seeds from it. Without a seed here or by
            `seed`, the first reset draws seeds from the operating system.
        threads: CPU threads; all cores by default.
        discrete_actions: True for actions that are rows of a table of `lissajous_env.envs.sides`, as for DQN.
        **overrides: Fields of the scenario, as in `lissajous_env.scenario`.

    Raises:
        ValueError: an invalid setting, or rogues that are no agents.
    """

    def __init__(
        self, scenario: str | Scenario, num_worlds: int, *, roles: str, robots: Any = None, device: Any = "cpu",
        seed: int | None = None, threads: int | None = None, discrete_actions: bool = False, **overrides: Any,
    ):  # fmt: skip
        settings: dict[str, Any] = {"discrete_actions": discrete_actions, "device": device, "threads": threads}
        batch = Batch(scenario, num_worlds, roles=roles, robots=robots, seed=seed, overrides=overrides, **settings)
        self.batch, self.simulation, self.scenario = batch, batch.simulation, batch.scenario
        (self._side,) = batch.sides
        self.scores: deque[dict[str, Any]] = deque(maxlen=RECENT)
        """Scores of the latest episodes."""
        self.render_mode = None
        self._began = time.monotonic()
        count = batch.num_worlds * self._side.slots
        self._returns, self._lengths = np.zeros(count), np.zeros(count, dtype=np.int64)
        super().__init__(count, *self._side.spaces())

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

    def reset(self) -> np.ndarray:
        """Begin an episode in every world, with the seed of its first row after `seed`; return the rows (W N, inputs).

        So `seed(s)` seeds world k of N rows with s + k N.
        """
        if self._seeds[0] is not None:
            self.batch.seed([seed % 2**31 for seed in self._seeds[:: self._side.slots]])  # type: ignore[operator]
        self._reset_seeds()
        self._reset_options()
        self.batch.reset()
        self._returns[:], self._lengths[:] = 0.0, 0
        return self._rows()

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions of the next step: (W N, action_size), clipped to [-1, 1], or (W N,) indices of the table.

        Raises:
            ValueError: actions have another shape, are not finite, or are no indices.
        """
        self._actions = self._side.read_actions(actions, (self.num_envs, *self.action_space.shape))  # type: ignore[misc]

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Take the step with the stored actions; begin new episodes in the worlds whose episode is over.

        Infos report the episodes that the step ended: return, length [steps], time since the start [s]. The episode of
        a removed robot is reported at its removal, and not again at the end of its world's episode.
        """
        acted = self.batch.live(self._side).reshape(-1)
        self.batch.step({self._side.agent: self._actions})
        rows, over = self.batch.rows(self._side), self.batch.over
        rewards, terminated = rows.reward.reshape(-1).copy(), rows.terminated.reshape(-1)
        dones = acted & terminated | np.repeat(over, self._side.slots)
        truncated = dones & acted & ~terminated
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": timed_out} for timed_out in truncated.tolist()]
        self._returns += rewards
        self._lengths += acted
        observations, at = rows.observation.reshape(self.num_envs, -1), round(time.monotonic() - self._began, 6)
        for k in np.flatnonzero(dones):
            infos[k]["terminal_observation"] = observations[k].copy()
            if acted[k]:
                infos[k]["episode"] = {"r": float(self._returns[k]), "l": int(self._lengths[k]), "t": at}
        self._returns[dones], self._lengths[dones] = 0.0, 0
        if over.any():
            self.scores.extend(self.batch.score(over))
            self.batch.reset(over)
        return self._rows(), rewards, dones, infos

    def _rows(self) -> np.ndarray:
        return self.batch.rows(self._side).observation.reshape(self.num_envs, -1).copy()


class RogueVecEnv(BatchVecEnv):
    """Rogues against robots of any policy: row k N + t is the rogue in target slot t of world k; see `BatchVecEnv`.

    The episode of a row ends when its rogue is detected, or at the time limit. A row without a live rogue is zero. A
    world whose rogues are all detected, or whose time is over, is reset in the same step. Returns are in seconds.
    """

    def __init__(self, scenario: str | Scenario, num_worlds: int = 1, robots: Any = "kuramoto-mpcc", **settings: Any):
        super().__init__(scenario, num_worlds, roles="rogues", robots=robots, **settings)


class RobotVecEnv(BatchVecEnv):
    """Robots with shared parameters: row k N + i is robot i of world k; see `BatchVecEnv`."""

    def __init__(self, scenario: str | Scenario, num_worlds: int = 1, **settings: Any):
        super().__init__(scenario, num_worlds, roles="robots", **settings)
