"""The batch as a TorchRL environment: a group `robot` of agents `robot_0` ..., and a group `rogue` if rogues learn.

    env = LissajousTorchEnv("intruders", num_worlds=64, device="cuda")
    data = env.rollout(100, policy, break_when_any_done=False)

Keys, for W worlds, N agents of a group, D entries of an observation and A components of an action:

* `GROUP, observation` (W, N, D), and `GROUP, mask` (W, N, 1): False for slots without a robot or a live rogue, whose
  other entries are 0; losses should omit them.
* `GROUP, action` (W, N, A) in [-1, 1], or (W, N) rows of the action table; `next, GROUP, reward` (W, N, 1).
* `done`, `terminated`, `truncated` (W, 1) of a world, truncated at the time limit and terminated when all its robots
  are removed; `GROUP, done` ... (W, N, 1) of each agent, which has its row until the end of the episode.
* `robot, info, reward_...` (W, N, 1): the terms of the reward. `next, score, ...` (W, 1): the scores `SCORES` of the
  episode that the step ended, NaN before. `state` (W, S), if enabled: the true state, for central critics.

Whole worlds are reset, by a mask `_reset` (W, 1).
"""

from __future__ import annotations

import os
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
import warp as wp
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from lissajous_env import Scenario, ScenarioSpace
from lissajous_env.envs.batch import Batch
from lissajous_env.world import columns

ROBOTS = "robot"

SCORES = tuple(column.name for column in (
    columns.DETECTED, columns.DETECTION_TIME, columns.WITHIN_BOUND, columns.COLLISIONS, columns.SEPARATION,
    columns.IDLENESS, columns.LONGEST_IDLENESS,
))  # fmt: skip
"""Score columns that are returned at the end of an episode; `env.batch.score` returns all."""


