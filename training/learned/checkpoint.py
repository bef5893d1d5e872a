"""Checkpoints: folders with `checkpoint.json` and the safetensors files that it names.

`checkpoint.json` is the commit point. It is replaced atomically after the files that it names, with their SHA-256, have
been written; so a kill at any moment leaves the previous or the new checkpoint. The best policy so far is a separate
checkpoint in the folder `best`. No pickle is read, and inconsistent files are rejected.
"""

import contextlib
import dataclasses
import hashlib
import json
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load as from_safetensors
from safetensors.numpy import save as to_safetensors

from lissajous_env import Scenario
from lissajous_env.identity import versions
from lissajous_env.parameters.extensions import Extension, load_extension
from lissajous_env.parameters.rogues import CHECKPOINT as FILE
from lissajous_env.parameters.scenario_file import scenario_of_json
from lissajous_env.storage.files import read_bytes, read_json, undamaged
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import require
from training.learned.card import Card
from training.learned.networks import RogueNetwork, TeamNetwork

BEST = "best/"
"""Folder of the checkpoint of the best policy, inside that of the training."""
FORMAT = 1
ACTIVATION = "relu"
"""Activation between the layers of every network."""
LARGEST = 1 << 31
"""Largest size of a file of arrays [bytes]."""
_NAME = r"-[0-9a-f]{12}\.safetensors"


def locked(folder: str | Path) -> Folder:
    """Lock the folder of a training.

    Args:
        folder: Folder, which is created if it does not exist.

    Raises:
        ValueError: it is in use, or contains files of a user under these names.
    """
    return Folder(folder, (FILE, BEST))


def save(
    folder: str | Path | Folder,
    network: RogueNetwork | TeamNetwork,
    card: Card,
    *,
    state: Mapping[str, np.ndarray] | None = None,
    notes: Mapping[str, Any] | None = None,
    subfolder: str = "",
) -> None:
    """Replace the checkpoint of a folder, and remove the files of the earlier one.

    Args:
        folder: Path, which is locked while this writes, or a locked folder.
        network: Network of the policy.
        card: Card of the policy.
        state: Arrays from which the training can be resumed.
        notes: Further entries of `checkpoint.json`: scores, counters.
        subfolder: `BEST` for the checkpoint of the best policy, inside the folder.
    """
    with contextlib.nullcontext(folder) if isinstance(folder, Folder) else locked(folder) as directory:
        arrays = {"weights": network.to_arrays()} | ({} if state is None else {"state": state})
        files = {stem: _write(directory, subfolder, stem, named) for stem, named in arrays.items()}
        contents = {
            "format": FORMAT,
            "policy": card.to_dict() | {"activation": ACTIVATION},
            "settings": dict(card.settings),
            "scenario": card.scenario_fields,
            "versions": versions("torch") if "torch" in sys.modules else versions(),
            "files": files,
            **(notes or {}),
        }
        directory.write(subfolder + FILE, json.dumps(contents, indent=1, allow_nan=False) + "\n")
        current = {subfolder + entry["name"] for entry in files.values()}
        for name in directory.written:
            if re.fullmatch(rf"{subfolder}(weights|state){_NAME}", name) and name not in current:
                directory.remove(name)


def read(folder: str | Path) -> tuple[RogueNetwork | TeamNetwork, Card, dict[str, Any]]:
    """Read a checkpoint; return its network, its card and the contents of `checkpoint.json`.

    Raises:
        ValueError: there is none, it has another format, or a file is damaged; the message names the file.
    """
    contents = read_contents(folder)
    path = Path(folder) / FILE
    with undamaged(path, "checkpoint"):
        card = Card.from_dict(contents["policy"], contents["settings"], contents["scenario"])
    weights = Path(folder) / contents["files"]["weights"]["name"]
    arrays = _read(Path(folder), contents["files"]["weights"])
    with undamaged(weights, "checkpoint"):
        for name, array in arrays.items():
            require(array.dtype == np.float32, f"dtype of {name}", "must be float32", str(array.dtype))
        kind = TeamNetwork if any(name.startswith("team.") for name in arrays) else RogueNetwork
        network = kind.from_arrays(arrays)
        sizes, wanted = (network.inputs, network.outputs), (len(card.inputs), card.action_size)
        require(sizes == wanted, "its inputs and outputs", f"must be {wanted}, as {FILE} states", sizes)
    return network, card, contents


def read_contents(folder: str | Path) -> dict[str, Any]:
    """Read and validate `checkpoint.json` of a folder.

    Raises:
        ValueError: there is none, it has another format, or it is damaged; the message names the file.
    """
    path = Path(folder) / FILE
    if not path.is_file():
        raise ValueError(f"checkpoint must be a folder with {FILE}, got {folder}")
    contents = read_json(path)
    with undamaged(path, "checkpoint"):
        require(isinstance(contents, dict), "it", "must be an object", contents)
        there = contents.get("format")
        require(type(there) is int and there == FORMAT, "format", f"must be {FORMAT}", there)
        for name in ("policy", "settings", "scenario", "files"):
            require(isinstance(contents.get(name), dict), name, "must be an object", contents.get(name))
        activation = contents["policy"].get("activation")
        require(activation == ACTIVATION, "activation", f"must be {ACTIVATION}", activation)
        _check_files(contents["files"])
    return contents


