"""Folders of plans: the scenario and the policy of each, which commands play, the figures of all, and a picture."""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from baselines.planning.plans import Planned
from baselines.planning.playing import Episodes
from baselines.policies import stored
from lissajous_env.console.terminal import plain
from lissajous_env.parameters.scenario_file import as_toml
from lissajous_env.storage.folder import Folder

FIGURES, PICTURE = "plans.json", "plans.png"


def names(count: int) -> list[str]:
    """Return the names of the files of some plans in a folder."""
    inside = [f"{k}/{file}" for k in range(1, count + 1) for file in (stored.HOME, stored.FILE)]
    return [FIGURES, PICTURE, *inside]


def open_folder(path: Path) -> Folder:
    """Open a folder for plans, to test before the search whether it can be written to.

    Raises:
        ValueError: it cannot be written to, or a file of a user has the name of one of the plans.
    """
    return Folder(path, [FIGURES, PICTURE, *(f"{k}/" for k in range(1, 10))])


def write(folder: Folder, plans: Sequence[Planned], episodes: Episodes, picture: bytes) -> None:
    """Write plans as folders 1, 2 ..., their figures and the picture; remove the plans of an earlier call."""
    for name in folder.written:
        if "/" in name and not name.endswith("/"):
            folder.remove(name)
    for k, each in enumerate(plans, start=1):
        folder.make_folder(str(k))
        made = each.plan.named(f"{each.plan.scenario.name[:80]}-{k}")
        folder.write(f"{k}/{stored.HOME}", as_toml(made.scenario))
        folder.write(f"{k}/{stored.FILE}", stored.as_toml(each.plan.settings))
    folder.write(FIGURES, json.dumps(plain({"episodes": episodes, "plans": as_rows(plans)}), indent=2) + "\n")
    folder.write(PICTURE, picture)


def as_rows(plans: Sequence[Planned]) -> list[dict[str, Any]]:
    """Return plans with their figures and their score rows as plain values."""
    return [
        {
            "family": each.plan.family,
            "policy": each.plan.settings.policy,
            "about": each.plan.about,
            "robots": each.plan.scenario.num_robots,
            "figures": dataclasses.asdict(each.figures),
            "lower_bound": each.limit,
            "parameters": dict(each.plan.settings.parameters),
            "coordinator": dict(each.plan.settings.coordinator),
            "rows": each.rows,
            "failed_rows": each.failed_rows,
        }
        for each in plans
    ]
