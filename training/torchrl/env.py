"""The batch as a TorchRL environment: a group `robot` of agents `robot_0` ..., and a group `rogue` if rogues learn.

    env = LissajousTorchEnv("intruders", num_worlds=64, device="cuda")
    data = env.rollout(100, policy, break_when_any_done=False)

W worlds, N agents of a group, D entries of an observation, A components of an action:

| key                                  | shape                | what                                                   |
|--------------------------------------|----------------------|--------------------------------------------------------|
| `GROUP, observation`                 | (W, N, D)            | rows, see `lissajous_env.world.observation` and        |
|                                      |                      | `lissajous_env.world.rogues.rows`                      |
| `GROUP, mask`                        | (W, N, 1)            | True for robots that the scenario has, and for rogues  |
|                                      |                      | that act in the next step                              |
| `GROUP, action`                      | (W, N, A), or (W, N) | in [-1, 1]; discrete: rows of the action table         |
| `robot, info, reward_...`            | (W, N, 1)            | the terms of the reward, whose sum it is               |
| `next, GROUP, reward`                | (W, N, 1)            | reward; of a rogue, its undetected time [s]            |
| `done`, `terminated`, `truncated`    | (W, 1)               | of the world: truncated at the time limit,             |
|                                      |                      | terminated when collisions have removed all its robots |
| `GROUP, done` (`terminated`, ...)    | (W, N, 1)            | of each agent: a robot is terminated by its removal,   |
|                                      |                      | a rogue by its detection                               |
| `next, score, ...` (names: `SCORES`) | (W, 1)               | score of the episode that the step ended; NaN before   |
| `state`, if enabled                  | (W, S)               | true state of the world, for central critics           |

An agent has its row until the end of the episode: a failed robot observes `works` = 0, a removed robot stays `done`
with reward 0, and a slot without a rogue is zero. Whole worlds are reset, by a mask `_reset` (W, 1).

Of a space of scenarios, the worlds are groups that share a scenario, padded to the N robots of the largest team. Where
a scenario has no robot, `observation`, `info`, `reward` and the numbers in `state` are 0, and `done` is True. Losses
should leave out the rows that are False in `mask`.
"""

from __future__ import annotations

import os
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
import torch
import warp as wp
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from lissajous_env import Scenario, ScenarioSpace
from lissajous_env.envs.batch import Batch
from lissajous_env.envs.sides import Side
from lissajous_env.world.columns import (
    COLLISIONS,
    DETECTED,
    DETECTION_TIME,
    IDLENESS,
    LONGEST_IDLENESS,
    SEPARATION,
    WITHIN_BOUND,
)
from lissajous_env.world.selection import drawn_seeds

GROUP = "robot"

_COLUMNS = (DETECTED, DETECTION_TIME, WITHIN_BOUND, COLLISIONS, SEPARATION, IDLENESS, LONGEST_IDLENESS)
SCORES = tuple(column.name for column in _COLUMNS)
"""Score columns that are returned at the end of an episode; `env.simulation.score()` returns all."""
_FLAGS = ("done", "terminated", "truncated")


