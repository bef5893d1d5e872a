"""What a critic sees of a whole world: one kernel, a world to a thread."""

# Warp reads these types, not Python.
# pyright: reportInvalidTypeForm=false, reportCallIssue=false, reportArgumentType=false, reportOperatorIssue=false
# pyright: reportGeneralTypeIssues=false, reportAssignmentType=false, reportIndexIssue=false

import numpy as np
import warp as wp

from lissajous_env import Simulation
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import compile_quietly
from lissajous_env.device.program import launcher
from lissajous_env.world.state import PRESENT, WORKING

wp.set_module_options(OPTIONS)

OF_ROBOT = 6
"""Numbers of a robot."""
COLUMNS, ROWS = 12, 6
"""Columns and rows in which undetected targets are counted."""
MANY = 8.0
"""Targets that count as one."""

_COLUMNS, _ROWS, _SHARE = wp.constant(COLUMNS), wp.constant(ROWS), wp.constant(1.0 / MANY)
_OF_ROBOT = wp.constant(OF_ROBOT)


@wp.func
def cell(position: float, half: float, cells: int) -> int:
    """Cell of [-half, half] that a position is in; beyond its ends, the first or the last."""
    place = int(wp.floor(0.5 * (position / half + 1.0) * float(cells)))
    return wp.clamp(place, 0, cells - 1)


@wp.kernel
def view_world(
    half_width: float,
    half_height: float,
    speed_unit: float,
    steps: float,
    ahead: wp.array2d(dtype=int),
    position: wp.array2d(dtype=wp.vec3),
    heading: wp.array2d(dtype=float),
    speed: wp.array2d(dtype=float),
    status: wp.array2d(dtype=int),
    stage: wp.array2d(dtype=int),
    place: wp.array2d(dtype=wp.vec2),
    step: wp.array(dtype=int),
    view_out: wp.array3d(dtype=float),
):
    """Robots in the order of `ahead`, time, and undetected targets of all and by zone, as each robot is shown them."""
    w = wp.tid()
    n = ahead.shape[0]
    first = _OF_ROBOT * n
    for k in range(first, view_out.shape[2]):
        view_out[w, 0, k] = 0.0
    view_out[w, 0, first] = float(step[w]) / steps
    for t in range(stage.shape[1]):
        if stage[w, t] == PRESENT:
            at = place[w, t]
            zone = cell(at[0], half_width, _COLUMNS) * _ROWS + cell(at[1], half_height, _ROWS)
            view_out[w, 0, first + 1] += _SHARE
            view_out[w, 0, first + 2 + zone] += _SHARE
    for i in range(n):
        for k in range(first, view_out.shape[2]):
            view_out[w, i, k] = view_out[w, 0, k]
        for j in range(n):
            other = ahead[i, j]
            column = _OF_ROBOT * j
            view_out[w, i, column] = position[w, other][0] / half_width
            view_out[w, i, column + 1] = position[w, other][1] / half_height
            view_out[w, i, column + 2] = wp.cos(heading[w, other])
            view_out[w, i, column + 3] = wp.sin(heading[w, other])
            view_out[w, i, column + 4] = speed[w, other] / speed_unit
            view_out[w, i, column + 5] = wp.where(status[w, other] == WORKING, 1.0, 0.0)


class WorldView:
    """Rows of what a central critic sees besides a robot's own inputs.

    Of each robot in the order of the ring, itself first: x, y, cos and sin heading, speed, whether it works; then the
    share of the episode that is over, the undetected targets, and those in each zone of the rectangle.
    """

    def __init__(self, simulation: Simulation):
        scenario, device = simulation.scenario, simulation.device
        ring = np.array(scenario.ring)
        ahead = np.array([np.roll(ring, -int(np.flatnonzero(ring == i)[0])) for i in range(len(ring))])
        zones = COLUMNS * ROWS if scenario.target_capacity else 0
        self.size = OF_ROBOT * len(ring) + 2 + zones
        self._view = wp.zeros((simulation.num_worlds, len(ring), self.size), dtype=wp.float32, device=device)
        robots, targets = simulation.robots, simulation.targets
        self._inputs = [
            float(scenario.curve.half_width), float(scenario.curve.half_height), float(simulation.speed_unit),
            float(scenario.task.steps), wp.array(ahead, dtype=wp.int32, device=device), robots.position, robots.heading,
            robots.speed, robots.status, targets.stage, targets.position, simulation.clock.step,
        ]  # fmt: skip
        self._launch, self._worlds = launcher(device), simulation.num_worlds
        with compile_quietly():
            self.rows()

    def rows(self) -> np.ndarray:
        """(W N, size) what the critic sees of the worlds as they are."""
        self._launch(view_world, self._worlds, self._inputs, [self._view])
        return self._view.numpy().reshape(-1, self.size)
