"""Card of a learned policy: everything about it except its weights, validated at construction."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from baselines.policies import registry
from lissajous_env import Scenario
from lissajous_env.console.terminal import plain
from lissajous_env.wording import require

ROGUE = "rogue"
"""`Card.kind` of a rogue, which drives no robots."""


@dataclass(frozen=True)
class Card:
    """Description of a learned policy: its training, inputs, outputs and base.

    Raises:
        ValueError: a value has another type or violates a rule.
    """

    scenario: str
    """Name of the scenario of the training."""
    kind: str
    """Kind of robot that the policy drives; `velocity` if its actions are velocities of cars; or `rogue`."""
    inputs: tuple[str, ...]
    """Names of the entries of a rogue's row that its network reads, in order; empty for robots."""
    action_size: int
    """Number of components of a robot's action."""
    scenario_fields: Mapping[str, Any]
    """Scenario of the training as plain values of `Scenario.to_dict`, including derived fields."""
    base: str | None = None
    """Name of the classical policy whose action the network reads and corrects; None if the output is the action."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the training."""

    def __post_init__(self) -> None:
        for name in ("scenario", "kind"):
            value = getattr(self, name)
            require(isinstance(value, str) and value.isprintable() and len(value) < 100, name, "must be a word", value)
        words = isinstance(self.inputs, (list, tuple)) and all(isinstance(name, str) for name in self.inputs)
        require(words and len(set(self.inputs)) == len(self.inputs), "inputs", "must be words, each once", self.inputs)
        object.__setattr__(self, "inputs", tuple(self.inputs))
        for name in ("settings", "scenario_fields"):
            value = getattr(self, name)
            require(isinstance(value, Mapping), name, "must be a mapping", value)
        size = self.action_size
        require(type(size) is int and size >= 1, "action_size", "must be a whole number of at least 1", size)
        # A learned policy as a base could have this policy as its own base.
        base = self.base
        known = base is None or (isinstance(base, str) and registry.is_classical(base))
        require(known, "base", "must be a registered classical policy, one that --import adds, or none", base)

    @classmethod
    def of(cls, scenario: Scenario, **more: Any) -> "Card":
        """Return the card of a policy that is trained on a scenario; by default, it drives the robots."""
        fields = {"scenario": scenario.name, "scenario_fields": plain(scenario.resolve().to_dict())}
        robots = {"kind": scenario.actuation, "inputs": (), "action_size": scenario.action_size}
        return cls(**fields | robots | more)

    def check(self, scenario: Scenario) -> None:
        """Check that the policy can play a scenario; one without messages also plays a scenario with messages.

        Raises:
            ValueError: the robots or the actions of the scenario do not fit the policy.
        """
        if scenario.actuation != self.kind:
            raise ValueError(
                f"policy trained on {self.scenario} must drive robots of kind {self.kind}, "
                f"got {scenario.name}, with robots of kind {scenario.robot.kind}"
            )
        robot = self.scenario_fields.get("robot")
        reverses = isinstance(robot, Mapping) and (robot.get("speed_min") or 0.0) < 0.0
        rule = f"must be {'below 0' if reverses else '0'} for the policy trained on {self.scenario} [m/s]"
        require(scenario.robot.reverses == reverses, "robot.speed_min", rule, scenario.robot.lowest_speed)
        size = scenario.action_size
        fits = self.action_size in (size, size - scenario.messages.size)
        require(fits, "action_size", f"must be {size} for {scenario.name}", self.action_size)
