"""A module of TorchRL or BenchMARL as a policy, to be evaluated and benchmarked like the others.

    policy = training.torchrl.ModelPolicy(experiment.policy, "rough", num_worlds=16)
    rows = lissajous_env.evaluate(policy, "rough", seeds=range(16))

where `experiment` is one of BenchMARL that was trained on `LissajousTask.ROUGH`, or the module any that was trained on
`LissajousTorchEnv`. `torch.load`, where weights are read with `weights_only=False`, runs what the file says.
"""

from typing import Any

import torch
import warp as wp
from tensordict import TensorDict
from torchrl.envs.utils import ExplorationType, set_exploration_type

from baselines.policies.base import Policy
from lissajous_env import Scenario
from lissajous_env.envs.actions import action_table
from lissajous_env.wording import shown
from training.torchrl.env import GROUP


class ModelPolicy(Policy):
    """What a module writes as `robot, action` where `robot, observation` (W, N, D) is given.

    Actions are (W, N, action_size), or (W, N) whole numbers, rows of the action table.

    Args:
        module: A module of tensordict's, which is called with a TensorDict of batch size (W,).
        scenario: What it is played on.
        num_worlds: W.
        device: Warp device, on which the module is too.
        deterministic: Whether it takes its best action instead of a drawn one.

    Raises:
        ValueError: no such module; or, when it acts, actions of another shape.
    """

    arrays = "warp"

    def __init__(
        self, module: Any, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu", *,
        deterministic: bool = True,
    ):  # fmt: skip
        super().__init__(scenario, num_worlds, device)
        if not callable(module):
            raise ValueError(f"module must be callable with a TensorDict, got {shown(module)}")
        self.module, self.kind, self.name = module, self.scenario.robot.kind, type(module).__name__
        self._exploration = ExplorationType.DETERMINISTIC if deterministic else ExplorationType.RANDOM
        self._torch_device = wp.device_to_torch(self.device)
        self._table = torch.as_tensor(action_table(self.scenario), device=self._torch_device)

    def decide(self, observation: wp.array) -> None:
        """Write `action`."""
        with self._on_torch_stream(wp.to_torch(observation)), torch.no_grad(), set_exploration_type(self._exploration):
            # A copy: what a module keeps must not change with the next step.
            rows = TensorDict({"observation": wp.to_torch(observation).clone()}, self.shape)
            told: Any = self.module(TensorDict({GROUP: rows}, self.shape[:1], device=self._torch_device))
            action = told[GROUP, "action"]
            if not action.is_floating_point() and tuple(action.shape) == self.shape:
                action = self._table[action]
            if tuple(action.shape) != self.action.shape:
                wanted = f"{tuple(self.action.shape)}, or whole numbers of shape {self.shape}"
                raise ValueError(f"action of {self.name} must be of shape {wanted}, got {tuple(action.shape)}")
            wp.to_torch(self.action).copy_(action)
