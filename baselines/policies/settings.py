"""Policies with parameters by name: the settings of a registered policy, and the policy that they make.

The parameters of a policy are the fields of the dataclass `Parameters` of its class. A coordinator over a tracker has
two: `parameters` are the tracker's, `coordinator` are the coordinator's. Omitted parameters have their defaults, which
a dataclass with a method `of(scenario, **overrides)` scales to the scenario.

A folder with such settings in `policy.toml`, and the scenario that they were made for beside it in `scenario.toml`, is
accepted wherever a policy is named, like the folder of a checkpoint. Nothing in it is executed.

    policy = "arc-mpcc"
    [parameters]
    weight_lateral = 0.02
    [coordinator]
    speed = 1.2
"""

import dataclasses
import inspect
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from baselines.policies import registry
from baselines.policies.base import Policy, parameters_for
from baselines.policies.trackers import Coordinated
from lissajous_env.identity import digest_of
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import check_keys, read_toml, toml_value
from lissajous_env.wording import few_of, require

ARGUMENT = "parameters"
"""Name of the argument for the parameters of a policy or of a coordinator."""
POLICY_FILE = "policy.toml"
"""Name of the file with the settings in a folder."""
SCENARIO_FILE = "scenario.toml"
"""Name of the file with the scenario in a folder."""
_TABLES = ARGUMENT, "coordinator"
_LARGEST = 1 << 20
"""Largest size of the file [bytes]."""


@dataclass(frozen=True)
class PolicySettings:
    """The settings of a registered policy."""

    policy: str
    """Name of the policy, with the suffix of a filter if there is one."""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    """Parameters of the policy, or of its tracker."""
    coordinator: Mapping[str, Any] = field(default_factory=dict)
    """Parameters of its coordinator."""

    def make(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu") -> Policy:
        """Make the policy.

        Raises:
            ValueError: an unknown policy, one that does not fit the scenario, or an unknown or invalid parameter.
        """
        entry = registry.resolve(self.policy)
        factory = entry.factory
        if self.coordinator:
            tracker: Any = factory.func if isinstance(factory, partial) else None
            rule = f"must be empty for {self.policy}, which has none"
            require(inspect.isclass(tracker) and issubclass(tracker, Coordinated), _TABLES[1], rule, self.coordinator)
            coordinator, *others = factory.args
            coordinator = _with_parameters(self.policy, _TABLES[1], coordinator, self.coordinator, scenario)
            factory = partial(tracker, coordinator, *others, **factory.keywords)
        if self.parameters:
            factory = _with_parameters(self.policy, ARGUMENT, factory, self.parameters, scenario)
        return dataclasses.replace(entry, factory=factory)(scenario, num_worlds, device)

    @classmethod
    def read(cls, folder: str | os.PathLike[str]) -> "PolicySettings":
        """Read the settings in a folder.

        Raises:
            ValueError: the file is missing, no TOML, has an unknown entry or names a folder; the message names it.
        """
        path = Path(folder) / POLICY_FILE
        given = read_toml(str(path), _LARGEST)
        try:
            check_keys(given, {"policy": str} | dict.fromkeys(_TABLES, dict))
            if "policy" not in given:
                raise ValueError("file must contain policy, the name of a policy")
            name = given["policy"]
            require(not registry.is_folder(name), "policy", "must be a name, and not a folder", name)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error
        return cls(**given)

    def as_toml(self) -> str:
        """Return the text of the file."""
        lines = [f"policy = {toml_value('policy', self.policy)}"]
        for table in _TABLES:
            values = getattr(self, table)
            lines += ["", f"[{table}]"] if values else []
            lines += [f"{name} = {toml_value(f'{table}.{name}', value)}" for name, value in values.items()]
        return "\n".join(lines) + "\n"


def _with_parameters(policy: str, table: str, factory: Any, given: Mapping[str, Any], scenario: Scenario) -> partial:
    """Return a factory with the parameters of a table; the others are its own, or those of its class for a scenario.

    Raises:
        ValueError: the factory has none, or a parameter is unknown or invalid.
    """
    function, before = (factory.func, factory.keywords) if isinstance(factory, partial) else (factory, {})
    kind = getattr(function, "Parameters", None)
    if kind is None:
        raise ValueError(f"{table} must be empty for {policy}, which has none, got {few_of(given)}")
    known = [field.name for field in dataclasses.fields(kind)]
    for name in given:
        require(name in known, f"{table} of {policy}", f"must be of {few_of(known, name)}", name, known)
    own = before.get(ARGUMENT)
    parameters = parameters_for(kind, scenario, **given) if own is None else dataclasses.replace(own, **given)
    return partial(factory, **{ARGUMENT: parameters})


def _make(folder: str, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    """Make the policy of a folder.

    Raises:
        ValueError: the folder is invalid, or the policy does not fit the scenario; the message names the file.
    """
    settings = PolicySettings.read(folder)
    try:
        policy = settings.make(scenario, num_worlds, device)
    except ValueError as error:
        raise ValueError(f"{Path(folder) / POLICY_FILE}: {error}") from error
    policy.name = str(folder)
    return policy


def _fingerprint(folder: str) -> dict[str, str]:
    """Return a digest of the policy's file and the fingerprint of the named policy."""
    settings = PolicySettings.read(folder)
    own = {f"policy of {POLICY_FILE}": digest_of(settings.as_toml().encode())}
    return own | registry.fingerprint_of(registry.resolve(settings.policy))


registry.LOADERS[POLICY_FILE] = registry.Loader(
    _make, lambda folder: named.build(str(Path(folder) / SCENARIO_FILE)), _fingerprint
)
