"""Worlds of many scenarios, drawn from a space, as one `VecEnv` of Stable-Baselines3: a row for each robot."""

import os
import warnings
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from lissajous_env import Scenario, ScenarioSpace
from lissajous_env.envs.actions import on_host
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.parameters.draws import Draws
from lissajous_env.settings.checks import whole_number
from lissajous_env.world.together import Together
from training.learned.card import Card
from training.learned.checkpoint import prefixed, within
from training.sb3.vec_env import GOLDEN, RECENT, RobotVecEnv, RowsVecEnv, Stepped


class MixedVecEnv(RowsVecEnv):
    """Groups of worlds, each a `RobotVecEnv` with a scenario of its own, as one `VecEnv` with shared parameters.

    The rows of group g follow those of group g - 1. When all episodes of a group have ended in the same step, it
    continues with its next scenario, which has the same number of robots. Rows are not padded.

    Args:
        space: A `ScenarioSpace`, or the name or file of one.
        num_groups: Number of groups.
        group_size: Number of worlds in a group.
        split: Split or shift from which scenarios are drawn.
        seed: Whole number from 0 to 2^31 - 1, from which scenarios and seeds of episodes follow.
        card: Entries of the observation that a row contains, and the base, as for `RobotVecEnv`; by default the whole
            observation of the first scenario.
        change: Function that returns a drawn scenario with fields changed.
        staggered: Let the first episodes of the groups end at different times, so that the rows of a step are from all
            phases of an episode instead of the same one. Worlds of a group always end together.
        **settings: Further arguments of `RobotVecEnv`, such as `device`, `threads` and `central`.

    Raises:
        ValueError: an argument is out of its range, or the observation of a scenario lacks an entry of the rows.
    """

    def __init__(
        self,
        space: str | os.PathLike | ScenarioSpace,
        num_groups: int = 8,
        group_size: int = 16,
        split: str = "train",
        seed: int = 0,
        card: Card | None = None,
        change: Callable[[Scenario], Scenario] | None = None,
        staggered: bool = False,
        **settings: Any,
    ):
        for name in ("short", "short_time", "critic_places", "render_mode"):
            if name in settings:
                raise ValueError(
                    f"{name} must be omitted, because each group has its own scenario, got {settings[name]!r}"
                )
        self._draws = Draws(space, split, seed, change)
        self._settings = settings
        self.group_size = whole_number("group_size", group_size)
        self.scores: deque[dict[str, Any]] = deque(maxlen=RECENT)
        self.render_mode = None
        first = [self._draws.next(group) for group in range(whole_number("num_groups", num_groups))]
        self._settings["card"] = card or Card.of(first[0][0])
        self._together = Together(num_groups, settings.get("threads"))
        self._settings["threads"] = self._together.threads
        if settings.get("central"):
            self._settings["critic_places"] = max(made.num_robots for made, _ in first)
        self.groups = [self._group(made, seed) for made, seed in first]
        if staggered:
            for group, each in enumerate(self.groups):
                each.end_first_after(group * GOLDEN % 1.0 or 1.0)
        ends = np.cumsum([each.num_envs for each in self.groups])
        self._rows = [slice(end - each.num_envs, end) for end, each in zip(ends, self.groups, strict=True)]
        one = self.groups[0]
        super().__init__(int(ends[-1]), one.observation_space, one.action_space)

    @property
    def scenarios(self) -> list[Scenario]:
        """Scenarios of the groups."""
        return [each.scenario for each in self.groups]

    def reset(self) -> np.ndarray:
        """Begin an episode in every world; return the rows (R, inputs). `seed` does not change the scenarios."""
        for each, rows in zip(self.groups, self._rows, strict=True):
            if self._seeds[0] is not None:
                each.seed(self._seeds[rows.start])
        self._reset_seeds()
        self._reset_options()
        return np.concatenate([each.reset() for each in self.groups])

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions (R, action_size) of the next step.

        Raises:
            ValueError: actions have another shape.
        """
        shape = (self.num_envs, *self.action_space.shape)  # type: ignore[misc]
        actions = np.asarray(on_host(actions))
        if actions.shape != shape:
            raise ValueError(f"actions must be numbers of shape {shape}, got {actions.shape}")
        self._actions = actions

    def step_wait(self) -> Stepped:
        """Take the step with the stored actions; groups whose episodes have all ended draw their next scenario."""
        for group, rows in zip(self.groups, self._rows, strict=True):
            group.step_async(self._actions[rows])
            group.take_actions()
        self._together.advance([group.simulation for group in self.groups])
        parts = [group.finish_step() for group in self.groups]
        for k, group in enumerate(self.groups):
            self.scores.extend({"scenario": group.scenario.name} | score for score in group.scores)
            group.scores.clear()
            if group.all_over:
                self.groups[k] = self._group(*self._draws.next(k))
                parts[k] = self.groups[k].reset(), *parts[k][1:]
        rows, rewards, dones, infos = zip(*parts, strict=True)
        return np.concatenate(rows), np.concatenate(rewards), np.concatenate(dones), [i for part in infos for i in part]

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy everything that changes during steps, by name."""
        groups = range(len(self.groups))
        state = {"draws": np.array([self._draws.counts[group] for group in groups])}
        for group in groups:
            state |= prefixed(f"group_{group}", self.groups[group].save_state())
        return state

    def load_state(self, saved: dict[str, np.ndarray]) -> None:
        """Resume from what `save_state` returned for the same arguments; other names are ignored.

        Raises:
            ValueError: the number of groups differs.
        """
        if len(saved["draws"]) != len(self.groups):
            raise ValueError(f"state must be that of {len(self.groups)} groups, got {len(saved['draws'])}")
        for group, count in enumerate(saved["draws"].tolist()):
            if count != self._draws.counts[group]:
                self._draws.counts[group] = count
                self.groups[group] = self._group(*self._draws.latest(group))
            self.groups[group].load_state(within(f"group_{group}", saved))

    def _group(self, made: Scenario, seed: int) -> RobotVecEnv:
        # Nobody wrote a scenario that is drawn: a warning about its assumptions would help nobody.
        with warnings.catch_warnings(action="ignore", category=AssumptionWarning):
            return RobotVecEnv(made, self.group_size, seed=seed, **self._settings)