def digests(folder: str | Path) -> dict[str, str]:
    """Return digests of the card and the weights, which identify a policy in a folder.

    Raises:
        ValueError: there is no checkpoint, or it is damaged.
    """
    contents = read_contents(folder)
    card = hashlib.sha256(json.dumps(contents["policy"], sort_keys=True).encode()).hexdigest()[:16]
    return {"policy of the checkpoint": card, "weights of the checkpoint": contents["files"]["weights"]["sha256"][:16]}


def read_state(folder: str | Path, contents: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Read the arrays from which a training is resumed; `contents` are those of `read`.

    Raises:
        ValueError: the checkpoint has none, or the file is damaged.
    """
    if "state" not in contents["files"]:
        raise ValueError(f"{folder} must contain the state of a training, got a policy without it")
    return _read(Path(folder), contents["files"]["state"])


@contextlib.contextmanager
def resuming(settings: Any, card: Card) -> Iterator[tuple[dict[str, Any], dict[str, np.ndarray]]]:
    """Yield the contents of `checkpoint.json` and the arrays from which the caller resumes a training in its block.

    Args:
        settings: Settings of the training, with its folder `out`; those that `may_change` names may differ.
        card: Card of its policy, with its settings and scenario.

    Raises:
        ValueError: the settings or the scenario differ, with all differences; or the block raises an error.
    """
    folder, (_, stored, contents) = settings.out, read(settings.out)
    differences = [
        f"{name} = {stored.settings.get(name)!r} there, {value!r} here"
        for name, value in card.settings.items()
        if name not in settings.may_change and stored.settings.get(name) != value
    ]
    if card.scenario_fields != stored.scenario_fields:
        differences.append("the scenario has changed")
    if differences:
        rule = "must be an empty folder or contain a training with the same settings"
        raise ValueError(f"out {rule}, got {folder}: {'; '.join(differences)}")
    arrays = read_state(folder, contents)
    with undamaged(folder / contents["files"]["state"]["name"], "state of this training"):
        yield contents, arrays


def scenario_of_card(card: Card) -> Scenario:
    """Return the scenario on which a policy was trained, from the values in its folder.

    A folder may come from anyone, so no module is imported because of it: the module of an extension must have been
    imported by the program.

    Raises:
        ValueError: the values are invalid, or the module of an extension has not been imported.
    """
    extensions = card.scenario_fields.get("extensions") or ()
    require(isinstance(extensions, (list, tuple)), "extensions of a scenario", "must be a list", extensions)
    return scenario_of_json(card.scenario_fields, [_brought(entry, card) for entry in extensions])


def _brought(entry: Any, card: Card) -> Extension:
    """Return an extension of a card, whose module the program must have imported."""
    place = entry.get("place") if isinstance(entry, Mapping) else None
    require(isinstance(place, str), "place of an extension", "must be module:name", place)
    module = str(place).partition(":")[0]
    if module not in sys.modules:
        raise ValueError(
            f"scenario {card.scenario} uses {place}: import {module} before the policy is loaded (--import {module}), "
            "or give the scenario; no module is imported because a folder names it"
        )
    extension = load_extension(str(place))
    return dataclasses.replace(extension, **{name: entry[name] for name in extension.settings if name in entry})


def _check_files(files: Mapping[str, Any]) -> None:
    fits = {"weights"} <= set(files) <= {"weights", "state"}
    require(fits, "files", "must name weights, and no others but state", files)
    for stem, entry in files.items():
        fits = isinstance(entry, dict) and all(isinstance(entry.get(key), str) for key in ("name", "sha256"))
        require(fits, stem, "must have a name and a SHA-256", entry)
        name, digest = entry["name"], entry["sha256"]
        require(re.fullmatch(stem + _NAME, name), f"name of {stem}", f"must be {stem}-HASH.safetensors", name)
        require(re.fullmatch("[0-9a-f]{64}", digest), f"SHA-256 of {stem}", "must be 64 hexadecimal digits", digest)


def _write(folder: Folder, subfolder: str, stem: str, arrays: Mapping[str, np.ndarray]) -> dict[str, str]:
    data = to_safetensors({name: np.ascontiguousarray(array) for name, array in arrays.items()})
    digest = hashlib.sha256(data).hexdigest()
    name = f"{stem}-{digest[:12]}.safetensors"
    folder.write(subfolder + name, data)
    return {"name": name, "sha256": digest}


def _read(folder: Path, entry: Mapping[str, str]) -> dict[str, np.ndarray]:
    path = folder / entry["name"]
    data = read_bytes(path, LARGEST)
    digest = hashlib.sha256(data).hexdigest()
    if digest != entry["sha256"]:
        raise ValueError(f"{path} is damaged: its SHA-256 must be {entry['sha256']}, got {digest}")
    try:
        return from_safetensors(data)
    except Exception as error:  # damaged bytes make the library raise almost any
        reason = f"NumPy has no numbers of type {error}" if isinstance(error, KeyError) else str(error)[:200]
        raise ValueError(f"{path} is damaged: {reason}") from error
