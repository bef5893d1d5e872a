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
from gymnasium.spaces import Box

from baselines.policies.base import Policy
from lissajous_env import Scenario
from lissajous_env.envs.sides import Side
from lissajous_env.wording import require


class ModelPolicy(Policy):
    """Policy whose actions are those of `model.predict`, for each robot's row or for the team's rows at once.

    A model trained on rows, such as those of `RobotVecEnv`, maps (inputs,) to (action_size,) or to a row of the action
    table. A model trained on the team, such as on `lissajous_env.LissajousEnv`, maps (N, inputs) to (N, action_size) or
    to N rows of the table. The state of a recurrent model is preserved from step to step.

    Args:
        model: Model such as PPO, or any object with `predict`, `observation_space` and `action_space`.
        scenario: Scenario to play.
        num_worlds: W.
        device: Warp device; the model stays on its device.
        deterministic: Use the most likely action instead of a random one.
        normalizer: `VecNormalize` of the training, if there was one; its statistics are not changed.

    Raises:
        ValueError: not a model, or its spaces do not fit the scenario.
    """

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
            require(hasattr(model, part), "model", f"must be a model of Stable-Baselines3, with {part}", model)
        self.name, self.kind = type(model).__name__, self.scenario.robot.kind
        self.model, self.deterministic, self.normalizer = model, deterministic, normalizer
        side, discrete = (Side("robot", self.scenario, self.num_robots, indexed) for indexed in (False, True))
        rows = model.observation_space.shape
        of_team = rows == side.team_spaces()[0].shape
        fits = isinstance(model.observation_space, Box) and (of_team or rows == side.spaces()[0].shape)
        shapes = f"{side.spaces()[0].shape}, a robot's row, or {side.team_spaces()[0].shape}, the team's"
        rule = f"must be a Box of shape {shapes}, to play {self.scenario.name}"
        require(fits, f"observation_space of {self.name}", rule, rows or model.observation_space)
        spaces = [(either.team_spaces() if of_team else either.spaces())[1] for either in (side, discrete)]
        rule = f"must be {spaces[0]} or {spaces[1]} to play {self.scenario.name}"
        require(model.action_space in spaces, f"action_space of {self.name}", rule, model.action_space)
        self._table = discrete.table if model.action_space == spaces[1] else None
        self._state: Any = None
        self._begins = np.ones((self.num_worlds, 1 if of_team else self.num_robots), dtype=bool)

    def forget(self, mask: np.ndarray) -> None:
        """Reset the state of the masked worlds."""
        self._begins[mask] = True

    def decide(self, observation: np.ndarray) -> np.ndarray:
        """Return the actions."""
        rows = observation.reshape(-1, *self.model.observation_space.shape)
        if self.normalizer is not None:
            rows = self.normalizer.normalize_obs(rows)
        outputs, self._state = self.model.predict(
            rows, state=self._state, episode_start=self._begins.reshape(-1), deterministic=self.deterministic
        )
        self._begins[:] = False
        return np.reshape(outputs if self._table is None else self._table[outputs], self.action.shape)
