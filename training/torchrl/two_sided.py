"""The simulation as a TorchRL environment of two groups, named as in MPE's `simple_tag`: robots chase rogues.

    env = TwoSidedTorchEnv("intruders", num_worlds=64)
    data = env.rollout(100, policy, break_when_any_done=False)

The group `adversary` is that of the chasers, the robots `robot_0` ..., with the keys of the group `robot` of
`training.torchrl.env`. The group `agent` is that of the chased, the rogues `rogue_0` ...; W worlds, T target slots, D
entries of a rogue's row:

| key                                  | shape                | what                                                   |
|--------------------------------------|----------------------|--------------------------------------------------------|
| `agent, observation`                 | (W, T, D)            | rows, see `lissajous_env.world.rogues.rows`            |
| `agent, action`                      | (W, T, 2), or (W, T) | velocities [speed limit]; discrete: rows of the table  |
| `agent, info, present`               | (W, T, 1)            | 1 for a rogue that acts in the next step               |
| `next, agent, reward`                | (W, T, 1)            | time of the step for which it was undetected [s]       |
| `agent, done` (`terminated`, ...)    | (W, T, 1)            | terminated by its detection, truncated at the end      |

A slot has its row until the end of the episode: zeros, reward 0 and actions without effect where no rogue is present.
"""

from __future__ import annotations

from typing import Any

import torch
import warp as wp
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Bounded, Categorical, Composite, Unbounded

from lissajous_env import Scenario
from lissajous_env.envs.actions import rogue_table
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.world.rogues.rows import rogue_layout
from training.torchrl.env import LissajousTorchEnv

ROBOTS, ROGUES = "adversary", "agent"
"""Names of the groups."""


class TwoSidedTorchEnv(LissajousTorchEnv):
    """A batch of worlds as a TorchRL `EnvBase` with the groups `adversary` and `agent`; the module lists its keys.

    Args:
        scenario: Scenario, or its name; `rogues` is `agents`.
        num_worlds: W.
        **settings: Further arguments of `LissajousTorchEnv`.

    Raises:
        ValueError: an argument is invalid, or the rogues are no agents.
    """

    group = ROBOTS

    def __init__(self, scenario: str | Scenario = "experiment", num_worlds: int = 1, **settings: Any):
        settings = {"rogues": AGENTS} | settings
        super().__init__(scenario, num_worlds, **settings)
        self.group_map[ROGUES] = [f"rogue_{t}" for t in range(self.scenario.target_capacity)]

    def _check_rogues(self) -> None:
        if self.scenario.targets.rogues != AGENTS:
            raise ValueError(f"targets.rogues must be {AGENTS}, got {self.scenario.targets.rogues}")

    def _declare(self) -> None:
        super()._declare()
        device, layout = self.device, rogue_layout(self.scenario)
        team = torch.Size((*self.batch_size, self.scenario.target_capacity))
        row = torch.Size((*team, 1))
        low, high = (torch.as_tensor(end, device=device).expand(*team, -1) for end in (layout.low, layout.high))
        self._rogue_table = None if self._table is None else torch.as_tensor(rogue_table(), device=device)
        if self._rogue_table is None:
            action: Any = Bounded(-1.0, 1.0, torch.Size((*team, 2)), device, torch.float32)
        else:
            action = Categorical(len(self._rogue_table), team, device, torch.int64)
        rows = Bounded(low, high, device=device, dtype=torch.float32)
        info = Composite(present=Unbounded(row, device), shape=team, device=device)
        flags = {name: Categorical(2, row, device, torch.bool) for name in ("done", "terminated", "truncated")}
        for name, entries in (
            ("observation_spec", {"observation": rows, "info": info}),
            ("action_spec", {"action": action}),
            ("reward_spec", {"reward": Unbounded(row, device)}),
            ("done_spec", flags),
        ):
            whole = getattr(self, f"full_{name}").clone()
            whole[ROGUES] = Composite(entries, shape=team, device=device)
            setattr(self, name, whole)

    def _advance(self, action: torch.Tensor, tensordict: TensorDictBase) -> None:
        rogues = tensordict.get((ROGUES, "action"))
        self.simulation.step(action, rogues if self._rogue_table is None else self._rogue_table[rogues])

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        after = super()._step(tensordict)
        return after.set((ROGUES, "reward"), wp.to_torch(self.simulation.rogue_reward).unsqueeze(-1).clone())

    def _require_finite(self, action: torch.Tensor) -> None:
        rogues = wp.to_torch(self.simulation.rogue_action)
        if not (finite := torch.isfinite(rogues).all(-1)).all():
            w, t = (~finite).nonzero()[0].tolist()
            raise ValueError(f"action of rogue_{t} in world {w} must be finite, got {rogues[w, t].tolist()}")
        super()._require_finite(action)

    def _read(self) -> TensorDict:
        world, sim = super()._read(), self.simulation
        arrays = sim.rogue_present, sim.rogue_terminated, sim.rogue_truncated
        present, terminated, truncated = (wp.to_torch(array).unsqueeze(-1).clone() for array in arrays)
        shape = (*self.batch_size, self.scenario.target_capacity)
        rogues = {
            "observation": wp.to_torch(sim.rogue_observation).clone(),
            "info": TensorDict({"present": present.float()}, batch_size=shape, device=self.device),
            "done": terminated | truncated,
            "terminated": terminated,
            "truncated": truncated,
        }
        return world.set(ROGUES, TensorDict(rogues, batch_size=shape, device=self.device))
