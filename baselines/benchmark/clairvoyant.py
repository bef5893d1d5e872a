"""A reference that sees every rogue from the moment it appears: how soon robots can find what they know of.

It is no policy, and no robot could run it: it is handed the simulation. In tables its name stands in brackets, below
a rule, and it is never the best. What it reaches is no bound either: each rogue is given to the nearest robot that is
free, one after the other, which is good and not optimal, and nobody avoids anybody.
"""

from typing import Any

import numpy as np
import warp as wp

from baselines.policies.driving import drive_to_goals, driving_of
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.structs import to_struct
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory.closed_forms import curve_point
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import PRESENT, WORKING

NAME = "clairvoyant"
KINDS = ("car", "curve")
"""Kinds of robots that it drives."""
_PLACES = 4096
"""Places of the curve that are looked at, and about as many where rogues may appear."""
_WITHIN = 0.95
"""Share of the sensing radius at which a robot is near enough."""


class Clairvoyant:
    """Robots that drive to the rogues; one without a rogue waits where it is near to where the next may appear.

    Args:
        scenario: What it is played on.
        num_worlds: W.
        device: Warp device of the simulation.

    Raises:
        ValueError: robots of a kind that it cannot drive.
    """

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu"):
        if scenario.robot.kind not in KINDS:
            raise ValueError(f"robot.kind must be one of {', '.join(KINDS)} for {NAME}, got {scenario.robot.kind}")
        self.name, self.num_worlds = NAME, num_worlds
        self.scenario = scenario.resolve()
        self._simulation: Simulation | None = None
        self._robot = to_struct(RobotStruct, self.scenario.robot)
        self._driving = driving_of(self.scenario)
        shape = num_worlds, self.scenario.num_robots
        self._goals = wp.zeros(shape, dtype=wp.vec2, device=device)
        self._action = wp.zeros((*shape, self.scenario.action_size), dtype=wp.float32, device=device)
        if scenario.robot.kind == "car":
            self._homes = waiting_places(self.scenario)
        self._gamma = np.linspace(0, 2 * np.pi, _PLACES, endpoint=False)
        self._curve = curve_point(self.scenario.curve, self._gamma)[:, :2]

    def watch(self, simulation: Simulation) -> None:
        """Take the simulation whose state it is to see."""
        self._simulation = simulation

    def reset(self, worlds: Any = None) -> None:
        """Forget nothing: all that it knows is the state of this moment."""

    def act(self, observation: Any) -> Any:
        """Actions (W, N, action_size) for the state of the simulation that it watches."""
        seen = self._simulation
        if seen is None:
            raise ValueError(f"{NAME} must watch a simulation before it acts")
        places = seen.robots.position.numpy()[:, :, :2].astype(float)
        works = seen.robots.status.numpy() == int(WORKING)
        rogues, there = seen.targets.position.numpy().astype(float), seen.targets.stage.numpy() == int(PRESENT)
        if not rogues.shape[1]:
            rogues, there = np.zeros((self.num_worlds, 1, 2)), np.zeros((self.num_worlds, 1), dtype=bool)
        way = np.linalg.norm(places[:, :, None] - rogues[:, None], axis=-1)
        chosen = assigned(np.where(works[:, :, None] & there[:, None], way, np.inf))
        goals = np.where(chosen[..., None] >= 0, np.take_along_axis(rogues, np.maximum(chosen, 0)[..., None], 1), 0)
        if self.scenario.robot.kind == "curve":
            return self._along_the_curve(goals, chosen >= 0, seen.robots.phase.numpy())
        self._goals.assign(np.where(chosen[..., None] >= 0, goals, self._waiting(places)).astype(np.float32))
        inputs = [self._robot, self._driving, _WITHIN * self.scenario.sensing_radius, self._goals, seen.robots]
        wp.launch(drive_to_goals, chosen.shape, inputs, [self._action], device=self._action.device)
        return self._action

    def _waiting(self, places: np.ndarray) -> np.ndarray:
        """Goals (W, N, 2) of cars that wait, each at the place that is nearest [m]."""
        chosen = assigned(np.linalg.norm(places[:, :, None] - self._homes, axis=-1))
        return self._homes[chosen]

    def _along_the_curve(self, goals: np.ndarray, has_goal: np.ndarray, phase: np.ndarray) -> np.ndarray:
        """Phase rates (W, N, 1) to the nearest place of the curve that has the goal in sight, or else comes nearest."""
        made = self.scenario
        rate_max = float(made.robot.phase_rate_max or 1.0)
        action = np.full((*phase.shape, 1), made.formation.phase_rate / made.alpha / rate_max, np.float32)
        for w, i in np.argwhere(has_goal):
            distance = np.hypot(*(self._curve - goals[w, i]).T)
            near = distance <= max(_WITHIN * made.sensing_radius, distance.min())
            ahead = np.angle(np.exp(1j * (self._gamma[near] - made.alpha * phase[w, i])))
            action[w, i] = ahead[np.abs(ahead).argmin()] / made.alpha / made.task.step / rate_max
        return np.clip(action, -1, 1)


def assigned(way: np.ndarray) -> np.ndarray:
    """Return the target assigned to each robot (W, N), -1 for none: repeatedly the nearest of the remaining pairs.

    Args:
        way: (W, N, T) from each robot to each rogue [m]; infinite where there is no rogue, or the robot is not free.
    """
    left, (robots, rogues) = way.copy(), way.shape[1:]
    chosen = np.full((len(way), robots), -1)
    for _ in range(min(robots, rogues)):
        flat = left.reshape(len(left), -1)
        pair = flat.argmin(axis=1)
        held = np.flatnonzero(np.isfinite(flat.min(axis=1)))
        if not len(held):
            break
        robot, rogue = pair[held] // rogues, pair[held] % rogues
        chosen[held, robot] = rogue
        left[held, robot] = np.inf
        left[held, :, rogue] = np.inf
    return chosen


def waiting_places(scenario: Scenario) -> np.ndarray:
    """Return places (N, 2) [m] with the least mean distance to where targets appear, by Lloyd's algorithm."""
    width, height = scenario.curve.half_width, scenario.curve.half_height
    if scenario.targets.entry == "boundary":
        ends = np.cumsum([0, 2 * width, 2 * height, 2 * width, 2 * height])
        along = np.linspace(0, ends[-1], _PLACES, endpoint=False)
        x = np.interp(along, ends, [-width, width, width, -width, -width])
        y = np.interp(along, ends, [-height, -height, height, height, -height])
    else:
        lines = round(_PLACES**0.5)
        x, y = np.meshgrid(np.linspace(-width, width, lines), np.linspace(-height, height, lines))
    entries, n = np.stack([x.ravel("F"), y.ravel("F")], axis=-1), scenario.num_robots
    homes = entries[(2 * np.arange(n) + 1) * len(entries) // (2 * n)]
    for _ in range(50):
        nearest = np.linalg.norm(entries[:, None] - homes, axis=-1).argmin(axis=1)
        homes = np.stack([entries[nearest == k].mean(axis=0) if (nearest == k).any() else homes[k] for k in range(n)])
    return homes
