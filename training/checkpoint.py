"""A checkpoint: a folder with `checkpoint.json` and the safetensors files that it names.

`checkpoint.json` is the commit point. It is replaced as a whole after the files that it names, with their SHA-256, are
on the disk; so a kill at any moment leaves the checkpoint before or the one after. Nothing in it is unpickled.
"""

import hashlib
import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load as from_safetensors
from safetensors.numpy import save as to_safetensors

from lissajous_env import Scenario, library
from lissajous_env.files import write_atomically
from lissajous_env.observation import layout
from training.network import Network

FILE = "checkpoint.json"
FORMAT = 1
_PACKAGES = ("lissajous-env", "warp-lang", "numpy", "torch", "stable-baselines3", "ray", "gymnasium")


@dataclass(frozen=True)
class Card:
    """What a policy is, apart from its weights: what it was trained on, what it reads, what it adds to."""

    scenario: str
    """Name of the scenario that it was trained on."""
    kind: str
    """Kind of robot that it drives."""
    inputs: tuple[str, ...]
    """Entries of the observation that the network reads, by name and in this order."""
    action_size: int
    """Components of a robot's action."""
    base: str | None = None
    """Classical policy whose action the network's output is added to; None: the output is the action.

    The network reads the base's action too, after `inputs`.
    """
    residual: float = 1.0
    """What the network's output, clipped to [-1, 1], is multiplied with before it is added to the base's action."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """How it was trained."""

    @classmethod
    def of(cls, scenario: Scenario, inputs: tuple[str, ...] = (), **more: Any) -> "Card":
        """Make the card of a policy for a scenario that reads `inputs`; by default the whole observation."""
        names = inputs or layout(scenario).names
        return cls(scenario.name, scenario.robot.kind, tuple(names), scenario.action_size, **more)

    @property
    def network_inputs(self) -> int:
        """Entries that the network takes."""
        return len(self.inputs) + (self.action_size if self.base else 0)

    def columns(self, scenario: Scenario) -> np.ndarray:
        """Where `inputs` stand in the observation of a scenario.

        Raises:
            ValueError: the scenario's robots or observation do not fit the policy; the message says how.
        """
        if scenario.robot.kind != self.kind:
            raise ValueError(
                f"policy trained on {self.scenario} must drive robots of kind {self.kind}, "
                f"got {scenario.name}, whose robots are of kind {scenario.robot.kind}"
            )
        names = layout(scenario).names
        missing = [name for name in self.inputs if name not in names]
        if missing:
            sizes = f"{scenario.sensing.robots_seen} robots and {scenario.sensing.targets_seen} targets"
            raise ValueError(
                f"observation of {scenario.name} must hold {len(self.inputs)} entries that the policy trained on "
                f"{self.scenario} reads; it lists {sizes} and lacks {', '.join(missing[:4])}"
                f"{f' and {len(missing) - 4} more' if len(missing) > 4 else ''}"
            )
        return np.array([names.index(name) for name in self.inputs])


def save(
    folder: str | Path,
    network: Network,
    card: Card,
    *,
    state: Mapping[str, np.ndarray] | None = None,
    notes: Mapping[str, Any] | None = None,
) -> None:
    """Replace the checkpoint of a folder.

    Args:
        folder: Made if it is not there.
        network: The policy's network.
        card: What the policy is.
        state: Arrays that training goes on from.
        notes: What else is written into `checkpoint.json`: scores, counters.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    files = {"weights": _write(folder, "weights", network.to_arrays())}
    if state is not None:
        files["state"] = _write(folder, "state", state)
    text = {
        "format": FORMAT,
        "policy": {
            "scenario": card.scenario,
            "kind": card.kind,
            "inputs": card.inputs,
            "action_size": card.action_size,
            "base": card.base,
            "residual": card.residual,
            "activation": network.activation,
        },
        "settings": dict(card.settings),
        "versions": _versions(),
        "files": files,
        **(notes or {}),
    }
    write_atomically(folder / FILE, json.dumps(text, indent=1, allow_nan=False) + "\n")
    for old in [*folder.glob("weights-*.safetensors"), *folder.glob("state-*.safetensors")]:
        if old.name not in {entry["name"] for entry in files.values()}:
            old.unlink(missing_ok=True)


def read(folder: str | Path) -> tuple[Network, Card, dict[str, Any]]:
    """Read a checkpoint: its network, its card, and all that `checkpoint.json` holds.

    Raises:
        ValueError: there is none, it is of a newer format, or a file of it is damaged; the message names the file.
    """
    path = Path(folder) / FILE
    if not path.is_file():
        raise ValueError(f"checkpoint must be a folder that holds {FILE}, got {folder}")
    try:
        text = json.loads(path.read_text(encoding="utf-8"))
        if text["format"] != FORMAT:
            raise ValueError(f"{path} must be of format {FORMAT}, got {text['format']}")
        policy = text["policy"]
        card = Card(
            policy["scenario"],
            policy["kind"],
            tuple(policy["inputs"]),
            policy["action_size"],
            policy["base"],
            policy["residual"],
            text["settings"],
        )
        activation, weights = policy["activation"], text["files"]["weights"]
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is damaged: {type(error).__name__}: {error}") from error
    network = Network.from_arrays(_read(path.parent, weights), activation)
    if network.inputs != card.network_inputs or network.outputs != card.action_size:
        got = f"{network.inputs} to {network.outputs}"
        raise ValueError(f"{path} is damaged: it must map {card.network_inputs} to {card.action_size}, got {got}")
    return network, card, text


def read_state(folder: str | Path, text: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Read the arrays that training goes on from; `text` is what `read` returned.

    Raises:
        ValueError: the checkpoint has none, or the file is damaged.
    """
    if "state" not in text["files"]:
        raise ValueError(f"{folder} must hold the state of a training that goes on; it holds a finished policy only")
    return _read(Path(folder), text["files"]["state"])


def _write(folder: Path, stem: str, arrays: Mapping[str, np.ndarray]) -> dict[str, str]:
    data = to_safetensors({name: np.ascontiguousarray(array) for name, array in arrays.items()})
    digest = hashlib.sha256(data).hexdigest()
    name = f"{stem}-{digest[:12]}.safetensors"
    write_atomically(folder / name, data)
    return {"name": name, "sha256": digest}


def _read(folder: Path, entry: Mapping[str, str]) -> dict[str, np.ndarray]:
    path = folder / Path(entry["name"]).name
    if not path.is_file():
        raise ValueError(f"{path} is missing, which {folder / FILE} names")
    data = path.read_bytes()
    digest = hashlib.sha256(data).hexdigest()
    if digest != entry["sha256"]:
        raise ValueError(f"{path} is damaged: its SHA-256 must be {entry['sha256']}, got {digest}")
    try:
        return from_safetensors(data)
    except SafetensorError as error:
        raise ValueError(f"{path} is damaged: {error}") from error


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def home_scenario(card: Card) -> Scenario:
    """Make the scenario that a policy was trained on, with the overrides it was trained with."""
    return library.scenario(card.scenario, **card.settings.get("overrides", {}))
