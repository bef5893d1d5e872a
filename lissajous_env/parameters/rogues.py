"""Rogues: rules by which an adversary moves the targets.

`targets.rogues` is the name of a script or of an included learned rogue, or the folder of a learned rogue.
"""

import dataclasses
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import warp as wp

from lissajous_env.plugins import ByValue, Registry
from lissajous_env.wording import few_of, nearest, require, shown

AGENTS = "agents"
"""Value of `targets.rogues` where the caller of each step gives the rogues' actions."""


@dataclass(frozen=True)
class Rogue:
    """A scripted or learned rogue; after `lissajous_env.register_rogue`, `targets.rogues` can name it."""

    name: str
    """Name, as in `targets.rogues`."""
    decide: Any
    """Function `decide(rows)` that returns the actions (W, T, 2) for the rows (W, T, D) of
    `lissajous_env.world.rogues.acting`, as NumPy arrays; or a kernel that `@stage` makes of a function of a target and
    that writes `rogues.action`, see `lissajous_env.world.stages`."""
    about: str = ""
    """Description of its motion in one line."""
    trained_on: str = ""
    """Scenario on which a learned rogue was trained."""
    trained_against: str = ""
    """Policy of the robots against which a learned rogue was trained."""

    def __deepcopy__(self, memo: dict) -> "Rogue":
        return self

    def __reduce__(self) -> tuple:
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return Rogue, tuple((values | {"decide": ByValue(self.decide)}).values())


CHECKPOINT = "checkpoint.json"
"""File that marks the folder of a learned rogue."""
_SHIPPED = Path(__file__).resolve().parents[2] / "training" / "rogues"
"""Folder of the included learned rogues."""
ROGUES = Registry(
    "rogue",
    (r"[a-z][a-z0-9-]{0,62}", "of small letters, digits and -"),
    lambda rogue: rogue.name in ("wander", "flee", "shadow", "follow-gap"),
)
"""Registered rogues by name; the included ones register themselves in `lissajous_env.world.rogues`."""


def register_rogue(rogue: Rogue) -> Rogue:
    """Add a scripted rogue to those that `targets.rogues` can name, and return it.

    Raises:
        ValueError: the name is taken or invalid, or the rule is neither a function nor a Warp kernel. A cell of a
            notebook that is run again replaces its rogue.
    """
    require(isinstance(rogue, Rogue), "rogue", "must be a Rogue", rogue)
    decides = callable(rogue.decide) or isinstance(rogue.decide, wp.Kernel)
    require(decides, f"rogue {rogue.name}", "must decide by a function or a Warp kernel", rogue.decide)
    return ROGUES.add(rogue, taken=(AGENTS, *shipped_rogues()))


def rogue(name: str) -> Callable[[Callable[[Any], Any]], Callable[[Any], Any]]:
    """Return a decorator that registers a function `decide(rows)` as a scripted rogue, and returns the function."""

    def register(decide: Callable[[Any], Any]) -> Callable[[Any], Any]:
        register_rogue(Rogue(name, decide, (decide.__doc__ or "").strip().partition("\n")[0]))
        return decide

    return register


class BringsRogues:
    """Part of a scenario: its copy in another process brings the rogues of the user, which that process lacks."""

    targets: Any

    def __getstate__(self) -> dict[str, Any]:
        rogue = ROGUES.get(self.targets.rogues)
        is_brought = rogue is not None and not isinstance(rogue.decide, wp.Kernel)
        return {"rogues": [rogue] if is_brought else []} | self.__dict__

    def __setstate__(self, state: dict[str, Any]) -> None:
        for rogue in state.pop("rogues", ()):
            ROGUES.setdefault(rogue.name, rogue)
        self.__dict__.update(state)


def rogues() -> tuple[str, ...]:
    """Return the names of the rogues: the scripted ones, then the included learned ones."""
    return *ROGUES, *shipped_rogues()


def shipped_rogues() -> tuple[str, ...]:
    """Return the names of the included learned rogues."""
    return tuple(sorted(path.parent.name for path in _SHIPPED.glob(f"*/{CHECKPOINT}")))


def rogue_of(name: str) -> Rogue | None:
    """Return the rogue of a name, the learned one in a folder, or None for `agents`.

    Raises:
        ValueError: there is no such rogue, or the checkpoint in the folder is damaged or not of a rogue.
    """
    if name == AGENTS:
        return None
    if name in ROGUES:
        return ROGUES[name]
    if (folder := folder_of(name)) is not None:
        return importlib.import_module("training.learned.rogue").open_rogue(folder, name)
    known = (AGENTS, *rogues())
    rule = f"must be one of {few_of(known, name)}, or a folder with {CHECKPOINT}"
    raise ValueError(f"targets.rogues {rule}, got {shown(name)}{nearest(name, known)}")


def folder_of(name: str) -> Path | None:
    """Return the folder of a learned rogue, included or not; None for another name."""
    if name in shipped_rogues():
        return _SHIPPED / name
    try:
        return Path(name) if name not in ROGUES and Path(name, CHECKPOINT).is_file() else None
    except (OSError, ValueError):  # not a possible name of a file
        return None
