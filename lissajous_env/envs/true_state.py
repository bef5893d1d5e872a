"""The true state of each world, for centralized critics.

It contains, for each robot, x [half_width], y [half_height], cos and sin of the heading, the speed [top speed of a car,
or of a point in the equilibrium], cos and sin of the phase, and 1 if it works; for each target slot, 1 if its target is
present and undetected, with x [half_width] and y [half_height], otherwise zeros; and the elapsed share of the episode.
If policies send messages, the numbers of a robot end with the message that it sends.
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
    """(W, N, 8 + k) columns `OF_ROBOT`, and the k numbers of the robot's message."""
    targets: Any
    """(W, T, 3) columns `OF_TARGET`."""
    elapsed: Any
    """(W, 1) elapsed share of the episode."""


def state_names(scenario: str | Scenario) -> tuple[str, ...]:
    """Return the names of the S = (8 + k) N + 3 T + 1 numbers of a world's state, in order."""
    scenario = named.build(scenario)
    of_robot = (*OF_ROBOT, *(f"message_{m}" for m in range(scenario.messages.size)))
    robots = [f"robot_{i}_{name}" for i in range(scenario.num_robots) for name in of_robot]
    targets = [f"target_{t}_{name}" for t in range(scenario.target_capacity) for name in OF_TARGET]
    return (*robots, *targets, "elapsed")


def state_rows(simulation: Simulation, library: Any = np) -> Any:
    """Return the true states as rows (W, S), in the order of `state_names`.

    Args:
        simulation: The worlds.
        library: `numpy`, or `torch` for a tensor on the simulation's device, without a copy to the host.
    """
    worlds = simulation.num_worlds
    parts = [part.reshape(worlds, -1) for part in true_state(simulation, library)]
    return library.concatenate(parts, 1)


def state_size(num_robots: int, num_targets: int, message_size: int = 0) -> int:
    """Return S = (8 + k) N + 3 T + 1, the number of numbers of a world's state."""
    return (len(OF_ROBOT) + message_size) * num_robots + len(OF_TARGET) * num_targets + 1


def padded_rows(simulation: Simulation, num_robots: int, num_targets: int, library: Any = np) -> Any:
    """Return the true states as rows (W, S) for more robots and target slots than there are, whose numbers are 0.

    `library` is as for `state_rows`.
    """
    robots, targets, elapsed = true_state(simulation, library)
    parts = (robots, num_robots), (targets, num_targets)
    padded = [library.concatenate([of, *[library.zeros_like(of[:, :1])] * (n - of.shape[1])], 1) for of, n in parts]
    return library.concatenate([*(of.reshape(simulation.num_worlds, -1) for of in padded), elapsed], 1)


def true_state(simulation: Simulation, library: Any = np) -> TrueState:
    """Return robots, targets and time of every world; `library` as for `state_rows`."""
    read = wp.array.numpy if library is np else wp.to_torch
    robots, targets, scenario = simulation.robots, simulation.targets, simulation.scenario

    def columns(*each: Any) -> Any:
        # The phase is float64.
        return library.stack([library.asarray(column, dtype=library.float32) for column in each], -1)

    def place(position: Any) -> tuple[Any, Any]:
        return position[..., 0] / scenario.curve.half_width, position[..., 1] / scenario.curve.half_height

    heading, phase = read(robots.heading), read(robots.phase)
    messages = [read(simulation.messages.sending)[..., m] for m in range(scenario.messages.size)]
    of_robots = columns(
        *place(read(robots.position)),
        library.cos(heading),
        library.sin(heading),
        read(robots.speed) / simulation.speed_unit,
        library.cos(phase),
        library.sin(phase),
        read(robots.status) == WORKING,
        *messages,
    )
    waiting = read(targets.stage) == PRESENT
    of_targets = columns(waiting, *(waiting * coordinate for coordinate in place(read(targets.position))))
    elapsed = columns(read(simulation.clock.step) / scenario.task.steps)
    return TrueState(of_robots, of_targets, elapsed)
