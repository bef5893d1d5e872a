"""The true state of each world, for centralized critics.

It contains, for each robot, x [half_width], y [half_height], cos and sin of the heading, the speed [top speed of a car,
or of a point in the equilibrium], cos and sin of the phase, and 1 if it works; for each target slot, 1 if its target is
present and undetected, with x [half_width] and y [half_height], otherwise zeros; and the elapsed share of the episode.
If policies send messages, the numbers of a robot end with the message that it sends.
"""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import PRESENT, WORKING

_OF_ROBOT = ("x", "y", "cos_heading", "sin_heading", "speed", "cos_phase", "sin_phase", "works")
_OF_TARGET = ("waiting", "x", "y")


def state_names(scenario: str | Scenario) -> tuple[str, ...]:
    """Return the names of the S = (8 + k) N + 3 T + 1 numbers of a world's state, in order."""
    scenario = named.build(scenario)
    of_robot = (*_OF_ROBOT, *(f"message_{m}" for m in range(scenario.messages.size)))
    robots = [f"robot_{i}_{name}" for i in range(scenario.num_robots) for name in of_robot]
    targets = [f"target_{t}_{name}" for t in range(scenario.target_capacity) for name in _OF_TARGET]
    return (*robots, *targets, "elapsed")


def state_size(num_robots: int, num_targets: int, message_size: int = 0) -> int:
    """Return S = (8 + k) N + 3 T + 1, the number of numbers of a world's state."""
    return (len(_OF_ROBOT) + message_size) * num_robots + len(_OF_TARGET) * num_targets + 1


def state_rows(simulation: Simulation, library: Any = np, num_robots: int = 0, num_targets: int = 0) -> Any:
    """Return the true states as float32 rows (W, S), in the order of `state_names`.

    Args:
        simulation: The worlds.
        library: `numpy`, or `torch` for a tensor on the simulation's device, without a copy to the host.
        num_robots: Number of robots in a row; the numbers of those that the scenario does not have are 0.
        num_targets: Number of target slots in a row, likewise.
    """
    read = wp.array.numpy if library is np else wp.to_torch
    robots, targets, scenario = simulation.robots, simulation.targets, simulation.scenario

    def columns(places: int, *numbers: Any) -> Any:
        # The phase is float64.
        rows = library.stack([library.asarray(column, dtype=library.float32) for column in numbers], -1)
        more = [library.zeros_like(rows[:, :1])] * (places - rows.shape[1])
        return library.concatenate([rows, *more], 1).reshape(simulation.num_worlds, -1)

    def place(position: Any) -> tuple[Any, Any]:
        return position[..., 0] / scenario.curve.half_width, position[..., 1] / scenario.curve.half_height

    heading, phase = read(robots.heading), read(robots.phase)
    of_robots = columns(
        num_robots,
        *place(read(robots.position)),
        library.cos(heading),
        library.sin(heading),
        read(robots.speed) / simulation.speed_unit,
        library.cos(phase),
        library.sin(phase),
        read(robots.status) == WORKING,
        *(read(simulation.messages.sending)[..., m] for m in range(scenario.messages.size)),
    )
    waiting = read(targets.stage) == PRESENT
    position = place(read(targets.position))
    of_targets = columns(num_targets, waiting, *(waiting * coordinate for coordinate in position))
    elapsed = columns(1, (read(simulation.clock.step) / scenario.task.steps)[:, None])
    return library.concatenate([of_robots, of_targets, elapsed], 1)
