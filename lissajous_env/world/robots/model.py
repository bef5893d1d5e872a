"""Robot models: motion, actions and drawing of a kind of robots."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from lissajous_env.device.program import LANES
from lissajous_env.parameters.parts import Curve, Formation, Noise, Robot, Task


def _nothing_to_check(curve: Curve, formation: Formation, robot: Robot, noise: Noise, task: Task) -> None:
    pass


@dataclass(frozen=True)
class RobotModel:
    """A kind of robots; `lissajous_env.register_robot_model` makes it known by its name, for `robot.kind`."""

    name: str
    """Its name."""
    actions: tuple[str, ...]
    """Names of an action's components, each in [-1, 1]."""
    table: tuple[tuple[float, ...], ...]
    """(K, len(actions)) rows that a discrete action chooses from."""
    move: Any
    """Kernel that moves the robots over a step; its parameters are found by name, as `lissajous_env.world.stages` says.

    `command` (W, N, len(actions)) is the action, limited, with its noise. It writes position, heading and speed of
    `robots`, and the track through the step, `robots.track` (W, N, S + 1), from the old position to the new one. A
    robot that is not WORKING stands still.
    """
    speed_unit: Callable[[Curve, Formation, Robot], float]
    """Unit of observed speeds [m/s], such as the top speed."""
    meanings: tuple[str, ...] = ()
    """Meaning of each component from -1 to 1, with its unit; empty: the names alone."""
    rest: tuple[float, ...] | None = None
    """The action that brings a robot to rest; None is all zero."""
    check: Callable[[Curve, Formation, Robot, Noise, Task], None] = _nothing_to_check
    """Raises a ValueError with the name of a field that this model does not take."""
    shape: Callable[[Robot], list[tuple[np.ndarray, str | None]]] | None = None
    """Outlines (K, 2) of its parts for a radius of 1, heading right, the lowest first, each with the name of a colour
    in `lissajous_env.render.palette`, or None for the robot's own; without it, a disc with a tip ahead."""
    layout: str = LANES
    """Layout of the kernel, of `lissajous_env.device.program`."""
    keeps_to_curve: bool = False
    """True for robots that are always on the curve: `move` writes their phase, which else follows their position."""

    @property
    def action_size(self) -> int:
        """Components of an action."""
        return len(self.actions)
