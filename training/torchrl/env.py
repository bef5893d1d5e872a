"""The simulation as a TorchRL environment: a batch of worlds with one group `robot` of agents `robot_0` ...

    env = LissajousTorchEnv("intruders", num_worlds=64, device="cuda")
    data = env.rollout(100, policy, break_when_any_done=False)

W worlds, N robots, D entries of an observation, A components of an action:

| key                                  | shape                | what                                                   |
|--------------------------------------|----------------------|--------------------------------------------------------|
| `robot, observation`                 | (W, N, D)            | rows, see `lissajous_env.world.observation`            |
| `robot, action`                      | (W, N, A), or (W, N) | in [-1, 1]; discrete: rows of the action table         |
| `robot, info, reward_...`            | (W, N, 1)            | the terms of the reward, whose sum it is               |
| `next, robot, reward`                | (W, N, 1)            | reward                                                 |
| `done`, `terminated`, `truncated`    | (W, 1)               | of the world: truncated at the time limit,             |
|                                      |                      | terminated when collisions have removed all its robots |
| `robot, done` (`terminated`, ...)    | (W, N, 1)            | of each robot: terminated when a collision removed it  |
| `next, score, ...` (names: `SCORES`) | (W, 1)               | score of the episode that the step ended; NaN before   |
| `state`, if enabled                  | (W, S)               | true state of the world, for central critics           |

A robot has its row until the end of the episode: a failed robot observes `works` = 0, and a removed robot stays `done`
with reward 0. Whole worlds are reset, by a mask `_reset` (W, 1).
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
import torch
import warp as wp
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from lissajous_env import Scenario, Simulation
from lissajous_env.envs.actions import action_table
from lissajous_env.envs.true_state import state_names, state_rows
from lissajous_env.parameters import named
from lissajous_env.parameters.rogues import AGENTS
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
from lissajous_env.world.simulation import fold_seed
from lissajous_env.world.state import ENDED

GROUP = "robot"

SCORES = tuple(
    each.name for each in (DETECTED, DETECTION_TIME, WITHIN_BOUND, COLLISIONS, SEPARATION, IDLENESS, LONGEST_IDLENESS)
)
"""Score columns that are returned at the end of an episode; `env.simulation.score()` returns all."""


class LissajousTorchEnv(EnvBase):
    """A batch of worlds of one scenario as a TorchRL `EnvBase` of batch size (W,); the module lists its keys.

    Tensors are on the device of the simulation. Observations, rewards and flags are not copied to the host; only the
    masks of ended worlds are, for their scores. Returned tensors are copies.

    Attributes:
        simulation: Batch of worlds.
        group_map: Name of the group and names of its agents, in the order of their rows.

    Args:
        scenario: Scenario, or its name.
        num_worlds: W.
        device: `cpu`, `cuda` or `cuda:k`.
        seed: Seed of world 0; world k has seed + k. Without a seed here or by `set_seed`, seeds are drawn from the
            operating system, so that environments in several processes differ.
        discrete_actions: Let actions be rows of `lissajous_env.envs.actions.action_table`.
        state: Return the true state, `lissajous_env.envs.true_state.state_names`.
        threads: CPU threads of the simulation; all cores by default.
        **overrides: Fields of the scenario, as in `lissajous_env.parameters.scenario`.

    Raises:
        ValueError: an argument is invalid.
    """

    group = GROUP
    """Name of the robots' group."""

    def __init__(
        self,
        scenario: str | Scenario = "experiment",
        num_worlds: int = 1,
        *,
        device: Any = "cpu",
        seed: int | None = None,
        discrete_actions: bool = False,
        state: bool = False,
        threads: int | None = None,
        **overrides: Any,
    ):
        made = self._changed(scenario, overrides)
        self.simulation = Simulation(made, num_worlds, device=str(device), threads=threads)
        super().__init__(device=wp.device_to_torch(self.simulation.device), batch_size=(num_worlds,))
        self.scenario = self.simulation.scenario
        self._check_rogues()
        self.group_map = {self.group: [f"robot_{i}" for i in range(self.scenario.num_robots)]}
        self._table = torch.as_tensor(action_table(self.scenario), device=self.device) if discrete_actions else None
        self._with_state = state
        self._renderers: dict[Any, Any] = {}
        self._declare()
        self._set_seed(seed)

    def _changed(self, scenario: str | Scenario, overrides: Mapping[str, Any]) -> Scenario:
        """Return the scenario with its fields overridden."""
        return named.scenario(scenario, **overrides)

    def _check_rogues(self) -> None:
        """Raise ValueError for rogues that are agents."""
        if self.scenario.targets.rogues == AGENTS:
            rule = "must be None or a scripted rogue in an environment of one group"
            raise ValueError(f"targets.rogues {rule}, got {AGENTS}; TwoSidedTorchEnv has two")

    def _declare(self) -> None:
        """Set the specs."""
        sim, device = self.simulation, self.device
        world = self.batch_size
        team = torch.Size((*world, sim.num_robots))
        row = torch.Size((*team, 1))

        def each(shape: torch.Size, **specs: Any) -> Composite:
            return Composite(**specs, shape=shape, device=device)

        def flags(shape: torch.Size) -> dict[str, Categorical]:
            names = ("done", "terminated", "truncated")
            return {name: Categorical(2, torch.Size((*shape, 1)), device, torch.bool) for name in names}

        low, high = (torch.as_tensor(end, device=device).expand(*team, -1) for end in (sim.layout.low, sim.layout.high))
        rows = Bounded(low, high, device=device, dtype=torch.float32)
        info = each(team, **{f"reward_{name}": Unbounded(row, device) for name in sim.reward_term_names})
        scores = each(world, **{name: Unbounded(torch.Size((*world, 1)), device) for name in SCORES})
        state = {}
        if self._with_state:
            state["state"] = Unbounded(torch.Size((*world, len(state_names(self.scenario)))), device)
        if self._table is None:
            action = Bounded(-1.0, 1.0, torch.Size(sim.action_shape), device, torch.float32)
        else:
            action = Categorical(len(self._table), team, device, torch.int64)
        self.observation_spec = each(
            world, **{self.group: each(team, observation=rows, info=info)}, score=scores, **state
        )
        self.action_spec = each(world, **{self.group: each(team, action=action)})
        self.reward_spec = each(world, **{self.group: each(team, reward=Unbounded(row, device))})
        self.done_spec = each(world, **flags(world), **{self.group: each(team, **flags(team))})

    def _set_seed(self, seed: int | None) -> None:
        """Seed the next episode of world k with seed + k; later seeds are drawn from it."""
        first = int(drawn_seeds(1)[0]) if seed is None else seed
        self._seeds = np.array([fold_seed(first + k) for k in range(self.simulation.num_worlds)])
        self._seeded = np.ones(self.simulation.num_worlds, dtype=bool)

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDictBase:
        mask = reset_mask(tensordict, self.group, self.batch_size)
        chosen = np.ones(self.batch_size, dtype=bool) if mask is None else mask.reshape(-1).cpu().numpy()
        seeded, unseeded = chosen & self._seeded, chosen & ~self._seeded
        with self._on_torch_stream():
            if seeded.any():
                self.simulation.reset(seeded, self._seeds[seeded])
                self._seeded &= ~chosen
            if unseeded.any():
                self.simulation.reset(unseeded)
        return self._read()

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        action = tensordict.get((self.group, "action"))
        if self._table is not None:
            action = self._table[action]
        with self._on_torch_stream():
            self._advance(action, tensordict)
        after = self._read()
        self._require_finite(action)
        return after.set((self.group, "reward"), wp.to_torch(self.simulation.reward).unsqueeze(-1).clone())

    def _advance(self, action: torch.Tensor, tensordict: TensorDictBase) -> None:
        """Take a step with the actions of the robots."""
        self.simulation.step(action)

    def _require_finite(self, action: torch.Tensor) -> None:
        """Raise ValueError if an action is not finite.

        The simulation has replaced it by zero and flagged its world. The flags are read after the scores, which wait
        for the device anyway.
        """
        if wp.to_torch(self.simulation.invalid).any():
            finite = torch.isfinite(action).all(-1)
            w, i = (~finite).nonzero()[0].tolist()
            raise ValueError(f"action of robot_{i} in world {w} must be finite, got {action[w, i].tolist()}")

    def _read(self) -> TensorDict:
        """Copy observations, flags and scores from the simulation's arrays, which the next step overwrites."""
        sim = self.simulation
        terms = wp.to_torch(sim.reward_terms).clone().unbind(-1)
        info = {f"reward_{name}": term.unsqueeze(-1) for name, term in zip(sim.reward_term_names, terms, strict=True)}
        terminated = wp.to_torch(sim.terminated).unsqueeze(-1).clone()
        truncated = wp.to_torch(sim.truncated).unsqueeze(-1).clone()
        team = {
            "observation": wp.to_torch(sim.observation).clone(),
            "info": self._batched(info, 2),
            **_flags(terminated, truncated),
        }
        world = {
            self.group: self._batched(team, 2),
            "score": self._batched(self._scores(), 1),
            **_flags(terminated.all(1), truncated.any(1)),
        }
        if self._with_state:
            world["state"] = state_rows(self.simulation, torch)
        return self._batched(world, 1)

    def _scores(self) -> dict[str, torch.Tensor]:
        """Return the scores (W, 1) of the episodes that the latest step ended, NaN for the other worlds."""
        scores = torch.full((len(SCORES), *self.batch_size, 1), torch.nan, device=self.device)
        ended = wp.to_torch(self.simulation.clock.stage) == int(ENDED)
        if ended.any():
            rows = self.simulation.score(ended.cpu().numpy())
            columns = torch.tensor([[row[name] for row in rows] for name in SCORES], device=self.device)
            scores[:, ended, 0] = columns.float()
        return dict(zip(SCORES, scores, strict=True))

    def _batched(self, entries: dict[str, Any], dimensions: int) -> TensorDict:
        shape = (*self.batch_size, self.scenario.num_robots)[:dimensions]
        return TensorDict(entries, batch_size=shape, device=self.device)

    def _on_torch_stream(self) -> AbstractContextManager:
        """Run the simulation on torch's CUDA stream, because Warp's own stream is not synchronised with it."""
        if self.simulation.device.is_cpu:
            return nullcontext()
        return wp.ScopedStream(wp.stream_from_torch(self.device))

    def render(self, mode: str = "rgb_array", world: int = 0, size: tuple[int, int] | None = None) -> np.ndarray:
        """Draw a world.

        Args:
            mode: `rgb_array`, the only mode.
            world: Index of the world.
            size: Width and height [px]; None: fitted to the scenario's rectangle.

        Returns:
            (height, width, 3) uint8.

        Raises:
            ValueError: the mode or size is invalid.
        """
        if mode != "rgb_array":
            raise ValueError(f"mode must be rgb_array, got {mode!r}")
        if size not in self._renderers:
            from lissajous_env.render import Renderer

            self._renderers[size] = Renderer(self.scenario, size)
        with self._on_torch_stream():
            return self._renderers[size].draw(self.simulation, world)

    def to(self, device: Any) -> LissajousTorchEnv:
        """Return the environment itself, which cannot be moved to another device.

        Raises:
            ValueError: the device differs from the environment's.
        """
        wanted = torch.device(device)
        if wanted.type != self.device.type or wanted.index not in (None, self.device.index):
            raise ValueError(f"device must be {self.device}, the device of the environment, got {wanted}")
        return self


def reset_mask(tensordict: TensorDictBase | None, group: str, batch_size: torch.Size) -> torch.Tensor | None:
    """Return the mask of the worlds to reset, None for all; a mask of robots raises ValueError."""
    mask = None if tensordict is None else tensordict.get("_reset", None)
    if mask is None and tensordict is not None and (group, "_reset") in tensordict.keys(True):
        raise ValueError(f"_reset must be a mask of worlds of shape {(*batch_size, 1)}, got one of robots")
    return mask


def _flags(terminated: torch.Tensor, truncated: torch.Tensor) -> dict[str, torch.Tensor]:
    return {"done": terminated | truncated, "terminated": terminated, "truncated": truncated}
