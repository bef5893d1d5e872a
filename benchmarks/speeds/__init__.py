"""The parts of `benchmarks/speed.py`: one module for each thing whose speed is measured."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

from figures import Table
from warp import is_cuda_available

from lissajous_env.device.devices import as_device


@dataclass(frozen=True)
class Options:
    """Settings of all parts."""

    rounds: int
    """Number of rounds in which the sides take turns."""
    worlds: int
    """Number of worlds of a batch."""
    threads: int
    """Number of threads of a batch, and of one large world."""
    against: Path | None = None
    """Another checkout of this project, or None."""
    rivals: bool = True
    """True if alternatives are measured too."""
    quick: bool = False
    """True for a trial of the commands, with sizes so small that the figures mean nothing."""
    store: bool = False
    """True if a part saves its pictures in docs/."""
    robots: tuple[int, ...] = ()
    """Numbers of robots of the part `growth`; empty for all."""
    targets: tuple[int, ...] = ()
    """Numbers of targets of the part `growth`; empty for all."""


@dataclass(frozen=True)
class Part:
    """One thing whose speed is measured."""

    name: str
    """Name on the command line."""
    what: str
    """Description in one line."""
    tables: Callable[[Options], dict[str, Table]]
    """Function that measures and returns the tables by their names in docs/figures.json."""
    rounds: int = 15
    """Default number of rounds."""
    needs: Mapping[str, str] = field(default_factory=dict)
    """Libraries that the part requires, each with the extra that installs it."""
    rivals: Mapping[str, str] = field(default_factory=dict)
    """Libraries that are alternatives, each with the extra that installs it."""
    against: bool = False
    """True if the part is compared with another checkout."""
    gpu: bool = False
    """True if the part needs a CUDA device."""

    def missing(self, options: Options) -> str | None:
        """Return in words what must be installed or passed; None if the part can be measured."""
        asked = self.needs | self.rivals if options.rivals else self.needs
        absent = [library for library in asked if find_spec(library) is None]
        rival_alone = all(library in self.rivals for library in absent)
        ways = []
        if absent:
            extras = ",".join(sorted({asked[library] for library in absent}))
            ways.append(f'pip install ".[{extras}]" for {" and ".join(absent)}')
        if self.against and options.rivals and options.against is None:
            ways.append("pass --against FOLDER with another checkout")
        as_device("cpu")  # starts Warp in silence
        if self.gpu and not is_cuda_available():
            return "it needs a CUDA device"
        if not ways:
            return None
        return f"{' and '.join(ways)}{', or pass --without-rivals' if rival_alone else ''}"
