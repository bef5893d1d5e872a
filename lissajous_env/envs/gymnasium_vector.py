"""The Gymnasium environment of a batch of worlds; a row is a team, or a robot with `agents_as_rows`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from lissajous_env.envs.batch import NEEDS_RESET, Batch
from lissajous_env.envs.one_world import Timed
from lissajous_env.envs.sides import Rows
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import whole_number
from lissajous_env.wording import require


class LissajousVectorEnv(Timed, VectorEnv):
    """A batch of W worlds as a Gymnasium `VectorEnv`.

    **A row is a team** by default. Observations are (W, N, D), actions (W, N, action_size) or, if discrete, indices
    (W, N) of the action table; the reward is the mean over the robots. A world is terminated when all of its robots
    are. Infos contain `robot_reward` (W, N).

    **A row is a robot** with `agents_as_rows`: row k N + i of the W N rows is robot i of world k, with the spaces of
    one robot. All rows of a world end together when its time is over. The row of a robot that is removed earlier is
    terminated in that step. Afterwards it does not move, has reward 0 and its actions have no effect, until its world
    ends, when it is reported as terminated again and restarts with its world.

    Infos also contain `invalid`, True if an action in the row's episode was not finite and replaced by zero, and
    `score`, the numbers, named by `score_names`, of the episodes that ended in this step: these rows are True in its
    mask `_score`, and the others are infinite. With SAME_STEP, `final_obs` and `final_info` follow
    Gymnasium: infos contain them in the steps in which rows are done, and the latter contains `score`, too.

    Args:
        scenario: Name of a scenario, or a `Scenario`.
        num_envs: Number of worlds W.
        max_cycles: Number of steps of an episode, instead of `task.duration`.
        max_episode_steps: Limit on these steps, which `gymnasium.make_vec` passes if a specification contains it.
        discrete_actions: True for actions that are indices of the table in `lissajous_env.envs.sides`.
        agents_as_rows: True for one row per robot.
        autoreset_mode: `NEXT_STEP` (the step after the end resets), `SAME_STEP` or `DISABLED`, or the enum.
        device: Warp device.
        threads: CPU threads; all cores by default.
        **overrides: Fields of the scenario, as in `lissajous_env.parameters.scenario`.

    Raises:
        UnknownSettingError: an unknown keyword (a `ValueError` and a `TypeError`).
        ValueError: an invalid setting.
    """

    def __init__(
        self,
        scenario: str | Scenario = "experiment",
        num_envs: int = 1,
        *,
        max_cycles: int | None = None,
        max_episode_steps: int | None = None,
        discrete_actions: bool = False,
        agents_as_rows: bool = False,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        device: Any = "cpu",
        threads: int | None = None,
        **overrides: Any,
    ):
        modes, name = AutoresetMode.__members__, str(getattr(autoreset_mode, "name", autoreset_mode))
        require(name in modes, "autoreset_mode", f"must be one of {', '.join(modes)}", autoreset_mode)
        self.autoreset_mode = modes[name]
        variant = named.with_cycles(named.scenario(scenario, **overrides), max_cycles)
        if max_episode_steps is not None and whole_number("max_episode_steps", max_episode_steps) < variant.task.steps:
            variant = named.with_cycles(variant, max_episode_steps)
        self._steps = variant.task.steps
        settings: dict[str, Any] = {"discrete_actions": discrete_actions, "device": device, "threads": threads}
        self.batch = Batch(variant, whole_number("num_envs", num_envs), roles="robots", **settings)
        (self._side,) = self.batch.sides
        self.simulation, self.scenario = self.batch.simulation, self.batch.scenario
        self._rows_per_world, self._agents_as_rows = self._side.slots if agents_as_rows else 1, agents_as_rows
        self.num_envs = num_envs * self._rows_per_world
        self.metadata = {"autoreset_mode": self.autoreset_mode}
        spaces = self._side.spaces() if agents_as_rows else self._side.team_spaces()
        self.single_observation_space, self.single_action_space = spaces
        self.observation_space, self.action_space = (batch_space(space, self.num_envs) for space in spaces)
        self._begun = np.zeros(num_envs, dtype=bool)

    def reset(
        self, *, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode in every world, or in those of `options["reset_mask"]`, bool (num_envs,).

        With a whole number, world k has the seed `seed` + k; a list contains a seed for each world. Without a seed,
        that of a world's first episode comes from the operating system, and each later one follows from the previous.

        Raises:
            ValueError: an invalid seed or mask, or a mask with only some of the rows of a world.
        """
        worlds = self._worlds_of(options)
        if isinstance(seeds := seed, (Sequence, np.ndarray)):
            fits = np.shape(seeds) == worlds.shape
            require(fits, "seed", f"must be a number, or one for each of {len(worlds)} worlds", seeds)
            seeds = [seeds[k] for k in np.flatnonzero(worlds)]
        self.batch.seed(seeds, worlds)
        self.batch.reset(worlds)
        if seed is not None:
            super().reset(seed=int(np.ravel(seed)[0]))  # checked above
        self._begun[worlds] = True
        no_reward = np.zeros((len(self._begun), self._side.slots), np.float32)
        return self._observed(), self._infos(no_reward, np.zeros_like(self._begun))

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Take a step in every world; `autoreset_mode` determines when worlds that ended are reset.

        Raises:
            ResetNeeded: a world has not been reset yet.
            ValueError: the actions have a wrong shape, or an index is outside the table.
        """
        if not self._begun.all():
            raise ResetNeeded(f"{NEEDS_RESET}, for every world")
        acted, was_over = self.batch.live(self._side), self.batch.over
        # An action that is not finite is replaced by zero, and reported in the infos.
        self.batch.step({"robot": self._side.read_actions(actions, self.action_space.shape, finite=False)})  # pyright: ignore
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and was_over.any():
            # A world that ended did not move in the step above; it returns its first observation.
            self.batch.reset(was_over)
        rows, ended = self.batch.rows(self._side), self.batch.over
        terminated, truncated = self._flags(rows, acted, ended)
        robot_reward = rows.reward.copy()
        reward = robot_reward.reshape(-1) if self._agents_as_rows else robot_reward.mean(axis=1)
        just_ended = ended & ~was_over
        infos = self._infos(robot_reward, just_ended)
        if self.autoreset_mode is AutoresetMode.SAME_STEP:
            self._reset_ended(just_ended, terminated | truncated, infos)
        return self._observed(), reward, terminated, truncated, infos

    def _worlds_of(self, options: Any) -> np.ndarray:
        """Return the mask (W,) of the worlds that the options of a reset select.

        Raises:
            ValueError: invalid options or an invalid mask.
        """
        require(options is None or isinstance(options, Mapping), "options", "must be a dict", options)
        mask = (options or {}).get("reset_mask")
        if mask is None:
            return np.ones_like(self._begun)
        fits = np.shape(mask) == (self.num_envs,) and np.asarray(mask).dtype == bool
        require(fits, "reset_mask", f"must be bool of shape ({self.num_envs},)", mask)
        of_worlds = np.asarray(mask).reshape(len(self._begun), self._rows_per_world)
        if (of_worlds != of_worlds[:, :1]).any():
            raise ValueError("reset_mask must contain all rows of a world or none, because worlds are reset as a whole")
        return of_worlds[:, 0]

    def _flags(self, rows: Rows, acted: np.ndarray, ended: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the flags `terminated` and `truncated` of the rows, for the robots (W, N) that acted."""
        if not self._agents_as_rows:
            terminated = rows.terminated.all(axis=1)
            return terminated, rows.truncated.any(axis=1) & ~terminated
        # A robot that was removed earlier is reported again when its world ends.
        terminated = rows.terminated & (acted | ended[:, None])
        return terminated.reshape(-1), (rows.truncated & ~rows.terminated).reshape(-1)

    def _infos(self, robot_reward: np.ndarray, just_ended: np.ndarray) -> dict[str, Any]:
        """Return the infos for rewards (W, N), with the scores of the worlds that have just ended."""
        every, repeats = np.ones(self.num_envs, dtype=bool), self._rows_per_world
        infos = {"invalid": np.repeat(self.simulation.invalid.numpy() != 0, repeats), "_invalid": every}
        if not self._agents_as_rows:
            infos |= {"robot_reward": robot_reward, "_robot_reward": every.copy()}
        score = np.repeat(self.simulation.score_numbers(just_ended), repeats, axis=0)
        return infos | {"score": score, "_score": np.repeat(just_ended, repeats)}

    def _reset_ended(self, just_ended: np.ndarray, done: np.ndarray, infos: dict[str, Any]) -> None:
        """Reset the worlds that have just ended, and store the final observations and infos of the done rows."""
        if not done.any():
            return
        last = self._observed()
        self.batch.reset(just_ended)
        final = np.full(self.num_envs, None, dtype=object)
        for row in np.flatnonzero(done):
            final[row] = last[row]
        infos["final_obs"], infos["_final_obs"] = final, done
        infos["final_info"] = {name: infos[name].copy() for name in ("score", "_score")}
        infos["_final_info"] = done

    def _observed(self) -> np.ndarray:
        return self.batch.rows(self._side).observation.reshape(self.observation_space.shape).copy()  # pyright: ignore
