"""Learned policies, with the same interface as the classical ones."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import baselines
from baselines.policies.base import Policy
from baselines.policies.registry import LOADERS, Loader
from lissajous_env import Scenario
from lissajous_env.wording import few_of
from training.learned import checkpoint
from training.learned.team_network import TeamNetwork
from training.learned.team_policy import LearnedTeam


def load(name: str | Path, scenario: str | Scenario | None = None, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    """Load an included network by name, or a checkpoint from its folder; by default for the scenario of its training.

    Raises:
        ValueError: there is no such name or folder, the checkpoint is damaged, or the policy does not fit the scenario.
    """
    network, card, _ = checkpoint.read(find(name))
    if not isinstance(network, TeamNetwork):
        raise ValueError(f"policy must drive robots, got {name}, which drives rogues")
    task = checkpoint.home_scenario(card) if scenario is None else scenario
    policy = LearnedTeam(network, card, task, num_worlds, device)
    policy.name = str(name)
    return policy


def home(name: str | Path) -> Scenario:
    """Return the scenario on which an included policy, or that in a folder, was trained.

    Raises:
        ValueError: there is no such name or folder, the checkpoint is damaged, or the scenario is invalid.
    """
    return checkpoint.home_scenario(checkpoint.read(find(name))[1])


def find(name: str | Path) -> Path:
    """Return the folder of an included policy, or the given folder if it contains a checkpoint.

    Raises:
        ValueError: it is neither.
    """
    shipped = _SHIPPED / str(name)
    if str(name) in names():
        return shipped
    if (Path(name) / checkpoint.FILE).is_file():
        return Path(name)
    raise ValueError(
        f"policy must be one of {few_of(names(), name) or 'none shipped'}, or a folder with {checkpoint.FILE}, "
        f"got {str(name)!r}"
    )


def register_shipped() -> None:
    """Register the included policies in `baselines`, which then also accepts the folder of a checkpoint as a name.

    Weights are read when a policy is made.
    """
    LOADERS[checkpoint.FILE] = Loader(load, home, checkpoint.parts)
    for name in names():
        text = json.loads((_SHIPPED / name / checkpoint.FILE).read_text(encoding="utf-8"))
        policy, scenario = text["policy"], text["settings"].get("scenario", text["policy"]["scenario"])
        about = f"Learned on {scenario}{', on top of ' + policy['base'] if policy['base'] else ''}."
        baselines.register(name, policy["kind"], partial(load, name), tuple(text["made_for"]), about, learned=True)


_SHIPPED = Path(__file__).parent.parent / "policies"


def names() -> tuple[str, ...]:
    """Return the names of the included policies whose actions a network computes."""
    return tuple(sorted(path.parent.name for path in _SHIPPED.glob(f"*/{checkpoint.FILE}")))
