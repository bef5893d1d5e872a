"""Rogues: rules by which an adversary moves the targets.

`targets.rogues` is the name of a script or of an included learned rogue, or the folder of a learned rogue.
"""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import warp as wp

from lissajous_env.plugins import ByValue, Registry
from lissajous_env.wording import few_of, require

AGENTS = "agents"
"""Value of `targets.rogues` where the caller of each step gives the rogues' actions."""
_SCRIPTS = "lissajous_env.world.rogues.scripted"
"""Module of the included scripts."""
CHECKPOINT = "checkpoint.safetensors"
"""File that marks the folder of a learned rogue."""


@dataclass(frozen=True)
class Rogue:
    """A scripted or learned rogue."""

    name: str
    """Name, as in `targets.rogues`."""
    decide: Any
    """Function `decide(rows)` that returns the actions (W, T, 2) for the rows (W, T, D) of
    `lissajous_env.world.rogues.acting`, as NumPy arrays; or a kernel that `@stage` makes of a function of a target and
    that writes `rogues.action`, see `lissajous_env.world.stages`."""
    about: str = ""
    """Description of its motion in one line."""

    def __reduce__(self) -> tuple:
        return Rogue, (self.name, ByValue(self.decide), self.about)


ROGUES = Registry(
    "rogue",
    (rf"(?!{AGENTS}$)[a-z][a-z0-9-]{{0,62}}", f"of small letters, digits and -, and not {AGENTS}"),
    lambda rogue: isinstance(rogue, Path) or getattr(rogue.decide, "func", rogue.decide).__module__ == _SCRIPTS,
)
"""Rogues by name, of included learned ones the folder; `lissajous_env.world.rogues` registers the included scripts."""
ROGUES.update({
    path.parent.name: path.parent
    for path in sorted(Path(__file__).resolve().parents[2].glob(f"training/rogues/*/{CHECKPOINT}"))
})  # fmt: skip


def rogue(name: str, about: str = "") -> Callable[[Any], Any]:
    """Return a decorator that adds a rule to those that `targets.rogues` can name, and returns the rule.

    Args:
        name: Name of the rogue.
        about: Description in one line; by default the first line of the rule's docstring.

    Raises:
        ValueError: the name is taken or invalid, or the rule is neither a function nor a Warp kernel, as `Rogue.decide`
            describes them. A cell of a notebook that is run again replaces its rogue.
    """

    def register(decide: Any) -> Any:
        decides = callable(decide) or isinstance(decide, wp.Kernel)
        require(decides, f"rogue {name}", "must decide by a function or a Warp kernel", decide)
        words = about or (getattr(decide, "__doc__", None) or "").strip().partition("\n")[0]
        ROGUES.add(Rogue(name, decide, words))
        return decide

    return register


_brought: set[str] = set()
"""Names of the rogues that copies of scenarios brought; a later copy may bring another one of the same name."""


class BringsRogues:
    """Part of a scenario: its copy in another process brings the rogues of the user, which that process lacks."""

    targets: Any

    def __getstate__(self) -> dict[str, Any]:
        rogue = ROGUES.get(self.targets.rogues)
        is_brought = isinstance(rogue, Rogue) and not isinstance(rogue.decide, wp.Kernel)
        return {"rogues": [rogue] if is_brought else []} | self.__dict__

    def __setstate__(self, state: dict[str, Any]) -> None:
        for rogue in state.pop("rogues", ()):
            if rogue.name not in ROGUES or rogue.name in _brought:
                ROGUES[rogue.name] = rogue
                _brought.add(rogue.name)
        self.__dict__.update(state)


def rogues() -> tuple[str, ...]:
    """Return the names of the rogues: the scripted ones, then the included learned ones."""
    return tuple(sorted(ROGUES, key=lambda name: isinstance(ROGUES[name], Path)))


def rogue_of(name: str) -> Rogue | None:
    """Return the rogue of a name, the learned one in a folder, or None for `agents`.

    Raises:
        ValueError: there is no such rogue, or the checkpoint in the folder is damaged or not of a rogue.
    """
    if name == AGENTS or isinstance(ROGUES.get(name), Rogue):
        return ROGUES.get(name)
    folder, known = folder_of(name), (AGENTS, *rogues())
    rule = f"must be one of {few_of(known, name)}, one that --import adds, or a folder with {CHECKPOINT}"
    require(folder is not None, "targets.rogues", rule, name, known)
    return importlib.import_module("training.learned.rogue").open_rogue(folder, name)


def folder_of(name: str) -> Path | None:
    """Return the folder of a learned rogue, included or not; None for another name."""
    if name in ROGUES:
        return ROGUES[name] if isinstance(ROGUES[name], Path) else None
    try:
        return Path(name) if Path(name, CHECKPOINT).is_file() else None
    except (OSError, ValueError):  # not a possible name of a file
        return None
