"""The prior of a portfolio: which of its patrols are probably good on a scenario of cars.

A network reads dimensionless numbers of the scenario and predicts the cost of each patrol, as of
`baselines.planning.rehearse`. Lengths are compared with the robots' spacing, which is the side of a square as large as
a robot's share of the rectangle, and speeds with the robots' top speed. So the order of the patrols does not depend on
the units of length and time. `benchmarks/prior.py` fits the included priors.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.settings import PolicySettings
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.files import read_json
from lissajous_env.theory.geometry import turning_radius

FOLDER = Path(__file__).parent / "priors"


class Number(NamedTuple):
    """A number of a scenario of cars, which is not negative."""

    meaning: str
    of: Callable[[Scenario], float]
    as_logarithm: bool = False
    """True if the network reads the logarithm of the number."""

    def read(self, task: Scenario) -> float:
        """Return what the network reads."""
        value = float(self.of(task))
        return math.log(value) if self.as_logarithm else value

    def written(self, value: float) -> str:
        """Return the number that the network reads as `value`, in words."""
        return f"{math.exp(min(value, 700.0)) if self.as_logarithm else value:.4g}"


def spacing(task: Scenario) -> float:
    """Return the side of a square that is as large as a robot's share of the rectangle [m]."""
    return math.sqrt(4 * task.curve.half_width * task.curve.half_height / task.num_robots)


def _standstill(task: Scenario) -> float:
    faults, duration = task.faults, task.task.duration
    scheduled = sum(max(min(end, duration) - start, 0.0) for _, start, end in faults.schedule)
    return min(faults.rate * faults.mean_duration + scheduled / (task.num_robots * duration), 1.0)


NUMBERS = (
    Number("1 over the number of robots", lambda task: 1 / task.num_robots),
    Number("width of the rectangle over its height", lambda task: task.curve.half_width / task.curve.half_height, True),
    Number("sensing radius over the robots' spacing", lambda task: task.sensing_radius / spacing(task), True),
    Number("sensing radius over half of the height", lambda task: task.sensing_radius / task.curve.half_height, True),
    Number("radius of a body over the robots' spacing", lambda task: task.robot.radius / spacing(task), True),
    Number(
        "turning radius over the robots' spacing",
        lambda task: turning_radius(task.robot.wheelbase, task.robot.steering_max) / spacing(task),
        True,
    ),
    Number(
        "distance that a robot can drive in an episode over the robots' spacing",
        lambda task: task.robot.top_speed * task.task.duration / spacing(task),
        True,
    ),
    Number(
        "targets' top speed over that of the robots", lambda task: min(task.rogue_speed / task.robot.top_speed, 2.0)
    ),
    Number("share of targets that wander", lambda task: task.targets.wandering),
    Number("share of targets that flee", lambda task: task.targets.fleeing),
    Number(
        "distance at which targets flee over the sensing radius, times the share of those that do",
        lambda task: task.targets.fleeing * task.targets.flee_radius / task.sensing_radius,
    ),
    Number("1 if targets enter at the boundary", lambda task: task.targets.entry == "boundary"),
    Number("1 if targets enter where no robot senses them", lambda task: task.targets.entry == "unseen"),
    Number("1 if robots do not start in the equilibrium", lambda task: task.formation.start != "equilibrium"),
    Number(
        "failures of a robot in an episode",
        lambda task: task.faults.rate * task.task.duration + len(task.faults.schedule) / task.num_robots,
    ),
    Number("share of the time for which a robot has failed", _standstill),
    Number(
        "share of robots that fail for good",
        lambda task: (task.faults.lost + len(task.faults.removed)) / task.num_robots,
    ),
    Number(
        "noise of measured positions over the radius of a body", lambda task: task.noise.position / task.robot.radius
    ),
    Number("noise of measured headings [rad]", lambda task: task.noise.heading),
    Number("share of messages that are lost", lambda task: task.noise.message_loss),
)
"""Numbers that a network reads, in its order."""


def numbers_of(task: Scenario) -> np.ndarray:
    """Return what a network reads (F,) of a scenario of cars, in the order of `NUMBERS`."""
    return np.array([number.read(task) for number in NUMBERS])


