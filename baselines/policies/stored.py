"""A policy in a folder: its name and parameters in `policy.toml`, and the scenario that it was made for beside it.

    policy = "arc-mpcc"
    [parameters]
    weight_lateral = 0.02
    [coordinator]
    speed = 1.2

Such a folder is accepted wherever a policy is named, as that of a checkpoint is. Nothing in it is executed.
"""

import hashlib
import os
import tomllib
from pathlib import Path
from typing import Any

from baselines.policies import registry
from baselines.policies.base import Policy
from baselines.policies.settings import PolicySettings
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import toml_value
from lissajous_env.storage.files import read_bytes
from lissajous_env.wording import nearest

FILE = "policy.toml"
"""Name of the file with the policy."""
HOME = "scenario.toml"
"""Name of the file with the scenario."""
_TABLES = "parameters", "coordinator"
_LARGEST = 1 << 20
"""Largest size of the file [bytes]."""


def read(folder: str | os.PathLike[str]) -> PolicySettings:
    """Read the policy of a folder.

    Raises:
        ValueError: the file is missing, no plain TOML, or has an unknown entry; the message names it.
    """
    path = Path(folder) / FILE
    try:
        given = tomllib.loads(read_bytes(path, _LARGEST).decode())
    except RecursionError:
        raise ValueError(f"{path} must have fewer nested levels") from None
    except ValueError as error:
        raise ValueError(f"{path} must be a TOML file that can be read: {error}") from error
    known = {"policy": (str, "text")} | dict.fromkeys(_TABLES, (dict, "a table"))
    for key, value in given.items():
        if key not in known:
            raise ValueError(f"{path} must contain {', '.join(known)}, got {key!r}{nearest(key, known)}")
        kind, rule = known[key]
        if not isinstance(value, kind):
            raise ValueError(f"{path} must contain {key} as {rule}, got {type(value).__name__}")
    if "policy" not in given:
        raise ValueError(f"{path} must contain policy, the name of a policy, got {', '.join(given) or 'nothing'}")
    return PolicySettings(**given)


def as_toml(settings: PolicySettings) -> str:
    """Return the text of a policy's file."""
    lines = [f"policy = {toml_value('policy', settings.policy)}"]
    for table in _TABLES:
        values = getattr(settings, table)
        lines += ["", f"[{table}]"] if values else []
        lines += [f"{name} = {toml_value(f'{table}.{name}', value)}" for name, value in values.items()]
    return "\n".join(lines) + "\n"


def make(folder: str, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    """Make the policy of a folder.

    Raises:
        ValueError: the folder is invalid, or the policy does not fit the scenario; the message names the file.
    """
    settings = read(folder)
    try:
        policy = settings.make(scenario, num_worlds, device)
    except ValueError as error:
        raise ValueError(f"{Path(folder) / FILE}: {error}") from error
    policy.name = str(folder)
    return policy


def home(folder: str) -> Scenario:
    """Return the scenario that the policy of a folder was made for.

    Raises:
        ValueError: it is missing or invalid; the message names the file.
    """
    return named.build(str(Path(folder) / HOME))


def parts(folder: str) -> dict[str, str]:
    """Return a digest of the policy's file and the parts of the named policy, which identify a policy in results."""
    settings = read(folder)
    digest = hashlib.sha256(as_toml(settings).encode()).hexdigest()[:16]
    return {f"policy of {FILE}": digest} | registry.parts(settings.policy)


registry.register_opener(make, home, parts, FILE)
