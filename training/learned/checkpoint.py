"""Checkpoints: folders with `checkpoint.json` and the safetensors files that it names.

`checkpoint.json` is the commit point. It is replaced atomically after the files that it names, with their SHA-256, have
been written; so a kill at any moment leaves the previous or the new checkpoint. It also names the best policy so far,
from which the checkpoint in the folder `best` is made. No pickle is read, and inconsistent files are rejected.
"""

import contextlib
import hashlib
import json
import platform
import re
import sys
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load as from_safetensors
from safetensors.numpy import save as to_safetensors

from lissajous_env import Scenario
from lissajous_env.parameters import named
from lissajous_env.parameters.extensions import Extension, load_extension
from lissajous_env.parameters.scenario_file import scenario_of
from lissajous_env.storage.files import read_bytes, read_json
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import shown
from training.learned.card import Card, require
from training.learned.history import check_notes
from training.learned.network import ACTIVATIONS, Network

FILE = "checkpoint.json"
REHEARSAL = "rehearsal.jsonl"
"""Results of the rehearsal before a training, from which it is resumed."""
FORMAT = 1
LARGEST = 1 << 31
"""Largest size of a file of arrays [bytes]."""
_BEST = "best"
_PACKAGES = ("lissajous-env", "warp-lang", "numpy", "torch", "stable-baselines3", "ray", "gymnasium")
_NAME = r"-[0-9a-f]{12}\.safetensors"


def hold(folder: str | Path) -> Folder:
    """Lock the folder of a training, and complete what a killed process left unfinished.

    Args:
        folder: Folder, which is created if it does not exist.

    Raises:
        ValueError: it is in use, contains files of a user under these names, or is damaged.
    """
    held = Folder(folder, (FILE, _BEST + "/", "report.html", REHEARSAL, "tensorboard/"))
    try:
        settle(held)
    except BaseException:
        held.close()
        raise
    return held


def save(
    folder: str | Path | Folder,
    network: Network,
    card: Card,
    *,
    state: Mapping[str, np.ndarray] | None = None,
    notes: Mapping[str, Any] | None = None,
) -> None:
    """Replace the checkpoint of a folder.

    Args:
        folder: Path, which is locked while this writes, or a locked folder.
        network: Network of the policy.
        card: Card of the policy.
        state: Arrays from which the training can be resumed.
        notes: Further entries of `checkpoint.json`: scores, counters; `best` as returned by `best_of`.
    """
    with _held(folder) as held:
        files = {"weights": _write(held, "weights", to_bytes(network.to_arrays()))}
        if state is not None:
            files["state"] = _write(held, "state", to_bytes(state))
        text = {
            "format": FORMAT,
            "policy": card.to_dict() | {"activation": network.activation},
            "settings": dict(card.settings),
            **({} if card.home is None else {"scenario": card.home}),
            "versions": _versions(),
            "files": files,
            **(notes or {}),
        }
        held.write(FILE, _as_json(text))
        settle(held)