class Layer(NamedTuple):
    """A layer of the network."""

    weight: np.ndarray
    """(outputs, inputs)."""
    bias: np.ndarray
    """(outputs,)."""


@dataclass(frozen=True)
class Prior:
    """A network that predicts the cost of each patrol of a portfolio from the numbers of a scenario."""

    about: Mapping[str, Any]
    """The command that made it, with its seed, and the scenarios that it played."""
    objective: str
    """`DETECTION` or `GUARANTEE` of `baselines.planning.rehearse`."""
    patrols: tuple[PolicySettings, ...]
    """K policies with parameters relative to the scenario (`baselines.planning.plans.absolute`)."""
    limits: np.ndarray
    """(F, 2) smallest and largest value of each number that is accepted."""
    seen: np.ndarray
    """(F, 2) smallest and largest value of each number in the fit; the network reads the nearest one in this range."""
    errors: np.ndarray
    """(E, K) costs of the patrols less the predicted ones, in scenarios that a fit did not use."""
    layers: tuple[Layer, Layer]
    """The hidden layer of tanh units, and the linear one, whose output is the cost with the opposite sign."""

    @classmethod
    def read(cls, name: str) -> "Prior":
        """Read the prior of an included portfolio."""
        return _read(name)

    def predicted(self, task: Scenario) -> np.ndarray:
        """Return the predicted cost (K,) of each patrol.

        Raises:
            UnsuitableScenarioError: the robots are not cars, or a number of the scenario is outside of the limits.
        """
        if task.robot.kind != "car":
            raise UnsuitableScenarioError(f"robot.kind must be car, got {task.robot.kind}")
        values = numbers_of(task)
        for number, value, (low, high) in zip(NUMBERS, values, self.limits, strict=True):
            if not low <= value <= high:
                least = f"from {number.written(low)} to" if number.as_logarithm else "at most"
                rule = f"must be {least} {number.written(high)}, for which patrols are chosen"
                raise UnsuitableScenarioError(f"{number.meaning} {rule}, got {number.written(value)}")
        return costs_of(self.layers, np.clip(values, *self.seen.T))

    def has_seen(self, task: Scenario) -> bool:
        """Return whether every number of a scenario is in the range of the fit."""
        values = numbers_of(task)
        return bool(np.all((self.seen[:, 0] <= values) & (values <= self.seen[:, 1])))


def costs_of(layers: tuple[Layer, Layer], values: np.ndarray) -> np.ndarray:
    """Return the costs (K,) that a network predicts for the numbers (F,) of a scenario, in float64."""
    hidden, last = layers
    return -(last.weight @ np.tanh(hidden.weight @ values + hidden.bias) + last.bias)


def complementary(predicted: np.ndarray, errors: np.ndarray) -> list[int]:
    """Return the order of patrols in which each next one lowers the expected smallest cost most.

    Similar patrols are often predicted to be good together and fail together, so only one of them comes early.

    Args:
        predicted: Predicted cost (K,) of each patrol.
        errors: Costs less predicted costs (E, K), which are taken as E possible errors of this prediction.
    """
    costs = predicted + errors
    best, order = np.full(len(costs), np.inf), []
    for _ in predicted:
        expected = np.minimum(best[:, None], costs).mean(axis=0)
        expected[order] = np.inf
        order.append(int(expected.argmin()))
        best = np.minimum(best, costs[:, order[-1]])
    return order


@cache
def _read(name: str) -> Prior:
    text = read_json(FOLDER / f"{name}.json")
    return Prior(
        about=text["about"],
        objective=text["objective"],
        patrols=tuple(PolicySettings(**patrol) for patrol in text["patrols"]),
        limits=np.array(text["limits"]),
        seen=np.array(text["seen"]),
        errors=np.array(text["errors"]),
        layers=tuple(Layer(*(np.array(layer[part], np.float32).astype(float) for part in ("weight", "bias")))
                     for layer in text["layers"]),  # type: ignore[arg-type]
    )  # fmt: skip
