"""The true state of each world, for critics that may see more than a robot does.

Of each robot x [half_width], y [half_height], cos and sin of its heading, its speed [top speed of a car; of a point in
the equilibrium], cos and sin of its phase, 1 where it works; of each target slot 1 where a target is present and
undetected, and its x [half_width], y [half_height], all 0 otherwise; then the share of the episode that is over.
"""

from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import PRESENT, WORKING

OF_ROBOT = ("x", "y", "cos_heading", "sin_heading", "speed", "cos_phase", "sin_phase", "works")
"""Columns of a robot."""
OF_TARGET = ("waiting", "x", "y")
"""Columns of a target slot."""


class TrueState(NamedTuple):
    """The true state of W worlds of N robots and T target slots: NumPy arrays or torch tensors of float32."""

    robots: Any
    """(W, N, 8) columns `OF_ROBOT`."""
    targets: Any
    """(W, T, 3) columns `OF_TARGET`."""
    elapsed: Any
    """(W, 1) share of the episode that is over."""


def state_names(scenario: str | Scenario) -> tuple[str, ...]:
    """Names of the S = 8 N + 3 T + 1 numbers of a world's state, in their order."""
    scenario = named.scenario(scenario)
    robots = [f"robot_{i}_{name}" for i in range(scenario.num_robots) for name in OF_ROBOT]
    targets = [f"target_{t}_{name}" for t in range(scenario.target_capacity) for name in OF_TARGET]
    return (*robots, *targets, "elapsed")


def state_rows(simulation: Simulation, library: Any = np) -> Any:
    """True state of every world in one row each, (W, S), in the order of `state_names`.

    Args:
        simulation: The worlds.
        library: `numpy`, or `torch` for a tensor on the simulation's device, which does not pass through the host.
    """
    worlds = simulation.num_worlds
    parts = [part.reshape(worlds, -1) for part in true_state(simulation, library)]
    return library.concatenate(parts, 1)


def true_state(simulation: Simulation, library: Any = np) -> TrueState:
    """Robots, targets and time of every world; `library` as for `state_rows`."""
    read = wp.array.numpy if library is np else wp.to_torch
    robots, targets, scenario = simulation.robots, simulation.targets, simulation.scenario

    def columns(*each: Any) -> Any:
        # The phase is kept in float64.
        return library.stack([library.asarray(column, dtype=library.float32) for column in each], -1)

    def place(position: Any) -> tuple[Any, Any]:
        return position[..., 0] / scenario.curve.half_width, position[..., 1] / scenario.curve.half_height

    heading, phase = read(robots.heading), read(robots.phase)
    of_robots = columns(
        *place(read(robots.position)),
        library.cos(heading),
        library.sin(heading),
        read(robots.speed) / simulation.speed_unit,
        library.cos(phase),
        library.sin(phase),
        read(robots.status) == WORKING,
    )
    waiting = read(targets.stage) == PRESENT
    of_targets = columns(waiting, *(waiting * coordinate for coordinate in place(read(targets.position))))
    elapsed = columns(read(simulation.clock.step) / scenario.task.steps)
    return TrueState(of_robots, of_targets, elapsed)
