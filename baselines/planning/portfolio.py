"""Portfolios: policies that rehearse some classical patrols for their scenario, and drive the best one of them.

A prior determines which patrols are rehearsed: those that are probably good on a scenario of cars. Its network reads
dimensionless features of the scenario and predicts the cost of each patrol. Lengths are compared with the robots'
spacing, which is the side of a square as large as a robot's share of the rectangle, and speeds with the robots' top
speed. So the order of the patrols does not depend on the units of length and time. `benchmarks/prior.py` fits the
included priors. All robots read the same features and play the same episodes, so they choose the same patrol without
messages, on processors of one kind.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from baselines.planning.plans import absolute
from baselines.planning.rehearse import cells
from baselines.policies import registry
from baselines.policies.base import Policy, UnsuitableScenarioError
from baselines.policies.settings import PolicySettings
from lissajous_env.episodes.evaluation import evaluate
from lissajous_env.episodes.guarantee import CELLS
from lissajous_env.parameters import named
from lissajous_env.parameters.assumptions import quietly
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.files import read_json
from lissajous_env.theory.geometry import turning_radius
from lissajous_env.wording import require
from lissajous_env.world.columns import COLLISIONS, DETECTION_TIME, OPEN, WORST_CASE

NAMES = {
    "portfolio": "Rehearses patrols with the proved filter for a short detection time, and drives the best one.",
    "portfolio-guarantee": "Rehearses patrols for a short worst case, and drives the best one.",
}
"""Descriptions of the portfolios, by name."""
REHEARSED = 5
"""Number of patrols that are rehearsed, twice as many for a scenario with a feature outside of the range of the fit."""

FEW, FIRST_SEED = 4, 800_000
"""Episodes of a rehearsal, and the seed of the first; no published results are from these seeds."""
FINALISTS, MANY = 2, 16
"""Number of the best policies that are played again, and in how many episodes."""
_CELLS_IN_A_SENSOR = 4.0
"""Least sensing radius on the contamination grid of rehearsals [cell]."""
FOLDER = Path(__file__).parent / "priors"
DETECTION, GUARANTEE = "detection", "guarantee"
"""Objectives of a portfolio: the mean detection time, and the worst-case undetected time."""
_OPEN = 2.0
"""Worst case that stands for one without a bound, in durations of an episode."""
_COLLISION, MOST_COLLISIONS = 0.1, 20
"""Cost of a collision in an episode, and the largest number of collisions that counts."""


class Feature(NamedTuple):
    """A feature of a scenario of cars: a number that is not negative."""

    meaning: str
    value: float
    as_logarithm: bool = False
    """True if the network reads the logarithm of the feature."""

    @property
    def read(self) -> float:
        """Return the number that the network reads."""
        return math.log(self.value) if self.as_logarithm else float(self.value)

    def written(self, read: float) -> str:
        """Return in words the value that the network reads as a number."""
        return f"{math.exp(min(read, 700.0)) if self.as_logarithm else read:.4g}"


def scheduled_failures(scenario: Scenario) -> list[float]:
    """Return the durations of the scheduled failures in an episode [s]; rows of a robot that overlap are one."""
    failures: list[list[float]] = []
    for robot, start, end in sorted(scenario.faults.schedule):
        if failures and failures[-1][0] == robot and start <= failures[-1][2]:
            failures[-1][2] = max(failures[-1][2], end)
        elif start < scenario.task.duration:
            failures.append([robot, start, end])
    return [min(end, scenario.task.duration) - start for _, start, end in failures]


def described_features(scenario: Scenario) -> tuple[Feature, ...]:
    """Return the features (F,) of a scenario of cars in the order in which the network reads them."""
    curve, robot, targets, faults = scenario.curve, scenario.robot, scenario.targets, scenario.faults
    count, duration = scenario.num_robots, scenario.task.duration
    unit = math.sqrt(4 * curve.half_width * curve.half_height / count)  # the robots' spacing
    sensing, reach = scenario.sensing_radius, robot.top_speed * duration
    turning, failures = turning_radius(robot.wheelbase, robot.steering_max), scheduled_failures(scenario)
    fleeing = targets.fleeing * targets.flee_radius / sensing
    standstill = min(faults.rate * faults.mean_duration + sum(failures) / (count * duration), 1.0)
    return (
        Feature("1 over the number of robots", 1 / count),
        Feature("width of the rectangle over its height", curve.half_width / curve.half_height, True),
        Feature("sensing radius over the robots' spacing", sensing / unit, True),
        Feature("sensing radius over half of the height", sensing / curve.half_height, True),
        Feature("radius of a body over the robots' spacing", robot.radius / unit, True),
        Feature("turning radius over the robots' spacing", turning / unit, True),
        Feature("distance that a robot can drive in an episode over the robots' spacing", reach / unit, True),
        Feature("targets' top speed over that of the robots", min(scenario.rogue_speed / robot.top_speed, 2.0)),
        Feature("share of targets that wander", targets.wandering),
        Feature("share of targets that flee", targets.fleeing),
        Feature("distance at which targets flee over the sensing radius, times the share of those that do", fleeing),
        Feature("1 if targets enter at the boundary", targets.entry == "boundary"),
        Feature("1 if targets enter where no robot senses them", targets.entry == "unseen"),
        Feature("1 if robots do not start in the equilibrium", scenario.formation.start != "equilibrium"),
        Feature("failures of a robot in an episode", faults.rate * duration + len(failures) / count),
        Feature("share of the time for which a robot has failed", standstill),
        Feature("share of robots that fail for good", (faults.lost + len(dict(faults.removed))) / count),
        Feature("noise of measured positions over the radius of a body", scenario.noise.position / robot.radius),
        Feature("noise of measured headings [rad]", scenario.noise.heading),
        Feature("share of messages that are lost", scenario.noise.message_loss),
    )


def features_of(scenario: Scenario) -> np.ndarray:
    """Return the features (F,) of a scenario of cars as the network reads them."""
    return np.array([feature.read for feature in described_features(scenario)])


class Layer(NamedTuple):
    """A layer of the network."""

    weight: np.ndarray
    """(outputs, inputs)."""
    bias: np.ndarray
    """(outputs,)."""


@dataclass(frozen=True, eq=False)
class Prior:
    """A network that predicts the cost of each patrol of a portfolio from the features of a scenario."""

    about: Mapping[str, Any]
    """The command that made it, with its seed, and the scenarios that it played."""
    objective: str
    """`DETECTION` or `GUARANTEE`."""
    patrols: tuple[PolicySettings, ...]
    """K policies with parameters relative to the scenario (`baselines.planning.plans.absolute`)."""
    limits: np.ndarray
    """(F, 2) smallest and largest value of each feature that is accepted."""
    seen: np.ndarray
    """(F, 2) smallest and largest value of each feature in the fit; the network reads the nearest one in this range."""
    errors: np.ndarray
    """(E, K) costs of the patrols less the predicted ones, in scenarios that a fit did not use."""
    layers: tuple[Layer, Layer]
    """The hidden layer of tanh units, and the linear one, whose output is the cost with the opposite sign."""

    @staticmethod
    @cache
    def read(name: str) -> "Prior":
        """Read the prior of an included portfolio."""
        given = read_json(FOLDER / f"{name}.json")
        given["patrols"] = tuple(PolicySettings(**patrol) for patrol in given["patrols"])
        given |= {key: np.array(given[key]) for key in ("limits", "seen", "errors")}
        layers = (
            Layer(*(np.array(layer[part], np.float32).astype(float) for part in Layer._fields))
            for layer in given["layers"]
        )
        return Prior(**given | {"layers": tuple(layers)})

    def predicted(self, scenario: Scenario) -> np.ndarray:
        """Return the predicted cost (K,) of each patrol.

        Raises:
            UnsuitableScenarioError: the robots are not cars, or a feature of the scenario is outside of the limits.
        """
        if scenario.robot.kind != "car":
            raise UnsuitableScenarioError(f"robot.kind must be car, got {scenario.robot.kind}")
        features = described_features(scenario)
        for feature, (low, high) in zip(features, self.limits, strict=True):
            if not low <= feature.read <= high:
                least = f"from {feature.written(low)} to" if feature.as_logarithm else "at most"
                rule = f"must be {least} {feature.written(high)}, for which patrols are chosen"
                raise UnsuitableScenarioError(f"{feature.meaning} {rule}, got {feature.written(feature.read)}")
        return costs_of(self.layers, np.clip([feature.read for feature in features], *self.seen.T))

    def has_seen(self, scenario: Scenario) -> bool:
        """Return whether every feature of a scenario is in the range of the fit."""
        values = features_of(scenario)
        return np.array_equal(values, np.clip(values, *self.seen.T))


def costs_of(layers: tuple[Layer, Layer], values: np.ndarray) -> np.ndarray:
    """Return the costs (K,) that a network predicts for the features (F,) of a scenario, in float64."""
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


class Result(NamedTuple):
    """The result of a policy in some episodes."""

    time: float
    """Mean detection time, or largest worst-case undetected time [s]; infinite if nothing was detected."""
    collisions: float
    """Collisions in an episode."""

    def cost(self, step: float) -> float:
        """Return the cost, with a time of at least a control step [s]: below, collisions alone decide."""
        return float(cost_of(max(self.time, step), self.collisions))


def cost_of(time: Any, collisions: Any) -> Any:
    """Return the logarithm of a time, and a tenth for each collision in an episode."""
    return np.log(time) + _COLLISION * np.minimum(collisions, MOST_COLLISIONS)


def result_of(
    settings: PolicySettings, scenario: Scenario, episodes: int, objective: str, first_seed: int
) -> Result | None:
    """Play a policy and return its result; None for a scenario that does not suit the policy."""
    try:
        policy = settings.make(scenario, episodes)
    except UnsuitableScenarioError:
        return None
    rows = evaluate(policy, scenario, range(first_seed, first_seed + episodes))
    collisions = sum(row[COLLISIONS.name] for row in rows) / episodes
    if objective == GUARANTEE:
        longest = max(row[WORST_CASE.name] for row in rows)
        is_open = any(row[OPEN.name] for row in rows)
        return Result(_OPEN * scenario.task.duration if is_open else longest, collisions)
    times = [row[DETECTION_TIME.name] for row in rows if math.isfinite(row[DETECTION_TIME.name])]
    return Result(sum(times) / len(times) if times else math.inf, collisions)


def chosen(name: str, scenario: str | Scenario) -> PolicySettings:
    """Return the policy and the parameters that a portfolio plays on a scenario.

    Raises:
        ValueError: there is no such portfolio, the prior does not include the scenario, or no patrol suits it.
    """
    require(name in NAMES, "portfolio", f"must be one of {', '.join(NAMES)}", name, NAMES)
    return _first_suitable(name, scenario, 1, "cpu")[0]


def _make(name: str, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    return _first_suitable(name, scenario, num_worlds, device)[1]


def _first_suitable(name: str, scenario: str | Scenario, num_worlds: int, device: Any) -> tuple[PolicySettings, Policy]:
    """Return the best patrol that suits a scenario, and the policy that it makes."""
    reason: ValueError | None = None
    for settings in ordered(Prior.read(name), scenario):
        try:
            return settings, settings.make(named.build(scenario), num_worlds, device)
        except UnsuitableScenarioError as error:
            reason = reason or error
    assert reason is not None
    raise reason


def ordered(prior: Prior, scenario: str | Scenario, count: int | None = None) -> list[PolicySettings]:
    """Return the patrols of a portfolio in the order in which they are tried, the best rehearsed one first.

    Args:
        prior: The prior of the portfolio.
        scenario: The scenario.
        count: Number of patrols to rehearse, by default `REHEARSED` or twice as many; with 0 the prior decides alone.

    Raises:
        UnsuitableScenarioError: the prior does not include the scenario.
    """
    scenario = named.build(scenario).resolve()
    order = np.argsort(prior.predicted(scenario), kind="stable")
    count = (REHEARSED if prior.has_seen(scenario) else 2 * REHEARSED) if count is None else count
    best = best_rehearsed(prior, scenario, count) if count else None
    return [absolute(prior.patrols[k], scenario) for k in sorted(order, key=lambda k: k != best)]


def rehearsal_of(scenario: Scenario, objective: str) -> Scenario:
    """Return the scenario of rehearsals: without extensions, with the rogues or the grid that the objective needs."""
    scenario = scenario.without_extensions()
    changes: dict[str, Any] = {"task.grid": None}
    if objective == DETECTION:
        changes["task.contamination"] = None
    else:
        changes["targets.rogues"] = None
        if scenario.task.contamination is None:
            changes["task.contamination"] = cells(scenario, CELLS, _CELLS_IN_A_SENSOR)
    return named.build(scenario, **changes)


@lru_cache(maxsize=256)
def best_rehearsed(prior: Prior, scenario: Scenario, count: int) -> int | None:
    """Return the index of the best of the first `count` patrols that suit a scenario; None if none does.

    The `FINALISTS` best patrols of `FEW` episodes are compared in `MANY`. The worst case of more episodes is never
    shorter. So with the objective `GUARANTEE`, every other patrol that was better in its few episodes than these are in
    all is played again, too. The episodes do not depend on the machine's load or on what ran before, so that all robots
    on machines of one kind choose the same.
    """
    rehearsal, step = rehearsal_of(scenario, prior.objective), scenario.task.step
    costs: dict[int, float] = {}
    finals: dict[int, float] = {}

    def result(k: int, episodes: int) -> Result | None:
        return result_of(absolute(prior.patrols[k], scenario), rehearsal, episodes, prior.objective, FIRST_SEED)

    with quietly():
        for k in complementary(prior.predicted(scenario), prior.errors):
            if (few := result(k, FEW)) is not None:
                costs[k] = few.cost(step)
            if len(costs) == count:
                break
        for k in sorted(costs, key=costs.__getitem__) if len(costs) > 1 else ():
            # The worst case of more episodes is at least that of some of them, so `costs` bounds it from below.
            may_be_best = prior.objective == GUARANTEE and costs[k] < min(finals.values(), default=math.inf)
            if (len(finals) < FINALISTS or may_be_best) and (many := result(k, MANY)) is not None:
                finals[k] = many.cost(step)
    ranked = finals or costs
    return min(ranked, key=ranked.__getitem__, default=None)


for _name, _about in NAMES.items():
    registry.register(_name, "car", partial(_make, _name), about=_about, steered_by="plan", on_request=True)