class LissajousTorchEnv(EnvBase):
    """A batch of worlds as a TorchRL `EnvBase` of batch size (W,); the module lists its keys.

    Tensors are on the device of the simulation. Observations, rewards and flags are not copied to the host; only the
    masks of ended worlds are, for their scores. Returned tensors are copies.

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
            here or by `set_seed`, seeds are drawn from the operating system, so that environments in several processes
            differ.
        discrete_actions: Let actions be rows of `lissajous_env.envs.sides.action_table`, and of `rogue_table`.
        state: Return the true state, `lissajous_env.envs.true_state.state_names`.
        threads: CPU threads of the simulation; all cores by default.
        **overrides: Fields of the scenario, as in `lissajous_env.parameters.scenario`.

    Raises:
        ValueError: an argument is invalid, or scenarios of a space have rows or actions of different sizes.
    """

    def __init__(
        self,
        scenario: str | os.PathLike | Scenario | ScenarioSpace = "experiment",
        num_worlds: int = 1,
        *,
        num_groups: int = 1,
        device: Any = "cpu",
        seed: int | None = None,
        discrete_actions: bool = False,
        state: bool = False,
        threads: int | None = None,
        **overrides: Any,
    ):
        settings: dict[str, Any] = {"num_groups": num_groups, "discrete_actions": discrete_actions, "threads": threads}
        self.batch = Batch(scenario, num_worlds, device=str(device), overrides=overrides, **settings)
        super().__init__(device=wp.device_to_torch(self.simulation.device), batch_size=(num_worlds,))
        self.group_map = {side.agent: list(side.names) for side in self.batch.sides}
        tables = {side.agent: side.table for side in self.batch.sides}
        self._tables = {
            group: torch.as_tensor(of, device=self.device) for group, of in tables.items() if of is not None
        }
        self._with_state = state
        self._renderers: dict[Any, Any] = {}
        self._declare()
        self._set_seed(seed)

    @property
    def simulation(self) -> Any:
        """Simulation of the worlds; of a space, that of the first group."""
        return self.batch.simulation

    @property
    def scenario(self) -> Scenario:
        """Scenario of the worlds; of a space, that of the first group."""
        return self.batch.scenario

    @property
    def scenarios(self) -> list[Scenario]:
        """Scenarios of the groups; before the first reset, the first one of the split."""
        return [simulation.scenario for simulation in self.batch.simulations]

    def _declare(self) -> None:
        """Set the specs."""
        device, world = self.device, self.batch_size

        def flags(shape: torch.Size) -> dict[str, Any]:
            return {name: Categorical(2, torch.Size((*shape, 1)), device, torch.bool) for name in _FLAGS}

        def numbers(shape: tuple[int, ...], names: Any) -> Composite:
            specs: dict[str, Any] = {name: Unbounded(torch.Size((*shape, 1)), device) for name in names}
            return Composite(**specs, shape=shape, device=device)

        observed: dict[str, Any] = {"score": numbers(world, SCORES)}
        if self._with_state:
            observed["state"] = Unbounded(torch.Size((*world, self.batch.state_size)), device)
        acted: dict[str, Any] = {}
        rewarded: dict[str, Any] = {}
        ended = flags(world)
        for side in self.batch.sides:
            team = torch.Size((*world, side.places))
            row = torch.Size((*team, 1))
            low, high = (
                torch.as_tensor(end, device=device).expand(*team, -1) for end in (side.layout.low, side.layout.high)
            )
            entries: dict[str, Any] = {"observation": Bounded(low, high, device=device, dtype=torch.float32)}
            entries["mask"] = Categorical(2, row, device, torch.bool)
            if side.is_robots:
                entries["info"] = numbers(team, [f"reward_{name}" for name in self.simulation.reward_term_names])
            action: Any = Bounded(-1.0, 1.0, torch.Size((*team, side.action_size)), device, torch.float32)
            if side.table is not None:
                action = Categorical(len(side.table), team, device, torch.int64)
            groups: tuple[tuple[dict[str, Any], dict[str, Any]], ...] = (
                (observed, entries),
                (acted, {"action": action}),
                (rewarded, {"reward": Unbounded(row, device)}),
                (ended, flags(team)),
            )
            for specs, of_group in groups:
                specs[side.agent] = Composite(**of_group, shape=team, device=device)
        self.observation_spec = Composite(**observed, shape=world, device=device)
        self.action_spec = Composite(**acted, shape=world, device=device)
        self.reward_spec = Composite(**rewarded, shape=world, device=device)
        self.done_spec = Composite(**ended, shape=world, device=device)

    def _set_seed(self, seed: int | None) -> None:
        """Seed the next episodes, as the argument `seed`; later seeds are drawn from it."""
        self.batch.seed(int(drawn_seeds(1)[0]) if seed is None else seed)

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        if mask is None and tensordict is not None and (GROUP, "_reset") in tensordict.keys(True):
            raise ValueError(f"_reset must be a mask of worlds of shape {(*self.batch_size, 1)}, got one of robots")
        with self._on_torch_stream():
            self.batch.reset(None if mask is None else mask.reshape(-1).cpu().numpy())
        return self._read()

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        actions = {}
        for side in self.batch.sides:
            action = tensordict.get((side.agent, "action"))
            actions[side.agent] = action if side.table is None else self._tables[side.agent][action]
        with self._on_torch_stream():
            self.batch.step(actions)
        after = self._read()
        self._require_finite(actions)
        for side in self.batch.sides:
            reward = self.batch.rows(side, torch).reward
            after.set((side.agent, "reward"), reward.unsqueeze(-1).clone())
        return after

    def _require_finite(self, actions: dict[str, torch.Tensor]) -> None:
        """Raise ValueError if an action is not finite.

        The simulation has replaced it by zero. The actions are read after the scores, which wait for the device anyway.
        """
        for side in self.batch.sides:
            finite = torch.isfinite(actions[side.agent]).all(-1)
            if not finite.all():
                w, i = (~finite).nonzero()[0].tolist()
                got = actions[side.agent][w, i].tolist()
                raise ValueError(f"action of {side.names[i]} in world {w} must be finite, got {got}")

    def _read(self) -> TensorDict:
        """Copy observations, flags and scores from the simulation's arrays, which the next step overwrites."""
        world: dict[str, Any] = {"score": self._batched(self._scores())}
        for side in self.batch.sides:
            rows = self.batch.rows(side, torch)
            if side.is_robots:
                world |= _flags(rows.terminated.all(1).unsqueeze(-1), (rows.mask & rows.truncated).any(1).unsqueeze(-1))
            world[side.agent] = self._of_side(side, rows)
        if self._with_state:
            world["state"] = self.batch.state(torch)
        return self._batched(world)

    def _of_side(self, side: Side, rows: Any) -> TensorDict:
        terminated, truncated = rows.terminated.unsqueeze(-1).clone(), rows.truncated.unsqueeze(-1).clone()
        team = {"observation": rows.observation.clone(), "mask": rows.mask.unsqueeze(-1).clone()}
        if side.is_robots:
            terms = self.batch.reward_terms(torch).clone().unbind(-1)
            names = self.simulation.reward_term_names
            team["info"] = self._batched(
                {f"reward_{name}": term.unsqueeze(-1) for name, term in zip(names, terms, strict=True)}, side.places
            )
        return self._batched(team | _flags(terminated, truncated), side.places)

    def _scores(self) -> dict[str, torch.Tensor]:
        """Return the scores (W, 1) of the episodes that the latest step ended, NaN for the other worlds."""
        scores = torch.full((len(SCORES), *self.batch_size, 1), torch.nan, device=self.device)
        ended = self.batch.just_ended
        if ended.any():
            rows = self.batch.score(ended)
            columns = torch.tensor([[row[name] for row in rows] for name in SCORES], device=self.device)
            scores[:, torch.as_tensor(ended, device=self.device), 0] = columns.float()
        return dict(zip(SCORES, scores, strict=True))

    def _batched(self, entries: dict[str, Any], *places: int) -> TensorDict:
        return TensorDict(entries, batch_size=(*self.batch_size, *places), device=self.device)

    def _on_torch_stream(self) -> AbstractContextManager:
        """Run the simulation on torch's CUDA stream, because Warp's own stream is not synchronised with it."""
        if self.simulation.device.is_cpu:
            return nullcontext()
        return wp.ScopedStream(wp.stream_from_torch(self.device))

    def render(self, mode: str = "rgb_array", world: int = 0, size: float = 1.0) -> np.ndarray:
        """Draw a world.

        Args:
            mode: `rgb_array`, the only mode.
            world: Index of the world.
            size: Factor of the usual size of the picture, which fits the scenario's rectangle.

        Returns:
            (height, width, 3) uint8.

        Raises:
            ValueError: the mode is invalid.
        """
        if mode != "rgb_array":
            raise ValueError(f"mode must be rgb_array, got {mode!r}")
        group, place = divmod(world, self.batch.group_size)
        simulation = self.batch.simulations[group]
        if (size, group, simulation.scenario) not in self._renderers:
            from lissajous_env.render import Renderer

            self._renderers = {(size, group, simulation.scenario): Renderer(simulation.scenario, size)}
        with self._on_torch_stream():
            return self._renderers[size, group, simulation.scenario].draw(simulation, place)

    def to(self, device: Any) -> LissajousTorchEnv:
        """Return the environment itself, which cannot be moved to another device.

        Raises:
            ValueError: the device differs from the environment's.
        """
        wanted = torch.device(device)
        if wanted.type != self.device.type or wanted.index not in (None, self.device.index):
            raise ValueError(f"device must be {self.device}, the device of the environment, got {wanted}")
        return self


def _flags(terminated: torch.Tensor, truncated: torch.Tensor) -> dict[str, torch.Tensor]:
    return {"done": terminated | truncated, "terminated": terminated, "truncated": truncated}
