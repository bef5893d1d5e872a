"""The state of a batch of worlds as NumPy arrays, for what is written in Python."""

from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np

from lissajous_env.device.warp_abi import fields_of
from lissajous_env.parameters.scenario import Scenario


def read_only(array: np.ndarray) -> np.ndarray:
    """Return a view of an array through which nothing can be written."""
    view = array.view()
    view.flags.writeable = False
    return view


class _Fixed:
    """An object whose attributes are set once, when it is made."""

    def __setattr__(self, name: str, value: Any) -> NoReturn:
        raise ValueError(f"{name} is read-only, and so are all arrays of a world")


class WorldView(_Fixed):
    """Argument of an extension's function: read-only arrays over worlds, robots and targets.

    Attributes:
        scenario: The scenario, with every field filled in.
        clock, robots, links, messages, targets, cells, latest, tally: The arrays of `lissajous_env.world.state`, by
            their names: `world.robots.position` is (W, N, 3). So is `rogues` where `targets.rogues` is set.
        observation: (W, N, D).

    On the CPU they are the simulation's own memory, in which everything is of this very step. On a GPU they are copied
    when they are read. To change one, copy it: `world.targets.position.copy()`.
    """

    scenario: Scenario
    _observation: Any

    def __init__(self, scenario: Scenario, structs: Mapping[str, Any], observation: Any):
        kind = _Views if observation.device.is_cpu else _Copies
        self.__dict__.update({"scenario": scenario, "_observation": observation})
        self.__dict__.update({name: kind(struct) for name, struct in structs.items()})

    @property
    def observation(self) -> Any:
        """(W, N, D) rows of the robots."""
        return read_only(self._observation.numpy())


class _Views(_Fixed):
    """Arrays of a struct on a CPU."""

    def __init__(self, struct: Any):
        self.__dict__.update({name: read_only(array.numpy()) for name, array in fields_of(struct).items()})


class _Copies(_Fixed):
    """Arrays of a struct on a GPU, copied when they are read."""

    def __init__(self, struct: Any):
        self.__dict__["_struct"] = struct

    def __getattr__(self, name: str) -> Any:
        return read_only(getattr(self._struct, name).numpy())
