"""Access to the policies of `baselines` and `training` from `lissajous_env`, which import it, on demand."""

import os
from importlib import import_module
from typing import Any

from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario

BASES = {
    "NumpyCoordinator": "NumpyCoordinator",
    "Policy": "Policy",
    "Rows": "Rows",
    "register_coordinator": "register_coordinator",
    "register_policy": "register",
    "with_tracker": "with_tracker",
}
"""Base classes and functions for custom policies: name in `lissajous_env`, and in `baselines`."""


def policy(
    name: str | os.PathLike[str], scenario: str | os.PathLike[str] | Scenario, num_worlds: int = 1, device: Any = "cpu"
) -> Any:
    """Make a policy.

    Args:
        name: A name of `policies()`; the folder of a checkpoint; `module:factory`, also of the current folder; or the
            name that a module of the current folder registers.
        scenario: The scenario: a name, a `.toml` file, `module:attribute`, or a `Scenario`.
        num_worlds: Number of worlds for which it acts together.
        device: Warp device.

    Returns:
        A `Policy`, or the object with `reset` and `act` that the factory returns.

    Raises:
        ValueError: the policy or the scenario is unknown, or they do not fit.
    """
    factories = import_module("baselines.policies.factories")
    return factories.named(os.fspath(name))(named.build(scenario), num_worlds, device)


def policies(scenario: str | os.PathLike[str] | Scenario | None = None) -> tuple[str, ...]:
    """Return the names of the policies, or of those that can drive the robots of a scenario."""
    return import_module("baselines").names(scenario)


def load(
    name: str | os.PathLike[str],
    scenario: str | os.PathLike[str] | Scenario | None = None,
    num_worlds: int = 1,
    device: Any = "cpu",
) -> Any:
    """Make a learned policy from an included name or the folder of a checkpoint, by `training.load`.

    The default scenario is the one on which it was trained.

    Raises:
        ValueError: the name or folder is unknown, the checkpoint is damaged, or the scenario does not fit.
    """
    return import_module("training").load(name, scenario, num_worlds, device)


def base(name: str) -> Any:
    """Return the object `lissajous_env.NAME` for a name of `BASES`."""
    return getattr(import_module("baselines"), BASES[name])
