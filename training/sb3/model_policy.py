"""A model of Stable-Baselines3 as a policy that can be evaluated and benchmarked.

    from stable_baselines3 import PPO

    model = PPO.load("mine.zip")
    policy = training.sb3.ModelPolicy(model, "experiment", num_worlds=16)
    rows = lissajous_env.evaluate(policy, "experiment", seeds=range(16))

For the command line, `lissajous evaluate experiment my_module:my_policy` where `my_module.py` contains

    def my_policy(scenario, num_worlds, device):
        return training.sb3.ModelPolicy(PPO.load("mine.zip"), scenario, num_worlds, device)

`load` of Stable-Baselines3 uses pickle, which can run any code, so load only files that you trust.
"""

from typing import Any

import numpy as np
import warp as wp
from gymnasium.spaces import Box, Discrete, MultiDiscrete

from baselines.policies.base import Policy
from lissajous_env import Scenario
from lissajous_env.envs.sides import action_table
from lissajous_env.wording import shown
from lissajous_env.world.observation import layout


class ModelPolicy(Policy):
    """Policy whose actions are those of `model.predict`, for each robot's row or for the team's rows at once.

    A model trained on rows, such as those of `RobotVecEnv`, maps (inputs,) to (action_size,) or to a row of the action
    table. A model trained on the team, such as on `lissajous_env.LissajousEnv`, maps (N, inputs) to (N, action_size),
    flat or not, or to N rows of the table. A model trained with `VecFrameStack` receives its latest rows, as many as it
    was trained on. The state of a recurrent model is preserved from step to step.

    Args:
        model: Model such as PPO, or any object with `predict`, `observation_space` and `action_space`.
        scenario: Scenario to play.
        num_worlds: W.
        device: Warp device; the model stays on its device.
        deterministic: Use the most likely action instead of a random one.
        normalizer: `VecNormalize` of the training, if there was one, inside or outside of `VecFrameStack`; its
            statistics are not changed.

    Raises:
        ValueError: not a model, or its spaces do not fit the scenario.
    """

    arrays = "warp"

    def __init__(
        self,
        model: Any,
        scenario: str | Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        *,
        deterministic: bool = True,
        normalizer: Any = None,
    ):
        super().__init__(scenario, num_worlds, device)
        for part in ("predict", "observation_space", "action_space"):
            if not hasattr(model, part):
                raise ValueError(f"model must be a model of Stable-Baselines3, with {part}, got {shown(model)}")
        self.name, self.kind = type(model).__name__, self.scenario.robot.kind
        self.model, self.deterministic, self.normalizer = model, deterministic, normalizer
        self._row_shape, self._axis, of_team = self._read_observation_space(model)
        self._table = self._read_action_space(model.action_space, of_team)
        self._state: Any = None
        self._begins = np.ones((self.num_worlds, 1 if of_team else self.num_robots), dtype=bool)
        self._frames = np.zeros((self._begins.size, *model.observation_space.shape), dtype=np.float32)

    def forget(self, mask: np.ndarray) -> None:
        """Reset the state of the masked worlds."""
        self._begins[mask] = True

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        rows = self._normalized(observation.numpy().reshape(-1, *self._row_shape))
        if rows.shape != self._frames.shape:
            rows = self._normalized(self._stacked(rows))
        outputs, self._state = self.model.predict(
            rows, state=self._state, episode_start=self._begins.reshape(-1), deterministic=self.deterministic
        )
        self._begins[:] = False
        chosen = outputs if self._table is None else self._table[outputs]
        self.action.assign(np.asarray(chosen, dtype=np.float32).reshape(self.action.shape))

    def _normalized(self, rows: np.ndarray) -> np.ndarray:
        """Return rows of the shape that `VecNormalize` was trained on normalized, others as they are."""
        if self.normalizer is None or self.normalizer.observation_space.shape != rows.shape[1:]:
            return rows
        return self.normalizer.normalize_obs(rows)

    def _stacked(self, rows: np.ndarray) -> np.ndarray:
        """Return the latest rows of the episodes as `VecFrameStack` does: the newest last, zeros before the first."""
        newest = np.moveaxis(rows, self._axis, -1)
        frames, size = np.moveaxis(self._frames, self._axis, -1), newest.shape[-1]
        frames[..., :-size] = frames[..., size:].copy()
        frames[self._begins.reshape(-1)] = 0.0
        frames[..., -size:] = newest
        return self._frames.copy()

    def _read_observation_space(self, model: Any) -> tuple[tuple[int, ...], int, bool]:
        """Return the shape of the model's rows, the axis along which they are stacked, and whether they are a team's.

        Several rows of a robot can be as long as one of a flat team; the size of the actions decides between them.
        """
        n, inputs = self.num_robots, layout(self.scenario).size
        size, space = self.scenario.action_size, model.action_space
        alone, teams = (inputs,), ((n, inputs), (n * inputs,))
        acts_for_all = isinstance(space, MultiDiscrete) or getattr(space, "shape", None) in ((n, size), (n * size,))
        shape = model.observation_space.shape if isinstance(model.observation_space, Box) else ()
        for row in (*teams, alone) if acts_for_all and n > 1 else (alone, *teams):
            for axis in range(-1, -1 - len(row), -1):
                others = list(range(len(row)))
                del others[axis]
                is_multiple = len(shape) == len(row) and shape[axis] >= row[axis] and shape[axis] % row[axis] == 0
                if is_multiple and all(shape[k] == row[k] for k in others):
                    return row, axis, row != alone
        raise ValueError(
            f"observation_space of {self.name} must be a Box of shape {alone}, a robot's row, or {teams[0]} or "
            f"{teams[1]}, the team's, or of several of them stacked, to play {self.scenario.name}, got "
            f"{shown(model.observation_space)}"
        )

    def _read_action_space(self, space: Any, of_team: bool) -> np.ndarray | None:
        """Return the action table that the model chooses from, or None if it returns actions."""
        n, size, table = self.num_robots, self.scenario.action_size, action_table(self.scenario)
        shapes = ((n, size), (n * size,)) if of_team else ((size,),)
        if isinstance(space, Box) and space.shape in shapes and (space.low == -1).all() and (space.high == 1).all():
            return None
        discrete = MultiDiscrete([len(table)] * n) if of_team else Discrete(len(table))
        if space == discrete:
            return table
        boxes = " or ".join(str(shape) for shape in shapes)
        raise ValueError(
            f"action_space of {self.name} must be a Box from -1 to 1 of shape {boxes}, or {discrete}, to play "
            f"{self.scenario.name}, got {shown(space)}"
        )
