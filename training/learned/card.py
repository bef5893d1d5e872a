"""Card of a learned policy: its description without the weights, validated at construction."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from baselines.policies import registry
from baselines.policies.base import Policy
from baselines.policies.settings import PolicySettings
from baselines.similarity import motion_scale
from lissajous_env import Scenario
from lissajous_env.console.terminal import plain
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario_file import scenario_of
from lissajous_env.world.observation import layout

LARGEST_RESIDUAL = 2.0
"""Residual with which the network can choose any action, whatever the base's is."""
LARGEST_CONSTANT = 4.0
"""Limit of each of the `CONSTANTS`."""


def top_speed(scenario: Scenario) -> float:
    """Return the top speed of a car, or that of a point in the equilibrium [m/s]."""
    model = model_of(scenario.robot.kind)
    return model.speed_unit(scenario.driven, scenario.formation, scenario.robot)


CONSTANTS: dict[str, Callable[[Scenario], float]] = {
    "team": lambda scenario: 3.0 / scenario.num_robots,
    "sensing_x": lambda scenario: scenario.sensing_radius / scenario.curve.half_width,
    "sensing_y": lambda scenario: scenario.sensing_radius / scenario.curve.half_height,
    "body": lambda scenario: scenario.robot.radius / scenario.sensing_radius,
    "boundary": lambda scenario: float(scenario.targets.entry == "boundary"),
    "pace": lambda scenario: top_speed(scenario) * scenario.task.step / scenario.sensing_radius,
}
"""Dimensionless numbers of a scenario that do not change during an episode, by name.

An observation is in units of the scenario: a relative position is divided by the rectangle for a ring neighbour, and by
the sensing radius for a robot that is sensed. A policy for many scenarios also reads these ratios of the units: 3 over
the number of robots; the sensing radius in half-widths and half-heights of the rectangle; the robots' radius in sensing
radii; 1 where targets enter at the boundary, on which the loop of `sweep` depends, too; the distance driven in a
control step at top speed, in sensing radii."""


def constants_of(scenario: Scenario, names: tuple[str, ...]) -> np.ndarray:
    """Return the numbers (C,) of a scenario by name, at most `LARGEST_CONSTANT`, as float32."""
    values = [min(CONSTANTS[name](scenario), LARGEST_CONSTANT) for name in names]
    return np.array(values, dtype=np.float32)


