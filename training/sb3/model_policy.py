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
from lissajous_env.envs.actions import action_table
from lissajous_env.wording import shown
from training.learned.card import Card
from training.learned.wiring import Wiring


class ModelPolicy(Policy):
    """Policy whose actions are those of `model.predict`, for each robot's row or for the team's rows at once.

    A model trained on rows, such as those of `RobotVecEnv`, maps (inputs,) to (action_size,) or to a row of the action
    table. A model trained on the team, such as on `lissajous_env.LissajousEnv`, maps (N, inputs) to (N, action_size),
    flat or not, or to N rows of the table. The state of a recurrent model is preserved from step to step.

    Args:
        model: Model such as PPO, or any object with `predict`, `observation_space` and `action_space`.
        scenario: Scenario to play.
        num_worlds: W.
        device: Warp device; the model stays on its device.
        deterministic: Use the most likely action instead of a random one.
        normalizer: `VecNormalize` of the training, if there was one; its statistics are not changed.
        card: Card of the `RobotVecEnv` of the training, if it had one.

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
        card: Card | None = None,
    ):
        super().__init__(scenario, num_worlds, device)
        for part in ("predict", "observation_space", "action_space"):
            if not hasattr(model, part):
                raise ValueError(f"model must be a model of Stable-Baselines3, with {part}, got {shown(model)}")
        self.name, self.kind = type(model).__name__, self.scenario.robot.kind
        self.model, self.deterministic, self.normalizer = model, deterministic, normalizer
        self._wiring = Wiring(card or Card.of(self.scenario), self.scenario, self.num_worlds, self.device)
        self._row_shape, of_team = self._read_observation_space(model.observation_space)
        self._table = self._read_action_space(model.action_space, of_team)
        self._state: Any = None
        self._begins = np.ones((self.num_worlds, 1 if of_team else self.num_robots), dtype=bool)

    def forget(self, mask: np.ndarray) -> None:
        """Reset the state of the masked worlds."""
        self._wiring.reset(mask)
        self._begins[mask] = True

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        rows = self._wiring.read(observation.numpy()).reshape(-1, *self._row_shape)
        if self.normalizer is not None:
            rows = self.normalizer.normalize_obs(rows)
        outputs, self._state = self.model.predict(
            rows, state=self._state, episode_start=self._begins.reshape(-1), deterministic=self.deterministic
        )
        self._begins[:] = False
        chosen = outputs if self._table is None else self._table[outputs]
        self.action.assign(self._wiring.actions(np.asarray(chosen, dtype=np.float32).reshape(self.action.shape)))

    def _read_observation_space(self, space: Any) -> tuple[tuple[int, ...], bool]:
        """Return the shape of the model's input, and whether it is the team's."""
        n, inputs = self.num_robots, len(self._wiring.low)
        shape = space.shape if isinstance(space, Box) else None
        if shape not in ((inputs,), (n, inputs), (n * inputs,)):
            raise ValueError(
                f"observation_space of {self.name} must be a Box of shape ({inputs},), a robot's row, or "
                f"({n}, {inputs}) or ({n * inputs},), the team's, to play {self.scenario.name}, got {shown(space)}"
            )
        return shape, shape != (inputs,)

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
