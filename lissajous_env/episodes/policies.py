"""The policies of `baselines` and `training`, for users of `lissajous_env` alone: also where their names are hidden.

`lissajous_env.siblings` says when that is.
"""

import os
from typing import Any

from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.siblings import import_ours

BASES = {
    "NumpyCoordinator": "NumpyCoordinator",
    "Policy": "Policy",
    "Rows": "Rows",
    "register_coordinator": "register_coordinator",
    "register_policy": "register",
    "with_tracker": "with_tracker",
}
"""What policies of one's own are made with: its name in `lissajous_env`, and in `baselines`."""


def policy(
    name: str | os.PathLike[str], scenario: str | os.PathLike[str] | Scenario, num_worlds: int = 1, device: Any = "cpu"
) -> Any:
    """Make a policy.

    Args:
        name: A name of `policies()`; the folder of a checkpoint; `module:factory`, also of the current folder; or the
            name that a module of the current folder registers.
        scenario: What it is played on: a name, a `.toml` file, `module:attribute`, or a `Scenario`.
        num_worlds: Worlds for which it acts together.
        device: Warp device.

    Returns:
        A `Policy`, or whatever with `reset` and `act` the factory returns.

    Raises:
        ValueError: there is no such policy or scenario, or the policy does not fit the scenario.
    """
    factories = import_ours("baselines.policies.factories")
    return factories.named(os.fspath(name))(named.scenario(scenario), num_worlds, device)


def policies(scenario: str | os.PathLike[str] | Scenario | None = None) -> tuple[str, ...]:
    """Names of the policies; with a scenario, of those that drive its robots."""
    return import_ours("baselines").names(scenario)


def load(
    name: str | os.PathLike[str],
    scenario: str | os.PathLike[str] | Scenario | None = None,
    num_worlds: int = 1,
    device: Any = "cpu",
) -> Any:
    """Make a learned policy of a shipped name or of a checkpoint's folder: `training.load`.

    By default it is made for the scenario that it was trained on.

    Raises:
        ValueError: no such name or folder, a damaged checkpoint, or a scenario that the policy does not fit.
    """
    return import_ours("training").load(name, scenario, num_worlds, device)


def base(name: str) -> Any:
    """Return what `lissajous_env.NAME` is for a name of `BASES`."""
    return getattr(import_ours("baselines"), BASES[name])
