"""Patrols among which a network chooses: policies with parameters that are relative to the scenario."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from baselines.policies.patrol_path import SweepParameters, corner_radius, lookahead
from baselines.policies.settings import PolicySettings
from baselines.similarity import motion_scale
from lissajous_env import Scenario
from lissajous_env.settings.checks import is_finite
from lissajous_env.wording import shown


def _top_speed(scenario: Scenario, cruise: float) -> float:
    return scenario.robot.top_speed


def _sensing_radius(scenario: Scenario, cruise: float) -> float:
    return scenario.sensing_radius


UNITS: dict[str, Callable[[Scenario, float], float]] = {
    "cruise": _top_speed,
    "speed": _top_speed,
    "slowest": _top_speed,
    "inset": _sensing_radius,
    "bow": _sensing_radius,
    "corner": corner_radius,
    "lookahead": lambda made, cruise: lookahead(made, cruise, SweepParameters()),
    "gather": lambda made, cruise: motion_scale(made).time,
}
"""Units of parameters by name, from a scenario and the patrol's speed [m/s]: the top speed, the sensing radius, the
default of the parameter, or the time of the motion. Other parameters are used as they are."""


@dataclass(frozen=True)
class Candidate:
    """A policy with some of its parameters, in the units `UNITS`.

    Raises:
        ValueError: the policy is not a name, or a parameter is neither a number nor a bool.
    """

    policy: str
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.policy, str):
            raise ValueError(f"policy of a candidate must be a name, got {shown(self.policy)}")
        if not isinstance(self.parameters, Mapping):
            raise ValueError(f"parameters of {self.policy} must be an object, got {shown(self.parameters)}")
        for name, value in self.parameters.items():
            if not is_finite(value) and not isinstance(value, bool):
                raise ValueError(f"{name} of {self.policy} must be a finite number or a bool, got {shown(value)}")

    @property
    def name(self) -> str:
        """Name for tables, such as `sweep-safe(cruise=0.9)`."""
        given = ", ".join(f"{name}={value}" for name, value in self.parameters.items())
        return f"{self.policy}({given})" if given else self.policy

    def settings(self, scenario: Scenario) -> PolicySettings:
        """Return the policy and its parameters in the units of a scenario."""
        cruise = self.parameters.get("cruise", 1.0) * scenario.robot.top_speed
        made = {
            name: value * UNITS[name](scenario, cruise) if name in UNITS else value
            for name, value in self.parameters.items()
        }
        return PolicySettings(self.policy, made)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, from which `Candidate` is made again."""
        return {"policy": self.policy, "parameters": dict(self.parameters)}


_ALONG = {"slowest": 0.15, "gather": 1.3}
"""Parameters of `sweep` with which cars drive to their places along the loop."""

PATROLS = (
    Candidate("sweep-safe", {"cruise": 0.93, "inset": 0.37, "lookahead": 0.6}),
    Candidate("sweep-safe", {"cruise": 0.9, "inset": 0.52, "gather": 5.0, "bow": 0.09}),
    Candidate("sweep-safe", {"cruise": 0.86, "inset": 0.48, "slowest": 0.2, "gather": 1.3, "bow": 0.3,
                             "lookahead": 0.8}),
    Candidate("sweep-safe", {"cruise": 0.86, "inset": 0.32, "slowest": 0.45, "gather": 1.3, "corner": 1.6}),
    Candidate("sweep-safe", {"cruise": 0.97, "inset": 0.47, "slowest": 0.2, "gather": 5.0, "bow": 0.32}),
    Candidate("sweep-safe", {"cruise": 0.8, **_ALONG}),
    Candidate("sweep-safe", {"cruise": 0.9, **_ALONG}),
    Candidate("sweep-proved", {"cruise": 0.93, "inset": 0.37, "lookahead": 0.6}),
    Candidate("laps-safe", {"cruise": 0.97, "inset": 0.4}),
    Candidate("laps-proved", {"cruise": 0.97}),
    Candidate("partition-safe", {"speed": 0.9}),
    Candidate("partition-proved", {"speed": 0.98}),
    Candidate("partition", {"speed": 0.98, "extent_x": 0.45, "extent_y": 0.15, "in_phase": True}),
    Candidate("partition-repair-safe", {"speed": 0.98}),
    Candidate("line-abreast"),
)  # fmt: skip
"""Candidates for a short detection time: those that a greedy choice adds to each other among 80 that were played on 44
scenarios of `monitoring-v1:train`, most of them with random parameters, and a partition that robots repair."""

PROVED = (
    Candidate("sweep-proved", {"cruise": 0.93, "inset": 0.37, "lookahead": 0.6}),
    Candidate("sweep-proved", {"cruise": 0.9, "inset": 0.52, "gather": 5.0, "bow": 0.09}),
    Candidate("sweep-proved", {"cruise": 0.86, "inset": 0.48, "slowest": 0.2, "gather": 1.3, "bow": 0.3,
                               "lookahead": 0.8}),
    Candidate("sweep-proved", {"cruise": 0.86, "inset": 0.32, "slowest": 0.45, "gather": 1.3, "corner": 1.6}),
    Candidate("sweep-proved", {"cruise": 0.86, "inset": 0.3, "slowest": 0.45, "gather": 2.6, "lookahead": 1.5}),
    Candidate("sweep-proved", {"cruise": 0.8, **_ALONG}),
    Candidate("sweep-proved", {"cruise": 0.9, **_ALONG}),
    Candidate("laps-proved", {"cruise": 0.7}),
    Candidate("partition-proved", {"speed": 0.98, "in_phase": True}),
    Candidate("partition-proved", {"speed": 0.98, "extent_x": 0.3, "extent_y": 0.3}),
    Candidate("partition-repair-proved", {"speed": 0.98}),
)  # fmt: skip
"""Candidates for a short detection time with the proved collision filter, selected in the same way among 33 on 36
scenarios."""

GUARDS = (
    Candidate("line-abreast"),
    Candidate("line-abreast", {"lines": 1, "speed": 0.7}),
    Candidate("line-abreast", {"lines": 1, "speed": 0.85}),
    Candidate("line-abreast", {"lines": 2, "speed": 0.97}),
    Candidate("line-abreast-safe"),
    Candidate("line-abreast-safe", {"lines": 1, "speed": 0.9}),
    Candidate("line-abreast-proved"),
    Candidate("line-abreast-proved", {"lines": 1, "speed": 0.85}),
    Candidate("sweep-safe", {"cruise": 0.89, "inset": 0.44, "slowest": 0.1, "gather": 2.6}),
    Candidate("sweep-safe", {"cruise": 0.91, "inset": 0.19, "slowest": 0.2, "gather": 2.6}),
    Candidate("sweep-proved", {"cruise": 0.86, "inset": 0.32, "slowest": 0.45, "gather": 1.3, "corner": 1.6}),
    Candidate("sweep-proved", {"cruise": 0.86, "inset": 0.3, "slowest": 0.45, "gather": 2.6, "lookahead": 1.5}),
    Candidate("partition", {"speed": 0.89, "extent_y": 0.6}),
    Candidate("partition-safe", {"speed": 0.7}),
    Candidate("partition-safe", {"speed": 0.98}),
    Candidate("partition-proved", {"speed": 0.7}),
    Candidate("partition-proved", {"speed": 0.98}),
    Candidate("partition-repair"),
)
"""Candidates for a short worst-case undetected time: of 34 that were played on 48 scenarios of
`monitoring-v1:validation`, those that lower the smallest cost, and some for teams in which robots fail: lines under the
proved filter, and a partition that robots repair."""