def best_of(network: Network, counters: Mapping[str, Any], point: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entry `best` of the `notes` of `save`, for a policy that has just become the best.

    Args:
        network: Network of the policy, which the next checkpoint also contains.
        counters: Counters of the training.
        point: Its evaluation, the latest point of the curve.
    """
    entry = _entry("weights", to_bytes(network.to_arrays()))
    return {"counters": dict(counters), "scores": dict(point), "files": {"weights": entry}}


def settle(folder: Folder) -> None:
    """Update `best` to the checkpoint of a locked folder, and remove our files that no checkpoint names.

    Raises:
        ValueError: the checkpoint is damaged.
    """
    named: set[str] = set()
    if (folder.path / FILE).exists():
        text = read_text(folder.path)
        named = {entry["name"] for entry in text["files"].values()}
        best = text.get("best")
        if best is not None:
            entry = best["files"]["weights"]
            named |= {entry["name"], f"{_BEST}/{entry['name']}"}
            _publish(folder, text, best)
    for name in folder.written:
        if re.fullmatch(rf"({_BEST}/)?(weights|state){_NAME}", name) and name not in named:
            folder.remove(name)


def read(folder: str | Path) -> tuple[Network, Card, dict[str, Any]]:
    """Read a checkpoint; return its network, its card and the contents of `checkpoint.json`.

    Raises:
        ValueError: there is none, it has another format, or a file is damaged; the message names the file.
    """
    text = read_text(folder)
    path = Path(folder) / FILE
    with _naming(path):
        card = Card.from_dict(text["policy"], text["settings"], text.get("scenario"))
    weights = Path(folder) / text["files"]["weights"]["name"]
    arrays = _read(Path(folder), text["files"]["weights"])
    with _naming(weights):
        for name, array in arrays.items():
            require(f"dtype of {name}", array.dtype == np.float32, "must be float32", str(array.dtype))
        network = Network.from_arrays(arrays, text["policy"]["activation"])
    if network.inputs != card.network_inputs or network.outputs != card.action_size:
        got = f"{network.inputs} to {network.outputs}"
        raise ValueError(f"{path} is damaged: it must map {card.network_inputs} to {card.action_size}, got {got}")
    return network, card, text


def read_text(folder: str | Path) -> dict[str, Any]:
    """Read and validate `checkpoint.json` of a folder.

    Raises:
        ValueError: there is none, it has another format, or it is damaged; the message names the file.
    """
    path = Path(folder) / FILE
    if not path.is_file():
        raise ValueError(f"checkpoint must be a folder with {FILE}, got {folder}")
    text = read_json(path)
    with _naming(path):
        require("it", isinstance(text, dict), "must be an object", text)
        there = text.get("format")
        require("format", type(there) is int and there == FORMAT, f"must be {FORMAT}", there)
        for name in ("policy", "settings", "files"):
            require(name, isinstance(text.get(name), dict), "must be an object", text.get(name))
        activation = text["policy"].get("activation")
        require("activation", activation in ACTIVATIONS, f"must be one of {', '.join(ACTIVATIONS)}", activation)
        _check_files(text["files"], {"weights", "state"})
        check_notes(text)
        if text.get("best") is not None:
            _check_files(text["best"].get("files"), {"weights"})
    return text


def parts(folder: str | Path) -> dict[str, str]:
    """Return digests of the card and the weights, which identify a policy in a folder.

    Raises:
        ValueError: there is no checkpoint, or it is damaged.
    """
    text = read_text(folder)
    card = hashlib.sha256(json.dumps(text["policy"], sort_keys=True).encode()).hexdigest()[:16]
    return {"policy of the checkpoint": card, "weights of the checkpoint": text["files"]["weights"]["sha256"][:16]}


def read_state(folder: str | Path, text: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Read the arrays from which a training is resumed; `text` is the result of `read`.

    Raises:
        ValueError: the checkpoint has none, or the file is damaged.
    """
    if "state" not in text["files"]:
        raise ValueError(f"{folder} must contain the state of a training, got a policy without it")
    return _read(Path(folder), text["files"]["state"])


@contextlib.contextmanager
def resuming(folder: str | Path, text: Mapping[str, Any]) -> Iterator[None]:
    """Raise ValueError that names the file of the state where what is resumed does not accept it."""
    try:
        yield
    except (KeyError, IndexError, TypeError, ValueError, RuntimeError) as error:
        words = f"{type(error).__name__}: {str(error).partition(chr(10))[0][:200]}"
        file = Path(folder) / text["files"]["state"]["name"]
        raise ValueError(f"{file} must be the state of this training: {words}") from error


def to_bytes(arrays: Mapping[str, np.ndarray]) -> bytes:
    """Return named arrays in the safetensors format."""
    return to_safetensors({name: np.ascontiguousarray(array) for name, array in arrays.items()})


def home_scenario(card: Card) -> Scenario:
    """Return the scenario on which a policy was trained, from the values in its folder.

    A folder may come from anyone, so no module is imported because of it: the module of an extension must have been
    imported by the program.

    Raises:
        ValueError: the values are invalid, the module of an extension has not been imported, or, if the folder contains
            only the name of the scenario, that is not registered or lacks an overridden field.
    """
    if card.home is not None:
        extensions = card.home.get("extensions") or ()
        if not isinstance(extensions, (list, tuple)):
            raise ValueError(f"extensions of a scenario must be a list, got {shown(extensions)}")
        return scenario_of(card.home, [_brought(each, card) for each in extensions])
    if "extensions" in card.overrides:
        rule = f"must be given with the extensions that the policy was trained with, {card.overrides['extensions']}"
        raise ValueError(f"scenario {rule}: loading a folder never imports their modules")
    try:
        return named.scenario(named.registered_scenario(card.scenario), **card.overrides)
    except TypeError as error:
        raise ValueError(f"overrides must be fields of {card.scenario}, got {dict(card.overrides)}") from error


def _brought(entry: Any, card: Card) -> Extension:
    """Return an extension whose module the program has imported."""
    place = entry.get("place") if isinstance(entry, Mapping) else None
    require("place of an extension", isinstance(place, str), "must be module:name", place)
    module = str(place).partition(":")[0]
    if module not in sys.modules:
        raise ValueError(
            f"scenario {card.scenario} uses {place}: import {module} before the policy is loaded, or give the "
            "scenario; no module is imported because a folder names it"
        )
    return load_extension(str(place))


def _publish(folder: Folder, text: dict[str, Any], best: dict[str, Any]) -> None:
    """Write the checkpoint of the best policy from the entry in the training's; unchanged files are not rewritten."""
    entry = best["files"]["weights"]
    home = folder.make_folder(_BEST)
    if not (home / entry["name"]).exists():
        folder.write(f"{_BEST}/{entry['name']}", _read_file(folder.path, entry))
    curve = [point for point in text.get("curve") or () if point["steps"] <= best["scores"]["steps"]]
    wanted = _as_json({name: value for name, value in (text | best | {"curve": curve}).items() if name != "best"})
    path = home / FILE
    if not path.exists() or path.read_bytes() != wanted.encode():
        folder.write(f"{_BEST}/{FILE}", wanted)


@contextlib.contextmanager
def _held(folder: str | Path | Folder) -> Iterator[Folder]:
    if isinstance(folder, Folder):
        yield folder
    else:
        with hold(folder) as held:
            yield held


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Add the name of the file to the error about a value."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{path} is damaged: {error}") from None


