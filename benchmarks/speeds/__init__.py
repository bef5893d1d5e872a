"""The parts of `benchmarks/speed.py`: one module for each thing whose speed is measured."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

from figures import Table


@dataclass(frozen=True)
class Options:
    """What is asked of every part."""

    rounds: int
    """How often the sides take turns."""
    worlds: int
    """Worlds of a batch."""
    threads: int
    """Threads of a batch, and of one large world."""
    against: Path | None = None
    """Another checkout of this project, or None."""
    rivals: bool = True
    """Whether others are measured too."""
    quick: bool = False
    """Whether everything is so small that the figures say nothing: to try the commands."""
    store: bool = False
    """Whether a part keeps its pictures in docs/."""


@dataclass(frozen=True)
class Part:
    """One thing whose speed is measured."""

    name: str
    """What it is called on the command line."""
    what: str
    """What is measured beside what, in one line."""
    tables: Callable[[Options], dict[str, Table]]
    """Measures, and returns the tables by their names in docs/figures.json."""
    rounds: int = 15
    """Rounds where none are asked for."""
    needs: Mapping[str, str] = field(default_factory=dict)
    """Libraries without which nothing can be measured, each with the extra that brings it."""
    rivals: Mapping[str, str] = field(default_factory=dict)
    """Libraries that are rivals, each with the extra that brings it."""
    against: bool = False
    """Whether the rival is another checkout."""

    def missing(self, options: Options) -> str | None:
        """What to install or to pass, in words; None where the part can be measured."""
        asked = self.needs | self.rivals if options.rivals else self.needs
        absent = [library for library in asked if find_spec(library) is None]
        rival_alone = all(library in self.rivals for library in absent)
        ways = []
        if absent:
            extras = ",".join(sorted({asked[library] for library in absent}))
            ways.append(f'pip install ".[{extras}]" for {" and ".join(absent)}')
        if self.against and options.rivals and options.against is None:
            ways.append("pass --against FOLDER with another checkout")
        if not ways:
            return None
        return f"{' and '.join(ways)}{', or pass --without-rivals' if rival_alone else ''}"
