"""The state of a batch of worlds as NumPy arrays, for what is written in Python."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

from lissajous_env.parameters.scenario import Scenario


class WorldView:
    """What a function of an extension is given: arrays over worlds, robots and targets, to be read.

    Attributes:
        scenario: The scenario, with every field filled in.
        clock, robots, links, targets, cells, latest, tally: The arrays of `lissajous_env.world.state`, by their names:
            `world.robots.position` is (W, N, 3).
        observation: (W, N, D).

    On the CPU they are the simulation's own memory, in which everything is of this very step. On a GPU they are copied
    when they are asked for.
    """

    def __init__(self, scenario: Scenario, structs: Mapping[str, Any], observation: Any):
        self.scenario = scenario
        self._observation = observation
        for name, struct in structs.items():
            setattr(self, name, _Arrays(struct) if not observation.device.is_cpu else _views(struct))

    @property
    def observation(self) -> Any:
        """(W, N, D) rows of the robots."""
        return self._observation.numpy()


class _Arrays:
    """Arrays of a struct on a GPU, copied when they are asked for."""

    def __init__(self, struct: Any):
        self._struct = struct

    def __getattr__(self, name: str) -> Any:
        return getattr(self._struct, name).numpy()


def _views(struct: Any) -> SimpleNamespace:
    return SimpleNamespace(**{name: getattr(struct, name).numpy() for name in struct._cls.vars})
