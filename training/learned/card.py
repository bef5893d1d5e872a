"""The card of a learned policy: what it is, apart from its weights; checked once, when it is made or read."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from baselines.policies import registry
from lissajous_env import Scenario
from lissajous_env import scenario as make_scenario
from lissajous_env.console.terminal import plain
from lissajous_env.world.observation import layout

LARGEST_RESIDUAL = 2.0
"""With it, the network alone can choose any action, whatever the base's is."""


@dataclass(frozen=True)
class Card:
    """What a policy is, apart from its weights: what it was trained on, what it reads, what it adds to.

    Raises:
        ValueError: a value of another type, or one that a rule forbids; the message says which.
    """

    scenario: str
    """Name of the scenario that it was trained on."""
    kind: str
    """Kind of robot that it drives."""
    inputs: tuple[str, ...]
    """Entries of the observation that the network reads, by name and in this order."""
    action_size: int
    """Components of a robot's action."""
    base: str | None = None
    """Name of the classical policy whose action the network's output is added to; None: the output is the action.

    The network reads the base's action too, after `inputs`.
    """
    residual: float = 1.0
    """What the network's output, clipped to [-1, 1], is multiplied with before it is added to the base's action."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """How it was trained."""
    home: Mapping[str, Any] | None = None
    """The scenario that it was trained on as plain values, as `Scenario.to_dict` returns them with every derived field
    filled in; None: the registered one of that name."""

    def __post_init__(self) -> None:
        for name in ("scenario", "kind"):
            value = getattr(self, name)
            require(name, isinstance(value, str) and value.isprintable() and len(value) < 100, "must be a word", value)
        words = isinstance(self.inputs, tuple) and all(isinstance(name, str) for name in self.inputs)
        require("inputs", words and len(set(self.inputs)) == len(self.inputs), "must be words, each once", self.inputs)
        size = self.action_size
        require("action_size", type(size) is int and size >= 1, "must be a whole number of at least 1", size)
        # A folder or a learned policy could have a base itself, and that be this very policy.
        base = self.base
        known = base is None or (isinstance(base, str) and registry.is_classical(base))
        require("base", known, "must be a registered classical policy, or none", base)
        number = type(self.residual) in (int, float) and math.isfinite(self.residual)
        require("residual", number and 0 <= self.residual <= LARGEST_RESIDUAL, "must be from 0 to 2", self.residual)
        require("settings", isinstance(self.settings, Mapping), "must be an object", self.settings)
        overrides = self.settings.get("overrides", {})
        require("overrides", isinstance(overrides, Mapping), "must be an object", overrides)
        require("scenario", self.home is None or isinstance(self.home, Mapping), "must be an object", self.home)

    @classmethod
    def of(cls, scenario: str | Scenario, inputs: tuple[str, ...] = (), **more: Any) -> "Card":
        """Make the card of a policy for a scenario that reads `inputs`; by default the whole observation."""
        scenario = make_scenario(scenario)
        names = inputs or layout(scenario).names
        home = plain(scenario.resolve().to_dict())
        return cls(scenario.name, scenario.robot.kind, tuple(names), scenario.action_size, home=home, **more)

    @classmethod
    def from_dict(
        cls, policy: Mapping[str, Any], settings: Mapping[str, Any], home: Mapping[str, Any] | None = None
    ) -> "Card":
        """Make the card that `to_dict` wrote.

        Raises:
            ValueError: an entry is missing or wrong.
        """
        names = ("scenario", "kind", "inputs", "action_size", "base", "residual")
        for name in names:
            require("policy", name in policy, f"must hold {name}", list(policy))
        values: dict[str, Any] = {name: policy[name] for name in names}
        if isinstance(values["inputs"], list):
            values["inputs"] = tuple(values["inputs"])
        return cls(**values, settings=settings, home=home)

    def to_dict(self) -> dict[str, Any]:
        """Plain values of all but the settings and the scenario."""
        return {name: getattr(self, name) for name in ("scenario", "kind", "inputs", "action_size", "base", "residual")}

    @property
    def network_inputs(self) -> int:
        """Entries that the network takes."""
        return len(self.inputs) + (self.action_size if self.base else 0)

    @property
    def overrides(self) -> Mapping[str, Any]:
        """Fields of the scenario that were changed for the training."""
        return self.settings.get("overrides", {})

    def columns(self, scenario: Scenario) -> np.ndarray:
        """Where `inputs` stand in the observation of a scenario.

        Raises:
            ValueError: the scenario's robots or observation do not fit the policy; the message says how.
        """
        if scenario.robot.kind != self.kind:
            raise ValueError(
                f"policy trained on {self.scenario} must drive robots of kind {self.kind}, "
                f"got {scenario.name}, whose robots are of kind {scenario.robot.kind}"
            )
        size = scenario.action_size
        require("action_size", size == self.action_size, f"must be {size} for {scenario.name}", self.action_size)
        names = layout(scenario).names
        missing = [name for name in self.inputs if name not in names]
        if missing:
            sizes = f"{scenario.sensing.robots_seen} robots and {scenario.sensing.targets_seen} targets"
            raise ValueError(
                f"observation of {scenario.name} must hold {len(self.inputs)} entries that the policy trained on "
                f"{self.scenario} reads; it lists {sizes} and lacks {', '.join(missing[:4])}"
                f"{f' and {len(missing) - 4} more' if len(missing) > 4 else ''}"
            )
        return np.array([names.index(name) for name in self.inputs])


def require(name: str, holds: Any, rule: str, got: Any) -> None:
    """Raise ValueError with name, rule and value where a rule does not hold."""
    if not holds:
        raise ValueError(f"{name} {rule}, got {repr(got)[:60]}")
