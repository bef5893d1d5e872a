"""Scenarios drawn from a space as a TorchRL environment: groups of worlds, padded to the largest team.

    env = SampledTorchEnv("monitoring-v1", num_groups=8, group_size=8)
    data = env.rollout(100, policy, break_when_any_done=False)

The W worlds are groups that share a scenario: group g has the worlds g group_size to (g + 1) group_size - 1. N is the
number of robots of the largest team. The keys and shapes are those of `training.torchrl.env`, and one more:

| key           | shape     | what                                     |
|---------------|-----------|------------------------------------------|
| `robot, mask` | (W, N, 1) | True where the scenario has a robot      |

Where it has none, `observation`, `info`, `reward` and the numbers in `state` are 0, `robot, done` and
`robot, terminated` are True, and actions have no effect. Losses should leave these rows out.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from gymnasium.error import ResetNeeded
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Categorical, Unbounded
from torchrl.envs import EnvBase

from lissajous_env import Scenario, ScenarioSpace
from lissajous_env.envs.sampler import Sampler
from lissajous_env.envs.true_state import padded_rows, state_size
from lissajous_env.settings.checks import whole_number
from lissajous_env.world.selection import drawn_seeds
from lissajous_env.world.simulation import fold_seed
from training.torchrl.env import GROUP, LissajousTorchEnv, reset_mask


class SampledTorchEnv(EnvBase):
    """Worlds of many scenarios as a TorchRL `EnvBase` of batch size (W,); the module lists its keys.

    When all worlds of a group are reset together, as where every episode ends at the time limit, the group continues
    with its next scenario. Scenarios, and the episodes in them, depend on the seed and on the number of the group
    alone.

    Attributes:
        groups: A `LissajousTorchEnv` for each group; empty before the first reset.
        group_map: Name of the group and names of its agents, in the order of their rows.

    Args:
        space: Name of a space or SPACE:SPLIT, where SPLIT is a split or a shift, by default `train`; or a
            `ScenarioSpace`.
        num_groups: Number of groups.
        group_size: Number of worlds in a group.
        device: `cpu`, `cuda` or `cuda:k`.
        seed: Seed of the sequence of scenarios and episodes; by default from the operating system.
        discrete_actions: As for `LissajousTorchEnv`.
        state: Return the true state, of the size of the largest team and the largest number of target slots.
        threads: CPU threads of the simulations; all cores by default.
        **overrides: Fields that are given instead of drawn, as for `ScenarioSpace.overridden`.

    Raises:
        ValueError: an argument is invalid, rogues are agents, or scenarios have rows or actions of different sizes.
    """

    def __init__(
        self,
        space: str | ScenarioSpace = "monitoring-v1",
        num_groups: int = 8,
        group_size: int = 8,
        *,
        device: Any = "cpu",
        seed: int | None = None,
        discrete_actions: bool = False,
        state: bool = False,
        threads: int | None = None,
        **overrides: Any,
    ):
        self._sampler = Sampler(space, overrides)
        self.num_groups = whole_number("num_groups", num_groups)
        self.group_size = whole_number("group_size", group_size)
        self._settings = {"device": device, "discrete_actions": discrete_actions, "threads": threads}
        worlds, n = self.num_groups * self.group_size, self._sampler.most_robots
        largest = _DrawnTorchEnv(self._sampler.largest, worlds, **self._settings)
        super().__init__(device=largest.device, batch_size=(worlds,))
        self.group_map = largest.group_map
        self._with_state = state
        self.observation_spec = largest.full_observation_spec.clone()
        self.action_spec = largest.full_action_spec.clone()
        self.reward_spec = largest.full_reward_spec.clone()
        self.done_spec = largest.full_done_spec.clone()
        self.observation_spec[GROUP, "mask"] = Categorical(2, torch.Size((worlds, n, 1)), self.device, torch.bool)
        if state:
            made = self._sampler.first
            size = state_size(n, self._sampler.most_targets, made.messages.size)
            self.observation_spec["state"] = Unbounded(torch.Size((worlds, size)), self.device)
        self.groups: list[LissajousTorchEnv] = []
        self._set_seed(seed)

    @property
    def scenarios(self) -> list[Scenario]:
        """Scenarios of the groups; empty before the first reset."""
        return [each.scenario for each in self.groups]

    def _set_seed(self, seed: int | None) -> None:
        """Begin the sequences of scenarios that belong to a seed with the next reset."""
        self._draws = self._sampler.draws(int(drawn_seeds(1)[0]) if seed is None else fold_seed(seed))
        self._begins = True

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        mask = reset_mask(tensordict, GROUP, self.batch_size)
        if self._begins or mask is None:
            mask, self._begins = None, False
            self.groups = [self._drawn(group) for group in range(self.num_groups)]
        parts = []
        for group, each in enumerate(self.groups):
            chosen = None if mask is None else mask[self._worlds(group)].reshape(-1, 1)
            if chosen is None:
                parts.append(each._reset())
            elif chosen.all():
                self.groups[group] = self._drawn(group)
                parts.append(self.groups[group]._reset())
            else:
                parts.append(each._reset(TensorDict({"_reset": chosen}, batch_size=(self.group_size,))))
        return self._padded(parts)

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        if not self.groups:
            raise ResetNeeded("step needs a running episode: call reset first")
        action = tensordict.get((GROUP, "action"))
        parts = []
        for group, each in enumerate(self.groups):
            rows = action[self._worlds(group), : each.scenario.num_robots].contiguous()
            given = TensorDict({GROUP: {"action": rows}}, batch_size=(self.group_size,), device=self.device)
            try:
                parts.append(each._step(given))
            except ValueError as error:
                raise ValueError(f"{error}, in group {group} of {each.scenario.name}") from error
        return self._padded(parts)

    def _padded(self, parts: list[TensorDict]) -> TensorDict:
        """Put the tensors of the groups together, with rows where a scenario has no robot."""
        worlds = []
        for each, part in zip(self.groups, parts, strict=True):
            n, missing = each.scenario.num_robots, self._sampler.most_robots - each.scenario.num_robots
            shape = (self.group_size, n + missing)
            team = part.get(GROUP)
            team = TensorDict({key: _pad(team.get(key), missing) for key in team.keys(True, True)}, batch_size=shape)
            mask = torch.arange(n + missing, device=self.device) < n
            team["mask"] = mask.expand(shape).unsqueeze(-1).clone()
            for flag in ("done", "terminated"):
                team[flag] |= ~team["mask"]
            whole = part.clone(recurse=False).set(GROUP, team)
            if self._with_state:
                targets = self._sampler.most_targets
                whole["state"] = padded_rows(each.simulation, n + missing, targets, torch)
            worlds.append(whole)
        return torch.cat(worlds, 0).to(self.device)  # type: ignore[arg-type]

    def _drawn(self, group: int) -> LissajousTorchEnv:
        """Return worlds of a group's next scenario."""
        made, seed = self._sampler.next(self._draws, group)
        return _DrawnTorchEnv(made, self.group_size, seed=seed, **self._settings)

    def _worlds(self, group: int) -> slice:
        return slice(group * self.group_size, (group + 1) * self.group_size)

    def render(self, mode: str = "rgb_array", world: int = 0, size: tuple[int, int] | None = None) -> np.ndarray:
        """Draw a world, as `LissajousTorchEnv.render`; the size of the picture follows the scenario's rectangle."""
        if not self.groups:
            raise ResetNeeded("render needs an episode: call reset first")
        group, place = divmod(world, self.group_size)
        return self.groups[group].render(mode, place, size)

    to = LissajousTorchEnv.to


class _DrawnTorchEnv(LissajousTorchEnv):
    """Worlds of a drawn scenario, which is as it is."""

    def _changed(self, scenario: Any, overrides: Mapping[str, Any]) -> Scenario:
        return scenario


def _pad(tensor: torch.Tensor, missing: int) -> torch.Tensor:
    """Return a tensor (W, n, k) with more rows of zeros (W, n + missing, k)."""
    return torch.nn.functional.pad(tensor, (0, 0, 0, missing)) if missing else tensor
