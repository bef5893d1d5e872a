"""Steps of several simulations at once, side by side on the CPU's threads."""

from collections.abc import Sequence

from lissajous_env.device.devices import cores
from lissajous_env.device.work import SideBySide, Work
from lissajous_env.settings.checks import whole_number
from lissajous_env.world.simulation import Simulation


class Together:
    """Control steps of a fixed number of simulations, each by one CPU thread if there is one for each thread.

    Simulations that are fewer than the threads, on a GPU or with functions of the user's own take their steps one after
    another, and share the threads.

    Args:
        count: Number of simulations.
        threads: CPU threads; all cores by default.

    Attributes:
        threads: CPU threads that each simulation is to be made with.

    Raises:
        ValueError: the number of threads is below 1.
    """

    def __init__(self, count: int, threads: int | None = None):
        self._all = cores() if threads is None else whole_number("threads", threads)
        self.threads = 1 if count >= self._all else self._all
        self._works: list[Work | None] = []
        self._joined: SideBySide | None = None

    def advance(self, simulations: Sequence[Simulation]) -> None:
        """Advance all by one control step, with the actions that they have taken."""
        works = [each.stages.work for each in simulations]
        if works != self._works:
            self._works, known = works, [work for work in works if work is not None]
            self._joined = SideBySide(known, self._all) if self.threads == 1 and len(known) == len(works) else None
        if self._joined is not None:
            self._joined()
        else:
            for each in simulations:
                each.advance()
