"""Input of a central critic: the state of the whole world, computed by a kernel with one thread per world."""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env import Scenario, Simulation
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import compile_quietly
from lissajous_env.device.program import Program, Stage
from lissajous_env.device.trig import cos_sin
from lissajous_env.world.state import PRESENT, WORKING, Clock, Robots, Targets
from training.learned.card import CONSTANTS, constants_of, top_speed

wp.set_module_options(OPTIONS)

OF_ROBOT = 6
"""Number of values per robot."""
COLUMNS, ROWS = 12, 6
"""Columns and rows of the zones in which undetected targets are counted."""
MANY = 8.0
"""Number of targets that corresponds to a value of 1."""

_COLUMNS, _ROWS, _SHARE = wp.constant(COLUMNS), wp.constant(ROWS), wp.constant(1.0 / MANY)
_OF_ROBOT = wp.constant(OF_ROBOT)


@wp.func
def cell(position: float, half: float, cells: int) -> int:
    """Return the cell of [-half, half] that contains a position, clamped to the first and last."""
    place = int(wp.floor(0.5 * (position / half + 1.0) * float(cells)))
    return wp.clamp(place, 0, cells - 1)


@wp.kernel
def view_world(
    first: int,
    half_width: float,
    half_height: float,
    speed_unit: float,
    steps: float,
    common: int,
    shared: int,
    ahead: wp.array2d(dtype=int),
    wanted: wp.array(dtype=int),
    clock: Clock,
    robots: Robots,
    targets: Targets,
    view_out: wp.array3d(dtype=float),
):
    """Write for each robot the robots in the order of `ahead`, the time, and the undetected targets by zone."""
    w = first + wp.tid()
    if wanted[w] == 0:
        return
    n = ahead.shape[0]
    for k in range(common, shared):
        view_out[w, 0, k] = 0.0
    view_out[w, 0, common] = float(clock.step[w]) / steps
    for t in range(targets.stage.shape[1]):
        if targets.stage[w, t] == PRESENT:
            at = targets.position[w, t]
            zone = cell(at[0], half_width, _COLUMNS) * _ROWS + cell(at[1], half_height, _ROWS)
            view_out[w, 0, common + 1] += _SHARE
            view_out[w, 0, common + 2 + zone] += _SHARE
    for i in range(n):  # a robot comes first in its own row
        turn = cos_sin(robots.heading[w, i])
        view_out[w, i, 0] = robots.position[w, i][0] / half_width
        view_out[w, i, 1] = robots.position[w, i][1] / half_height
        view_out[w, i, 2] = turn[0]
        view_out[w, i, 3] = turn[1]
        view_out[w, i, 4] = robots.speed[w, i] / speed_unit
        view_out[w, i, 5] = wp.where(robots.status[w, i] == WORKING, 1.0, 0.0)
    for i in range(n):
        for j in range(1, n):
            for k in range(_OF_ROBOT):
                view_out[w, i, _OF_ROBOT * j + k] = view_out[w, ahead[i, j], k]
        if i > 0:
            for k in range(common, shared):
                view_out[w, i, k] = view_out[w, 0, k]


def task_numbers(scenario: Scenario) -> np.ndarray:
    """Return dimensionless numbers of a scenario's targets and faults, on which returns depend, as float32."""
    targets, faults, duration = scenario.targets, scenario.faults, scenario.task.duration
    entries = [float(targets.entry == each) for each in ("inside", "boundary", "unseen")]
    numbers = [targets.fleeing, targets.wandering, targets.speed / top_speed(scenario), targets.count / MANY]
    numbers += [targets.arrival_rate * duration / MANY, faults.rate * duration, float(faults.lost)]
    constants = constants_of(scenario, tuple(CONSTANTS))
    return np.concatenate([np.clip([*entries, *numbers], 0.0, 10.0), constants]).astype(np.float32)


class CriticView:
    """Rows that a central critic reads besides a robot's own inputs.

    For each robot in the order of the ring, itself first: x, y, cos and sin heading, speed, 1 if it works; then the
    elapsed fraction of the episode, the undetected targets, and those in each zone of the rectangle.

    Args:
        simulation: The worlds.
        places: Number of robots for which a row has room, at least N, and zeros where there are fewer, so that rows of
            scenarios with teams of different sizes are equally long; N by default. With it, the rows end in
            `task_numbers` of the scenario.
    """

    def __init__(self, simulation: Simulation, places: int | None = None):
        scenario, device = simulation.scenario, simulation.device
        self._made_of = simulation, places
        ring = np.array(scenario.ring)
        ahead = np.array([np.roll(ring, -int(np.flatnonzero(ring == i)[0])) for i in range(len(ring))])
        zones = COLUMNS * ROWS if scenario.target_capacity or places is not None else 0
        common = OF_ROBOT * (places or len(ring))
        numbers = np.zeros(0, dtype=np.float32) if places is None else task_numbers(scenario)
        self.size = common + 2 + zones + len(numbers)
        view = np.zeros((simulation.num_worlds, len(ring), self.size), dtype=np.float32)
        view[..., common + 2 + zones :] = numbers
        self._view = wp.array(view, device=device)
        self._wanted = wp.ones(simulation.num_worlds, dtype=wp.int32, device=device)
        values = {
            "half_width": float(scenario.curve.half_width),
            "half_height": float(scenario.curve.half_height),
            "speed_unit": float(simulation.speed_unit),
            "steps": float(scenario.task.steps),
            "common": common,
            "shared": common + 2 + zones,
            "ahead": wp.array(ahead, dtype=wp.int32, device=device),
            "wanted": self._wanted,
            "clock": simulation.clock,
            "robots": simulation.robots,
            "targets": simulation.targets,
            "view_out": self._view,
        }
        with compile_quietly():
            place = simulation.num_worlds, device, simulation.split
            self._show = Program([Stage("view", view_world)], values, {}, *place)

    def rows(self, worlds: np.ndarray | None = None) -> np.ndarray:
        """Return the rows (W N, size) of the current state; with a mask `worlds` (W,), other worlds are not updated."""
        if worlds is None:
            self._wanted.fill_(1)
        else:
            self._wanted.assign(worlds.astype(np.int32))
        self._show()
        return self._view.numpy().reshape(-1, self.size)

    def __getstate__(self) -> dict[str, Any]:
        return {"made_of": self._made_of, "view": self._view.numpy()}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(*saved["made_of"])
        self._view.assign(saved["view"])