class LissajousTorchEnv(EnvBase):
    """A batch of worlds as a TorchRL `EnvBase` of batch size (W,); the docstring of the module lists its keys.

    Tensors are copies on the device of the simulation; only the masks of ended worlds are copied to the host.

    Attributes:
        batch: The worlds.
        group_map: Names of the groups and of their agents, in the order of their rows.

    Args:
        scenario: Scenario, or its name; a space of scenarios, or SPACE:SPLIT, where SPLIT is a split or a shift, by
            default `train`. With `rogues="agents"`, the rogues are a group, too.
        num_worlds: W.
        num_groups: Number of groups of worlds of a space, which divides W. When all worlds of a group are reset
            together, as where every episode ends at the time limit, the group continues with its next scenario.
        device: `cpu`, `cuda` or `cuda:k`.
        seed: Seed of world 0, where world k has seed + k, or of the sequence of a space's scenarios. Without a seed
            here or by `set_seed`, seeds are drawn from the operating system.
        discrete_actions: True for actions that are indices of the tables of `lissajous_env.envs.sides`.
        state: True to return the true state, whose names are `lissajous_env.envs.sides.state_names`.
        threads: CPU threads of the simulation; all cores by default.
        **overrides: Fields of the scenario.

    Raises:
        ValueError: an argument is invalid, or scenarios of a space have rows or actions of different sizes.
    """

    def __init__(
        self, scenario: str | os.PathLike | Scenario | ScenarioSpace = "experiment", num_worlds: int = 1, *,
        num_groups: int = 1, device: Any = "cpu", seed: int | None = None, discrete_actions: bool = False,
        state: bool = False, threads: int | None = None, **overrides: Any,
    ):  # fmt: skip
        settings: dict[str, Any] = {"num_groups": num_groups, "discrete_actions": discrete_actions, "threads": threads}
        self.batch = Batch(scenario, num_worlds, device=str(device), seed=seed, overrides=overrides, **settings)
        super().__init__(device=wp.device_to_torch(self.batch.simulation.device), batch_size=(num_worlds,))
        self.group_map = {side.agent: list(side.names) for side in self.batch.sides}
        self._with_state = state
        self._declare()

    @property
    def scenarios(self) -> list[Scenario]:
        """Scenarios of the groups; before the first reset, the first one of the split."""
        return [simulation.scenario for simulation in self.batch.simulations]

    def _declare(self) -> None:
        """Set the specs."""
        device, world, batch = self.device, self.batch_size, self.batch

        def composite(entries: dict[str, Any], *shape: int) -> Composite:
            return Composite(entries, shape=torch.Size((*world, *shape)), device=device)

        def numbers(names: Any, *shape: int) -> Composite:
            return composite({name: Unbounded(torch.Size((*world, *shape, 1)), device) for name in names}, *shape)

        def flag(*shape: int) -> Categorical:
            return Categorical(2, torch.Size((*world, *shape, 1)), device, torch.bool)

        ends = "done", "terminated", "truncated"
        observed: dict[str, Any] = {"score": numbers(SCORES)}
        if self._with_state:
            observed["state"] = Unbounded(batch.state(torch).shape, device)
        acted, rewarded = {}, {}
        ended: dict[str, Any] = {name: flag() for name in ends}
        for side in batch.sides:
            slots, team = side.slots, torch.Size((*world, side.slots))
            low, high = (torch.as_tensor(end).expand(*team, -1) for end in (side.layout.low, side.layout.high))
            entries: dict[str, Any] = {"observation": Bounded(low, high, device=device, dtype=torch.float32)}
            entries["mask"] = flag(slots)
            if side.is_robots:
                entries["info"] = numbers([f"reward_{name}" for name in batch.simulation.reward_term_names], slots)
            action: Any = Bounded(-1.0, 1.0, torch.Size((*team, side.action_size)), device, torch.float32)
            if side.table is not None:
                action = Categorical(len(side.table), team, device, torch.int64)
            observed[side.agent] = composite(entries, slots)
            acted[side.agent] = composite({"action": action}, slots)
            rewarded[side.agent] = numbers(["reward"], slots)
            ended[side.agent] = composite({name: flag(slots) for name in ends}, slots)
        self.observation_spec, self.action_spec = composite(observed), composite(acted)
        self.reward_spec, self.done_spec = composite(rewarded), composite(ended)

    def _set_seed(self, seed: int | None) -> None:
        """Seed the next episodes, as the argument `seed`; later seeds are drawn from it."""
        self.batch.seed(seed)

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        if mask is None and tensordict is not None and (ROBOTS, "_reset") in tensordict.keys(True):
            raise ValueError(f"_reset must be a mask of worlds of shape {(*self.batch_size, 1)}, got one of robots")
        with self._on_torch_stream():
            self.batch.reset(None if mask is None else mask.reshape(-1).cpu().numpy())
        return self._read()

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        actions = {side.agent: tensordict.get((side.agent, "action")) for side in self.batch.sides}
        for side in self.batch.sides:
            if side.table is not None:
                actions[side.agent] = torch.as_tensor(side.table, device=self.device)[actions[side.agent]]
        with self._on_torch_stream():
            self.batch.step(actions)
        after = self._read(rewards=True)
        for side in self.batch.sides:
            if not torch.isfinite(actions[side.agent]).all():  # the simulation has replaced it by zero
                side.read_actions(actions[side.agent], actions[side.agent].shape)  # raises an error that names it
        return after

    def _read(self, rewards: bool = False) -> TensorDict:
        """Copy rows, flags and scores, with `rewards` after a step, because the next step overwrites the arrays."""
        scores = torch.full((len(SCORES), *self.batch_size, 1), torch.nan, device=self.device)
        ended = self.batch.just_ended
        if ended.any():
            rows = [[row[name] for name in SCORES] for row in self.batch.score(ended)]
            scores[:, torch.as_tensor(ended, device=self.device), 0] = torch.tensor(rows, device=self.device).float().T
        world: dict[str, Any] = {"score": self._batched(dict(zip(SCORES, scores, strict=True)))}
        for side in self.batch.sides:
            rows = self.batch.rows(side, torch)
            copied = ("mask", "terminated", "truncated", *(["reward"] if rewards else []))
            team = {name: getattr(rows, name).unsqueeze(-1).clone() for name in copied}
            team |= {"observation": rows.observation.clone(), "done": team["terminated"] | team["truncated"]}
            if side.is_robots:
                terms = rows.terms.clone().unsqueeze(-2).unbind(-1)
                names = [f"reward_{name}" for name in self.batch.simulation.reward_term_names]
                team["info"] = self._batched(dict(zip(names, terms, strict=True)), side.slots)
                all_removed, timed_out = rows.terminated.all(1, True), (rows.mask & rows.truncated).any(1, True)
                world |= {"terminated": all_removed, "truncated": timed_out, "done": all_removed | timed_out}
            world[side.agent] = self._batched(team, side.slots)
        if self._with_state:
            world["state"] = self.batch.state(torch)
        return self._batched(world)

    def _batched(self, entries: dict[str, Any], *shape: int) -> TensorDict:
        return TensorDict(entries, batch_size=(*self.batch_size, *shape), device=self.device)

    def _on_torch_stream(self) -> AbstractContextManager:
        """Run the simulation on torch's CUDA stream, because Warp's own stream is not synchronised with it."""
        device = self.batch.simulation.device
        return nullcontext() if device.is_cpu else wp.ScopedStream(wp.stream_from_torch(self.device))