@dataclass(frozen=True)
class Card:
    """Description of a policy without its weights: scenario, inputs and base.

    Raises:
        ValueError: a value has another type or violates a rule.
    """

    scenario: str
    """Name of the scenario of the training."""
    kind: str
    """Kind of robot."""
    inputs: tuple[str, ...]
    """Names of the observation's entries that the network reads, in order."""
    action_size: int
    """Number of components of a robot's action."""
    home: Mapping[str, Any]
    """Scenario of the training as plain values of `Scenario.to_dict`, including derived fields."""
    base: str | None = None
    """Name of the classical policy to whose action the network's output is added; None: the output is the action.

    The network also reads the base's action, after `inputs` and `constants`.
    """
    base_parameters: Mapping[str, float] = field(default_factory=dict)
    """Parameters of the base that are not its defaults, by name."""
    residual: float = 1.0
    """Factor of the network's output, clipped to [-1, 1], before it is added to the base's action."""
    constants: tuple[str, ...] = ()
    """Names of the scenario's numbers (`CONSTANTS`) that the network reads after `inputs`."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the training."""

    def __post_init__(self) -> None:
        for name in ("scenario", "kind"):
            value = getattr(self, name)
            require(name, isinstance(value, str) and value.isprintable() and len(value) < 100, "must be a word", value)
        words = isinstance(self.inputs, tuple) and all(isinstance(name, str) for name in self.inputs)
        require("inputs", words and len(set(self.inputs)) == len(self.inputs), "must be words, each once", self.inputs)
        size = self.action_size
        require("action_size", type(size) is int and size >= 1, "must be a whole number of at least 1", size)
        # A folder or a learned policy could have this very policy as its base.
        base = self.base
        known = base is None or (isinstance(base, str) and registry.is_classical(base))
        require("base", known, "must be a registered classical policy, or none", base)
        given = self.base_parameters
        numbers = isinstance(given, Mapping) and all(type(value) in (int, float) for value in given.values())
        require("base_parameters", numbers, "must be numbers by name", given)
        require("base_parameters", base is not None or not given, "must be empty without a base", given)
        known = isinstance(self.constants, tuple) and all(name in CONSTANTS for name in self.constants)
        once = known and len(set(self.constants)) == len(self.constants)
        require("constants", once, f"must be some of {', '.join(CONSTANTS)}, each once", self.constants)
        number = type(self.residual) in (int, float) and math.isfinite(self.residual)
        require("residual", number and 0 <= self.residual <= LARGEST_RESIDUAL, "must be from 0 to 2", self.residual)
        require("settings", isinstance(self.settings, Mapping), "must be an object", self.settings)

    @classmethod
    def of(cls, scenario: Scenario, inputs: tuple[str, ...] = (), **more: Any) -> "Card":
        """Return the card of a policy for a scenario that reads `inputs`, by default the whole observation."""
        names = inputs or layout(scenario).names
        home = plain(scenario.resolve().to_dict())
        return cls(scenario.name, scenario.actuation, tuple(names), scenario.action_size, home, **more)

    @classmethod
    def from_dict(cls, policy: Mapping[str, Any], settings: Mapping[str, Any], home: Mapping[str, Any]) -> "Card":
        """Return the card that `to_dict` converted.

        Raises:
            ValueError: an entry is missing or invalid.
        """
        names = ("scenario", "kind", "inputs", "action_size", "base", "residual")
        for name in names:
            require("policy", name in policy, f"must contain {name}", list(policy))
        values: dict[str, Any] = {name: policy[name] for name in names}
        values["constants"], values["base_parameters"] = policy.get("constants", ()), policy.get("base_parameters", {})
        for name in ("inputs", "constants"):
            if isinstance(values[name], list):
                values[name] = tuple(values[name])
        return cls(**values, settings=settings, home=home)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values of all fields but the settings and the scenario."""
        names = ("scenario", "kind", "inputs", "action_size", "base", "residual")
        more = ("constants", "base_parameters")
        given = {name: getattr(self, name) for name in more if getattr(self, name)}
        return {name: getattr(self, name) for name in names} | given

    def make_base(self, scenario: Scenario, num_worlds: int, device: Any) -> Policy | None:
        """Make the base, or return None if there is none.

        Its parameters are scaled from the scenario of the training to this one, by the lengths and times of the motion.

        Raises:
            ValueError: the base does not fit the scenario, or has no such parameter.
        """
        if self.base is None:
            return None
        settings = PolicySettings(self.base, self.base_parameters)
        if self.base_parameters:
            home, here = motion_scale(scenario_of(self.home)), motion_scale(scenario)
            settings = settings.scaled(here.length / home.length, here.time / home.time)
        return settings.make(scenario, num_worlds, device)

    @property
    def network_inputs(self) -> int:
        """Number of inputs of the network."""
        return len(self.inputs) + len(self.constants) + (self.action_size if self.base and self.inputs else 0)

    def columns(self, scenario: Scenario, or_silent: bool = False) -> np.ndarray:
        """Return the indices of `inputs` in the observation of a scenario.

        Args:
            scenario: The scenario.
            or_silent: True to accept a policy without messages for a scenario with messages.

        Raises:
            ValueError: the robots or observation of the scenario do not fit the policy.
        """
        if scenario.actuation != self.kind:
            raise ValueError(
                f"policy trained on {self.scenario} must drive robots of kind {self.kind}, "
                f"got {scenario.name}, with robots of kind {scenario.robot.kind}"
            )
        robot = self.home.get("robot")
        reverses = isinstance(robot, Mapping) and (robot.get("speed_min") or 0.0) < 0.0
        if scenario.robot.reverses != reverses:
            rule = f"must be {'below 0' if reverses else '0'} for the policy trained on {self.scenario}"
            raise ValueError(f"robot.speed_min {rule} [m/s], got {scenario.robot.lowest_speed:g}")
        size = scenario.action_size
        silent = or_silent and self.action_size == size - scenario.messages.size
        fits = silent or self.action_size == size
        require("action_size", fits, f"must be {size} for {scenario.name}", self.action_size)
        names = layout(scenario).names
        missing = [name for name in self.inputs if name not in names]
        if missing:
            sizes = f"{scenario.sensing.robots_seen} robots and {scenario.sensing.targets_seen} targets"
            raise ValueError(
                f"observation of {scenario.name} must contain {len(self.inputs)} entries that the policy trained on "
                f"{self.scenario} reads; it lists {sizes} and lacks {', '.join(missing[:4])}"
                f"{f' and {len(missing) - 4} more' if len(missing) > 4 else ''}"
            )
        return np.array([names.index(name) for name in self.inputs])


def require(name: str, holds: Any, rule: str, got: Any) -> None:
    """Raise ValueError with name, rule and value if a rule is violated."""
    if not holds:
        raise ValueError(f"{name} {rule}, got {repr(got)[:60]}")
