"""Checkpoints: the file `checkpoint.safetensors` of a folder, which describes a policy and contains its weights.

It also has the state from which a training can be resumed. The file is replaced atomically, so that a kill at any
moment leaves the previous or the new checkpoint. The best policy so far is a separate checkpoint in the folder `best`.
No pickle is read, and arrays whose SHA-256 is not that of the description are rejected.
"""

import contextlib
import dataclasses
import hashlib
import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import safe_open
from safetensors.numpy import save as to_safetensors

from baselines.policies import registry
from lissajous_env import Scenario
from lissajous_env.identity import digest_of, versions
from lissajous_env.parameters.extensions import Extension, load_extension
from lissajous_env.parameters.rogues import CHECKPOINT as FILE
from lissajous_env.parameters.scenario_file import scenario_of_json
from lissajous_env.storage.files import open_plainly, parse_json, undamaged
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import require
from training.learned.card import ROGUE, Card
from training.learned.networks import RogueNetwork, TeamNetwork

BEST = "best/"
"""Folder of the checkpoint of the best policy, inside that of the training."""
FORMAT = 2
DESCRIPTION = "lissajous"
"""Name of the description, a JSON text, in the metadata of the file."""


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
    state: dict[str, np.ndarray] | None = None,
    notes: Mapping[str, Any] | None = None,
    subfolder: str = "",
) -> None:
    """Replace the checkpoint of a folder.

    Args:
        folder: Path, which is locked while this writes, or a locked folder.
        network: Network of the policy.
        card: Card of the policy.
        state: Arrays from which the training can be resumed.
        notes: Further entries of the description: scores, counters.
        subfolder: `BEST` for the checkpoint of the best policy, inside the folder.
    """
    parts = {"weights": network.arrays} | ({} if state is None else {"state": state})
    named = {f"{part}.{name}": array for part, arrays in parts.items() for name, array in arrays.items()}
    description = {
        "format": FORMAT,
        "card": vars(card),
        "versions": versions("torch") if "torch" in sys.modules else versions(),
        "sha256": {part: _digest(arrays) for part, arrays in parts.items()},
        **(notes or {}),
    }
    metadata = {DESCRIPTION: json.dumps(description, allow_nan=False)}
    data = to_safetensors({name: np.asarray(array, order="C") for name, array in named.items()}, metadata)
    with contextlib.nullcontext(folder) if isinstance(folder, Folder) else locked(folder) as directory:
        directory.write(subfolder + FILE, data)


def read(folder: str | Path) -> tuple[RogueNetwork | TeamNetwork, Card, dict[str, Any]]:
    """Read a checkpoint; return its network, its card and its description.

    Raises:
        ValueError: there is none, it has another format, or it is damaged; the message names the file.
    """
    with _opened(folder) as (description, file):
        card, arrays = description["card"], _arrays(file, description, "weights")
        network = RogueNetwork(arrays) if card.kind == ROGUE else TeamNetwork(arrays)
        sizes, wanted = (network.inputs, network.outputs), (len(card.inputs), card.action_size)
        require(sizes == wanted, "numbers of inputs and outputs", f"must be {wanted}, as its card states", sizes)
    return network, card, description


def read_description(folder: str | Path) -> dict[str, Any]:
    """Read the description in a checkpoint: the `Card`, as `card`, and what `save` stored beside it.

    Raises:
        ValueError: there is no checkpoint, it has another format, or it is damaged; the message names the file.
    """
    with _opened(folder) as (description, _):
        return description


def read_state(folder: str | Path) -> dict[str, np.ndarray]:
    """Read the arrays from which a training is resumed.

    Raises:
        ValueError: the checkpoint has none, or it is damaged.
    """
    with _opened(folder) as (description, file):
        return _arrays(file, description, "state")


def digests(folder: str | Path) -> dict[str, str]:
    """Return digests of the card and the weights, and those of the base, which identify a policy in a folder.

    Raises:
        ValueError: there is no checkpoint, or it is damaged.
    """
    with _opened(folder) as (description, _):
        card, weights = description["card"], description["sha256"]["weights"][:16]
        own = digest_of(json.dumps(vars(card), sort_keys=True).encode())
        base = {} if card.base is None else registry.fingerprint_of(registry.resolve(card.base))
        return {"card of the checkpoint": own, "weights of the checkpoint": weights} | base