def _as_json(text: Mapping[str, Any]) -> str:
    return json.dumps(text, indent=1, allow_nan=False) + "\n"


def _check_files(files: Any, known: set[str]) -> None:
    names = isinstance(files, dict) and {"weights"} <= set(files) <= known
    require("files", names, "must name weights, and no others but state", files)
    for stem, entry in files.items():
        holds = isinstance(entry, dict) and all(isinstance(entry.get(key), str) for key in ("name", "sha256"))
        require(stem, holds, "must have a name and a SHA-256", entry)
        name, digest = entry["name"], entry["sha256"]
        require(f"name of {stem}", re.fullmatch(stem + _NAME, name), f"must be {stem}-HASH.safetensors", name)
        require(f"SHA-256 of {stem}", re.fullmatch("[0-9a-f]{64}", digest), "must be 64 hexadecimal digits", digest)


def _entry(stem: str, data: bytes) -> dict[str, str]:
    digest = hashlib.sha256(data).hexdigest()
    return {"name": f"{stem}-{digest[:12]}.safetensors", "sha256": digest}


def _write(folder: Folder, stem: str, data: bytes) -> dict[str, str]:
    entry = _entry(stem, data)
    folder.write(entry["name"], data)
    return entry


def _read(folder: Path, entry: Mapping[str, str]) -> dict[str, np.ndarray]:
    data = _read_file(folder, entry)
    try:
        return from_safetensors(data)
    except (SafetensorError, ValueError, TypeError, OverflowError) as error:
        raise ValueError(f"{folder / entry['name']} is damaged: {str(error)[:200]}") from error
    except KeyError as error:
        raise ValueError(f"{folder / entry['name']} is damaged: NumPy has no numbers of type {error}") from error


def _read_file(folder: Path, entry: Mapping[str, str]) -> bytes:
    path = folder / entry["name"]
    if not path.exists():
        raise ValueError(f"{path} is missing, but {folder / FILE} names it")
    data = read_bytes(path, LARGEST)
    digest = hashlib.sha256(data).hexdigest()
    if digest != entry["sha256"]:
        raise ValueError(f"{path} is damaged: its SHA-256 must be {entry['sha256']}, got {digest}")
    return data


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
