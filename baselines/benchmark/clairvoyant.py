"""A reference that knows every target from the moment it appears, for comparison with policies that must search.

It reads the state of the simulation, so no robot could run it. Tables show its name in brackets, below a rule, and
never mark it as best. Its scores are no bounds: each target is assigned to the nearest free robot in turn, which is
not optimal, and robots do not avoid each other.
"""

from typing import Any

import numpy as np
import warp as wp

from baselines.policies.driving import drive_to_goals, driving_of
from lissajous_env.device.devices import compile_quietly
from lissajous_env.device.part_structs import RobotStruct
from lissajous_env.device.structs import to_struct
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory.closed_forms import curve_point
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import PRESENT, WORKING

NAME = "clairvoyant"
KINDS = ("car", "curve")
"""Robot kinds that it drives."""
_PLACES = 4096
"""Number of places of the curve, and about that of places where targets may appear."""
_WITHIN = 0.95
"""Share of the sensing radius within which a robot counts as arrived."""


class Clairvoyant:
    """Robots that drive to the targets; a robot without one waits near to where the next may appear.

    Args:
        scenario: the scenario.
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
        self._curve = curve_point(self.scenario.driven, self._gamma)[:, :2]

    def watch(self, simulation: Simulation) -> None:
        """Set the simulation whose state it reads."""
        self._simulation = simulation

    def reset(self, worlds: Any = None) -> None:
        """Forget nothing: it reads only the state of this moment."""

    def act(self, observation: Any) -> Any:
        """Return the actions (W, N, action_size) for the state of the simulation that it observes."""
        seen = self._simulation
        if seen is None:
            raise ValueError(f"{NAME} must watch a simulation before it acts")
        places = seen.robots.position.numpy()[:, :, :2].astype(float)
        works = seen.robots.status.numpy() == int(WORKING)
        targets, there = seen.targets.position.numpy().astype(float), seen.targets.stage.numpy() == int(PRESENT)
        if not targets.shape[1]:
            targets, there = np.zeros((self.num_worlds, 1, 2)), np.zeros((self.num_worlds, 1), dtype=bool)
        distance = np.linalg.norm(places[:, :, None] - targets[:, None], axis=-1)
        chosen = assigned(np.where(works[:, :, None] & there[:, None], distance, np.inf))
        goals = np.where(chosen[..., None] >= 0, np.take_along_axis(targets, np.maximum(chosen, 0)[..., None], 1), 0)
        if self.scenario.robot.kind == "curve":
            return self._along_the_curve(goals, chosen >= 0, seen.robots.phase.numpy())
        self._goals.assign(np.where(chosen[..., None] >= 0, goals, self._waiting(places)).astype(np.float32))
        inputs = [self._robot, self._driving, _WITHIN * self.scenario.sensing_radius, self._goals, seen.robots]
        with compile_quietly():
            wp.launch(drive_to_goals, chosen.shape, inputs, [self._action], device=self._action.device)
        return self._action

    def _waiting(self, places: np.ndarray) -> np.ndarray:
        """Return the goals (W, N, 2) of waiting cars, for each the nearest place to wait [m]."""
        chosen = assigned(np.linalg.norm(places[:, :, None] - self._homes, axis=-1))
        return self._homes[chosen]

    def _along_the_curve(self, goals: np.ndarray, has_goal: np.ndarray, phase: np.ndarray) -> np.ndarray:
        """Return phase rates (W, N, 1) to the nearest place of the curve with the goal in sight, or closest to it."""
        made = self.scenario
        rate_max = float(made.robot.phase_rate_max or 1.0)
        action = np.full((*phase.shape, 1), made.formation.phase_rate / made.alpha / rate_max, np.float32)
        for w, i in np.argwhere(has_goal):
            distance = np.hypot(*(self._curve - goals[w, i]).T)
            near = distance <= max(_WITHIN * made.sensing_radius, distance.min())
            ahead = np.angle(np.exp(1j * (self._gamma[near] - made.alpha * phase[w, i])))
            action[w, i] = ahead[np.abs(ahead).argmin()] / made.alpha / made.task.step / rate_max
        return np.clip(action, -1, 1)


def assigned(distance: np.ndarray) -> np.ndarray:
    """Return the target assigned to each robot (W, N), -1 for none: repeatedly the nearest of the remaining pairs.

    Args:
        distance: (W, N, T) from each robot to each target [m]; infinite without a target or a free robot.
    """
    left, (robots, targets) = distance.copy(), distance.shape[1:]
    chosen = np.full((len(distance), robots), -1)
    for _ in range(min(robots, targets)):
        flat = left.reshape(len(left), -1)
        pair = flat.argmin(axis=1)
        held = np.flatnonzero(np.isfinite(flat.min(axis=1)))
        if not len(held):
            break
        robot, target = pair[held] // targets, pair[held] % targets
        chosen[held, robot] = target
        left[held, robot] = np.inf
        left[held, :, target] = np.inf
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
