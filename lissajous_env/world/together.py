"""Control steps of several simulations at the same time."""

from collections.abc import Sequence
from typing import Any

from lissajous_env.device.devices import cores
from lissajous_env.device.work import Work
from lissajous_env.settings.checks import whole_number
from lissajous_env.world.simulation import Simulation


class Together:
    """Control steps of a fixed number of simulations, in parallel on CPU threads.

    If there are at least as many simulations as threads, one thread steps each of them. Otherwise, on a GPU, and with
    functions of the user's own, the simulations are stepped one after another, and the threads share each step.

    Args:
        count: Number of simulations.
        threads: CPU threads; all cores by default.

    Attributes:
        threads: Number of CPU threads with which each simulation must be created.

    Raises:
        ValueError: the number of threads is below 1.
    """

    def __init__(self, count: int, threads: int | None = None):
        self._all = cores() if threads is None else whole_number("threads", threads)
        self.threads = 1 if count >= self._all else self._all
        self._works: list[Work | None] = []
        self._joined: Work | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the joined work, which contains addresses; it is made anew by the next step."""
        return self.__dict__ | {"_works": [], "_joined": None}

    def advance(self, simulations: Sequence[Simulation]) -> None:
        """Advance all simulations by one control step, with the actions that were stored by `take`."""
        works = [each.stages.work for each in simulations]
        if works != self._works:
            self._works, known = works, [work for work in works if work is not None]
            joined = self.threads == 1 and len(known) == len(works)
            tasks = [[launch for task in work.tasks for launch in task] for work in known]
            self._joined = Work(tasks, simulations[0].device, self._all) if joined else None
        if self._joined is not None:
            self._joined()
        else:
            for each in simulations:
                each.advance()