@contextlib.contextmanager
def _opened(folder: str | Path) -> Iterator[tuple[dict[str, Any], Any]]:
    """Yield the description of a checkpoint and its opened file, which any error in the block names."""
    path = Path(folder) / FILE
    require(path.is_file(), "checkpoint", f"must be a folder with {FILE}", str(folder))
    os.close(open_plainly(path, os.O_RDONLY))  # raises for a link
    with undamaged(path, "checkpoint"), safe_open(path, "np") as file:
        description = parse_json((file.metadata() or {})[DESCRIPTION], "its description")
        require(description["format"] == FORMAT, "format", f"must be {FORMAT}", description["format"])
        yield description | {"card": Card(**description["card"])}, file


def _arrays(file: Any, description: Mapping[str, Any], part: str) -> dict[str, np.ndarray]:
    """Read the arrays of a part, `weights` or `state`, of an opened file."""
    stored, names, start = description["sha256"][part], file.keys(), f"{part}."
    arrays = {name.removeprefix(start): file.get_tensor(name) for name in names if name.startswith(start)}
    digest = _digest(arrays)
    require(stored == digest, f"SHA-256 of its {part}", f"must be {digest}", stored)
    return arrays


def _digest(arrays: Mapping[str, np.ndarray]) -> str:
    """Return the SHA-256 of arrays with their names, types and shapes."""
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.dtype} {array.shape}".encode() + array.tobytes())
    return digest.hexdigest()


def code_of(scenarios: Sequence[Scenario], policies: Sequence[str | None]) -> dict[str, dict[str, str]]:
    """Return what identifies this package, and the code of users that plays beside the network of a training."""
    package = {"lissajous-env": {"version": versions()["lissajous-env"]}}
    return package | registry.code_of(scenarios, {policy: registry.as_factory(policy) for policy in policies if policy})


@contextlib.contextmanager
def resuming(
    settings: Any, card: Card, code: Mapping[str, Any]
) -> Iterator[tuple[dict[str, Any], dict[str, np.ndarray]]]:
    """Yield the description and the arrays from which the caller resumes a training in its block.

    Args:
        settings: Settings of the training, with its folder `out`; those that `may_change` names may differ.
        card: Card of its policy, with its settings and scenario.
        code: What `code_of` returned, which `save` stored as `code`.

    Raises:
        ValueError: the settings, the scenario or the code differ, with all differences; or the block raises an error.
    """
    folder, description = settings.out, read_description(settings.out)
    stored, before = description["card"], description.get("code")
    differences = [
        f"{name} = {stored.settings.get(name)!r} there, {value!r} here"
        for name, value in card.settings.items()
        if name not in settings.may_change and stored.settings.get(name) != value
    ]
    if card.scenario_fields != stored.scenario_fields:
        differences.append("the scenario has changed")
    before = before if isinstance(before, Mapping) else {}
    differences += [f"the code of {name} has changed" for name in code if before.get(name) != code[name]]
    if differences:
        rule = "must be an empty folder or contain a training with the same settings and code"
        raise ValueError(f"out {rule}, got {folder}: {'; '.join(differences)}")
    arrays = read_state(folder)
    with undamaged(folder / FILE, "state of this training"):
        yield description, arrays


def scenario_of_card(card: Card) -> Scenario:
    """Return the scenario on which a policy was trained, from the values in its folder.

    A folder may come from anyone, so no module is imported because of it: the module of an extension must have been
    imported by the program.

    Raises:
        ValueError: the values are invalid, or the module of an extension has not been imported.
    """
    extensions = card.scenario_fields.get("extensions") or ()
    require(isinstance(extensions, (list, tuple)), "extensions of a scenario", "must be a list", extensions)
    return scenario_of_json(card.scenario_fields, [_extension_of(entry, card) for entry in extensions])


def _extension_of(entry: Any, card: Card) -> Extension:
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
