"""Scenarios as BenchMARL tasks, for MAPPO, IPPO, QMIX and its other algorithms.

    from training.torchrl.benchmarl import LissajousTask

    task = LissajousTask.INTRUDERS.get_task({"task.duration": 30.0})

A config contains overrides of scenario fields, as in `lissajous_env.parameters.scenario`, and the arguments `state`
(True: central critics read the true state instead of all observations) and `threads` of the environment. Your own
scenario is a task as well:

    task = LissajousTaskClass("two cars", {"scenario": my_scenario})

With `{"rogues": "agents"}` the rogues are trained too, as a group beside the robots.
`examples/benchmarl_mappo.py` trains on a task. Actions are continuous or discrete, as the algorithm requires.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from benchmarl.environments import Task, TaskClass
from tensordict import TensorDictBase
from torchrl.data import Composite
from torchrl.envs import EnvBase

from lissajous_env import Scenario
from lissajous_env.parameters import named
from training.torchrl.env import SCORES, LissajousTorchEnv

_OF_ENVIRONMENT = ("state", "threads")


class LissajousTaskClass(TaskClass):
    """A scenario as a BenchMARL task.

    Args:
        name: Name of the task; without `scenario` in the config, that of a scenario, or its file.
        config: Overrides of the scenario, `scenario`, `state` and `threads`; empty by default.

    Raises:
        ValueError: the scenario or an override is invalid.
    """

    def __init__(self, name: str, config: dict[str, Any] | None = None):
        super().__init__(name, dict(config or {}))
        self.scenario  # noqa: B018 - rejects invalid overrides before the training begins

    @property
    def scenario(self) -> Scenario:
        """Scenario with its overrides."""
        overrides = {key: value for key, value in self.config.items() if key not in _OF_ENVIRONMENT}
        return named.scenario(overrides.pop("scenario", self.name), **overrides)

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        """Return a function that makes the environment with `num_envs` worlds."""
        settings = {key: self.config[key] for key in _OF_ENVIRONMENT if key in self.config}
        settings |= {"discrete_actions": not continuous_actions, "seed": seed, "device": device}
        scenario = self.scenario
        return lambda: LissajousTorchEnv(scenario, num_envs, **settings)

    def supports_continuous_actions(self) -> bool:
        """Return True."""
        return True

    def supports_discrete_actions(self) -> bool:
        """Return True."""
        return True

    def max_steps(self, env: EnvBase) -> int:
        """Return the number of steps of an episode."""
        return self.scenario.task.steps

    def has_render(self, env: EnvBase) -> bool:
        """Return False: `lissajous run` films what was trained."""
        return False

    def group_map(self, env: EnvBase) -> dict[str, list[str]]:
        """Return the group of the robots and, if rogues are agents, that of the rogues."""
        return env.group_map  # pyright: ignore[reportReturnType]

    def observation_spec(self, env: EnvBase) -> Composite:
        """Return the spec of the observations of each group, (N, D)."""
        return _of_groups(env, "observation")

    def info_spec(self, env: EnvBase) -> Composite:
        """Return the spec of the infos: the terms of the robots' reward, (N, 1) each."""
        return _of_groups(env, "info")

    def state_spec(self, env: EnvBase) -> Composite | None:
        """Return the spec of the true state, (S,), if the config enables it."""
        if not self.config.get("state"):
            return None
        return Composite({"state": env.full_observation_spec_unbatched["state"]}, device=env.device)

    def action_spec(self, env: EnvBase) -> Composite:
        """Return the spec of the actions: (N, A) numbers, or (N,) rows of the action table."""
        return env.full_action_spec_unbatched

    def action_mask_spec(self, env: EnvBase) -> None:
        """Return None: every action is allowed."""
        return None

    @staticmethod
    def env_name() -> str:
        """Return the name of the environment in results."""
        return "lissajous"

    @staticmethod
    def log_info(batch: TensorDictBase) -> dict[str, float]:
        """Return the mean of each score column over the episodes that ended in a batch, without NaN."""
        ended = batch["next", "done"]
        columns = {name: batch["next", "score", name][ended] for name in SCORES}
        known = {name: column[torch.isfinite(column)] for name, column in columns.items()}
        return {f"collection/score/{name}": values.mean().item() for name, values in known.items() if len(values)}


class _NamedTask(Task):
    """A named scenario as a task."""

    @staticmethod
    def associated_class() -> type[LissajousTaskClass]:
        """Return the class of the tasks."""
        return LissajousTaskClass

    def get_task(self, config: dict[str, Any] | None = None) -> TaskClass:
        """Return the task; without a config, the scenario without overrides."""
        return LissajousTaskClass(self.name, {"scenario": _SCENARIOS[self.name], **(config or {})})


_SCENARIOS = {name.upper().replace("-", "_"): name for name in named.scenarios()}
"""Scenarios by the names of their tasks."""
LissajousTask: Any = _NamedTask("LissajousTask", dict.fromkeys(_SCENARIOS), module=__name__)
"""The named scenarios: `LissajousTask.INTRUDERS_INSIDE` is `intruders-inside`."""


def _of_groups(env: EnvBase, name: str) -> Composite:
    """Return the spec of an entry of the observations, by groups of agents."""
    whole = env.full_observation_spec_unbatched
    group_map: Any = env.group_map
    specs = {group: whole[group] for group in group_map if name in whole[group]}
    specs = {key: Composite({name: spec[name]}, shape=spec.shape, device=env.device) for key, spec in specs.items()}
    return Composite(specs, device=env.device)
