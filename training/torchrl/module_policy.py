"""A module of TorchRL or BenchMARL as a policy that can be evaluated and benchmarked.

    policy = training.torchrl.ModulePolicy(experiment.policy, "rough", num_worlds=16)
    rows = lissajous_env.evaluate(policy, "rough", seeds=range(16))

where `experiment` is a BenchMARL experiment on `LissajousTask.ROUGH`; the module can also be any that was trained on
`LissajousTorchEnv`. `torch.load` with `weights_only=False` can run any code, so load only files that you trust.
"""

from typing import Any

import torch
import warp as wp
from tensordict import TensorDict
from torchrl.envs.utils import ExplorationType, set_exploration_type

from baselines.policies.base import Policy
from lissajous_env import Scenario
from lissajous_env.envs.sides import action_table
from lissajous_env.wording import require
from training.torchrl.env import ROBOTS


class ModulePolicy(Policy):
    """Policy whose actions are a module's output `robot, action` for the input `robot, observation` (W, N, D).

    Actions have shape (W, N, action_size), or are whole numbers (W, N), rows of the action table.

    Args:
        module: Module that is called with a TensorDict of batch size (W,).
        scenario: Scenario to play.
        num_worlds: W.
        device: Warp device, which must be that of the module.
        deterministic: Use the most likely action instead of a random one.

    Raises:
        ValueError: the module is not callable, or its actions have another shape.
    """

    arrays = "torch"

    def __init__(
        self, module: Any, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu", *,
        deterministic: bool = True,
    ):  # fmt: skip
        super().__init__(scenario, num_worlds, device)
        require(callable(module), "module", "must be callable with a TensorDict", module)
        self.module, self.kind, self.name = module, self.scenario.robot.kind, type(module).__name__
        self._exploration = ExplorationType.DETERMINISTIC if deterministic else ExplorationType.RANDOM
        self._table = torch.as_tensor(action_table(self.scenario), device=wp.device_to_torch(self.device))

    def decide(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the actions."""
        with torch.no_grad(), set_exploration_type(self._exploration):
            rows = TensorDict({"observation": observation}, self.shape)
            outputs: Any = self.module(TensorDict({ROBOTS: rows}, self.shape[:1], device=self._table.device))
        action = outputs[ROBOTS, "action"]
        is_index = not action.is_floating_point() and tuple(action.shape) == self.shape
        return self._table[action] if is_index else action
