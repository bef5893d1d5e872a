"""A checkpoint as a policy: the same interface as the classical ones, evaluated by NumPy or by torch."""

import contextlib
import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

import baselines
from baselines.policy import Policy
from lissajous_env import Scenario
from training import checkpoint
from training.checkpoint import Card
from training.network import Network


class Learned(Policy):
    """A network's action, clipped to [-1, 1]; where the policy has a base, a share of it is added to the base's action.

    Each row of the observation gives the action of its own robot, for all robots by the same network.

    Args:
        network: The network.
        card: What the policy is.
        scenario: What it is played on.
        num_worlds: W.
        device: Warp device.
        backend: `numpy` (a CPU only) or `torch`; by default NumPy on a CPU and torch on a GPU. Their actions differ by
            rounding alone.

    Raises:
        ValueError: the scenario's robots or observation do not fit the policy.
    """

    def __init__(
        self,
        network: Network,
        card: Card,
        scenario: str | Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        backend: str | None = None,
    ):
        super().__init__(scenario, num_worlds, device)
        backend = backend or ("numpy" if self.device.is_cpu else "torch")
        if backend not in ("numpy", "torch") or (backend == "numpy" and not self.device.is_cpu):
            raise ValueError(f"backend must be numpy (on a CPU) or torch, got {backend!r} on {self.device}")
        self.network, self.card, self.kind = network, card, card.kind
        columns = card.columns(self.scenario)
        width = self.observation_shape[-1]
        self._columns = slice(None) if np.array_equal(columns, np.arange(width)) else columns
        self.base = None if card.base is None else baselines.make(card.base, self.scenario, num_worlds, self.device)
        self._decide_rows = self._by_numpy if backend == "numpy" else self._by_torch
        if backend == "torch":
            self._torch_network = network.to_torch(wp.device_to_torch(self.device))

    def _forget(self, mask: np.ndarray) -> None:
        if self.base is not None:
            self.base.reset(mask)

    def _decide(self, observation: wp.array) -> None:
        base = None if self.base is None else self.base.act(observation)
        self._decide_rows(observation, base)

    def _by_numpy(self, observation: wp.array, base: wp.array | None) -> None:
        rows = observation.numpy().reshape(-1, self.observation_shape[-1])[:, self._columns]
        action = self.action.numpy().reshape(len(rows), -1)  # on a CPU the same memory
        if base is None:
            np.clip(self.network(rows), -1.0, 1.0, out=action)
        else:
            base_rows = base.numpy().reshape(action.shape)
            added = np.clip(self.network(np.concatenate([rows, base_rows], axis=1)), -1.0, 1.0)
            np.clip(base_rows + np.float32(self.card.residual) * added, -1.0, 1.0, out=action)

    def _by_torch(self, observation: wp.array, base: wp.array | None) -> None:
        import torch

        with torch.no_grad(), _torch_stream(self.device):
            rows = wp.to_torch(observation).flatten(0, 1)[:, self._columns]
            action = wp.to_torch(self.action).flatten(0, 1)
            if base is None:
                action.copy_(self._torch_network(rows).clamp_(-1.0, 1.0))
            else:
                base_rows = wp.to_torch(base).flatten(0, 1)
                added = self._torch_network(torch.cat([rows, base_rows], dim=1)).clamp_(-1.0, 1.0)
                action.copy_((base_rows + self.card.residual * added).clamp_(-1.0, 1.0))


def load(
    name: str | Path,
    scenario: str | Scenario | None = None,
    num_worlds: int = 1,
    device: Any = "cpu",
    backend: str | None = None,
) -> Learned:
    """Make a policy of a shipped name or of a checkpoint's folder; by default for the scenario it was trained on.

    Raises:
        ValueError: no such name or folder, a damaged checkpoint, or a scenario that the policy does not fit.
    """
    network, card, _ = checkpoint.read(find(name))
    made = checkpoint.home_scenario(card) if scenario is None else scenario
    policy = Learned(network, card, made, num_worlds, device, backend)
    policy.name = str(name)
    return policy


def find(name: str | Path) -> Path:
    """Folder of a shipped policy, or of a checkpoint: the folder itself.

    Raises:
        ValueError: there is neither.
    """
    shipped = _SHIPPED / str(name)
    if str(name) in names():
        return shipped
    if (Path(name) / checkpoint.FILE).is_file():
        return Path(name)
    raise ValueError(
        f"policy must be one of {', '.join(names()) or 'none shipped'}, or a folder that holds {checkpoint.FILE}, "
        f"got {str(name)!r}"
    )


def register_shipped() -> None:
    """Add the shipped policies to the registry of `baselines`, which then takes a checkpoint's folder for a name too.

    Weights are read when a policy is made.
    """
    baselines.register_opener(load)
    for name in names():
        text = json.loads((_SHIPPED / name / checkpoint.FILE).read_text(encoding="utf-8"))
        policy, scenario = text["policy"], text["policy"]["scenario"]
        about = f"Learned on {scenario}{', on top of ' + policy['base'] if policy['base'] else ''}."
        baselines.register(name, policy["kind"], partial(load, name), tuple(text["made_for"]), about, learned=True)


_SHIPPED = Path(__file__).parent / "policies"


def names() -> tuple[str, ...]:
    """Names of the shipped policies."""
    return tuple(sorted(path.parent.name for path in _SHIPPED.glob(f"*/{checkpoint.FILE}")))


def _torch_stream(device: Any) -> Any:
    """On a GPU, let Warp queue what it launches behind torch, on torch's stream."""
    import torch

    if device.is_cpu:
        return contextlib.nullcontext()
    stream = wp.stream_from_torch(torch.cuda.current_stream(wp.device_to_torch(device)))
    return wp.ScopedStream(stream, sync_enter=True, sync_exit=True)
