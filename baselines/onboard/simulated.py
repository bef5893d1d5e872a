"""Convert the measurements, messages and detections of a simulated robot to input of `Onboard`."""

from typing import NamedTuple

import numpy as np

from baselines.onboard.signals import Message, Odometry
from lissajous_env.settings.checks import whole_number
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import REMOVED, WORKING


class Inputs(NamedTuple):
    """Arguments of `Onboard.act`, in their order."""

    now: float
    odometry: Odometry
    heard: tuple[Message, ...]
    robots: np.ndarray
    targets: np.ndarray
    phase: tuple[float, float]
    works: bool


def inputs_of(simulation: Simulation, robot: int, world: int = 0) -> Inputs:
    """Return a simulated robot's present measurements, messages and detections, with times since the reset.

    `Onboard.act(*inputs_of(simulation, robot))` computes the policy's action in the simulation.

    Raises:
        ValueError: a robot or a world that is not there, or a robot that has been removed.
    """
    n, scenario = simulation.num_robots, simulation.scenario
    for name, value, count in (("robot", robot, n), ("world", world, simulation.num_worlds)):
        whole_number(name, value, 0, count - 1)
    state = simulation.robots
    status = state.status.numpy()[world]
    if status[robot] == int(REMOVED):
        raise ValueError(f"robot must not have been removed, got {robot}")
    faces, speeds = state.heading.numpy()[world], state.speed.numpy()[world]
    moves = np.column_stack([state.position.numpy()[world, :, :2], speeds * np.cos(faces), speeds * np.sin(faces)])
    others = moves - moves[robot]
    cos_phase, sin_phase = state.measured_turn.numpy()[world, robot, :2].tolist()
    x, y, heading, speed = state.measured.numpy()[world, robot].tolist()
    step = scenario.task.step
    now = int(simulation.clock.step.numpy()[world]) * step
    there = (np.arange(n) != robot) & (status != int(REMOVED)) & _is_near(others, scenario.sight)
    sighted = simulation.targets.in_sight.numpy()[world] == 1
    targets = simulation.targets.position.numpy()[world][sighted] - state.sensor.numpy()[world, robot]
    targets = targets[_is_near(targets, scenario.sight)]
    return Inputs(
        now,
        Odometry(x, y, heading, speed, now),
        _heard(simulation, robot, world),
        others[there],
        targets,
        (cos_phase, sin_phase),
        bool(status[robot] == int(WORKING)),
    )


def _is_near(away: np.ndarray, radius: float) -> np.ndarray:
    """Return whether places are in sight, within rounding; the row decides."""
    return np.hypot(away[:, 0], away[:, 1]) < radius * (1 + 1e-5)


def _heard(simulation: Simulation, robot: int, world: int) -> tuple[Message, ...]:
    links, messages, step = simulation.links, [], simulation.scenario.task.step
    heard, heard_at = links.heard.numpy()[world, robot], links.heard_at.numpy()[world, robot]
    for side, sender in enumerate(simulation.scenario.neighbours[robot].tolist()):
        if sender >= 0 and heard_at[side] >= 0:
            numbers = ()
            if simulation.scenario.messages.size:
                numbers = tuple(simulation.messages.heard.numpy()[world, robot, side].tolist())
            cos_phase, sin_phase, x, y = heard[side].tolist()
            messages.append(Message(sender, int(heard_at[side]) * step, cos_phase, sin_phase, x, y, numbers))
    return tuple(messages)
