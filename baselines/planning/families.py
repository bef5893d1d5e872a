"""The families of plans: the included policies, the best known plans, partitions, lines, formations and loops.

The included policies with their defaults and the best known plans are played on the scenario as it is, so that the
best printed plan is at least as good as they are. Of formations, curves with a + b = N are the paper's, with its bounds
(6), (7) and (8). Other curves are tried too where N equally spaced robots of the undisturbed formation neither collide
nor leave a gap, by `lissajous_env.theory.geometry`.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from typing import Any

from baselines.benchmark.best_known import BEST_KNOWN, BestKnown, known_plans
from baselines.planning.plans import Choices, Family, Plan, Variables, absolute, robots_top_speed
from baselines.policies import registry
from baselines.policies.as_cars import like_cars
from baselines.policies.settings import PolicySettings
from lissajous_env.parameters import named
from lissajous_env.parameters.robot_models import tightest_radius
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.parts import Curve
from lissajous_env.theory import closed_forms, geometry
from lissajous_env.theory.design import HEADROOM, best_design, best_formation, formation_fields, largest_phase_rate

DEFAULTS, FORMATIONS = "defaults", "Lissajous"
"""Names of the families of the included policies and of formations."""
_FIRST = "partition", "line-abreast", "kuramoto-mpcc"
"""Beginnings of the names of policies that are usually the best, and are tried first."""
_FILTERED = "kuramoto-mpcc"
"""The policy that is also played with the collision filters."""
_FILTERS = "", "-safe"
"""Suffixes of a policy of cars: without and with the collision filter."""
_STARTS = [0.0, 0.5, 0.7, 0.9]
"""Speeds of a start on an ellipse where it is fastest, over the top speed; 0 for the start of the scenario."""
_CLEARANCE_MARGIN = 1.2
"""Clearance for which a partition is planned, over the requested one: cars are not exactly on their loops."""
_STABLE = "kuramoto", "arc"
"""Coordinators that require a stable equilibrium (2) with a place for each robot, which 4 and 6 robots do not have."""
_COORDINATORS = *_STABLE, "consensus", "open-loop", "tracked-reference"
_MOST_CURVES = 12
"""Curves that are tried."""
_MORE_OSCILLATIONS = 6
"""Largest a + b that is tried, less the number of robots."""
_TIGHT = 0.35
"""Largest share of the arc of a curve that may turn tighter than the cars can."""
_MARGIN = 1.05
"""Least distance of robots in formation, over the sum of their radii; least sensing radius, over the gap of a lap."""


def families_of(scenario: Scenario, clearance: float = 0.0) -> list[Family]:
    """Return the families of plans for a scenario, with partitions whose bodies are a clearance apart [m]."""
    known = as_family(scenario, known_plans(scenario))
    others = partitions(scenario, clearance), lines(scenario), formations(scenario), loops(scenario)
    return [defaults(scenario), known, *others]


def defaults(scenario: Scenario) -> Family:
    """Return the policies that drive the robots, first those that are usually the best."""
    names = sorted(default_policies(scenario), key=lambda name: not name.startswith(_FIRST))
    first = [{"policy": name} for name in names]
    return Family(DEFAULTS, lambda given: Plan(DEFAULTS, scenario, PolicySettings(given["policy"]), "defaults"), first)


def default_policies(scenario: Scenario) -> list[str]:
    """Return the names of the included classical policies that drive the robots of a scenario.

    Of those with a collision filter, the paper's method alone. Policies that are played on request alone are left out.
    """
    names = [name for name in registry.names(scenario) if registry.is_classical(name) and registry.is_included(name)]
    names = [name for name in names if registry.is_default_on(name, scenario.name)]
    return [name for name in names if not registry.split_suffix(name)[1] or registry.split_suffix(name)[0] == _FILTERED]


def as_family(scenario: Scenario, plans: Sequence[BestKnown]) -> Family:
    """Return stored plans as a family of plans on a scenario."""
    if not plans:
        return Family(BEST_KNOWN, refusal="none is stored for this scenario")
    settings = {plan.name: plan.settings for plan in plans}
    first = [{"stored": name} for name in settings]
    return Family(BEST_KNOWN, lambda given: Plan(BEST_KNOWN, scenario, settings[given["stored"]], "best known"), first)


def partitions(scenario: Scenario, clearance: float = 0.0) -> Family:
    """Return partitions, by the speed and the division of the rectangle.

    Args:
        scenario: The scenario.
        clearance: Least distance of two bodies [m]; partitions have a body's radius between them in any case.
    """
    wider = _CLEARANCE_MARGIN * clearance
    apart = {"clearance": float(f"{wider:.4g}")} if wider > scenario.robot.radius else {}
    speeds = {"speed": 0.9}, {"speed": 0.9, "start": 0.7}, {"speed": 0.6}, {"speed": 0.97}, {"speed": 0.8}
    first = [apart | settings for settings in speeds]
    extents: list[Any] = [0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9]
    turns: dict[str, Choices] = {"turning": (1.0, 8.0)} if scenario.robot.kind == "differential" else {}
    return with_parameters(scenario, "partition", ("partition", "partition-repair"), first, {
        "speed": (0.3, 1.0),
        "rows": list(range(1, scenario.num_robots + 1)),
        "extent_x": extents,
        "extent_y": extents,
        "lanes": [2, 4, 6],
    } | turns)  # fmt: skip


def lines(scenario: Scenario) -> Family:
    """Return lines of cars side by side, by the speed and the number of lines."""
    first = ({"lines": 1}, {"lines": 2}, {"speed": 0.6}, {"lines": 3}, {"speed": 0.8})
    return with_parameters(scenario, "lines", ("line-abreast",), first, {
        "speed": (0.3, 0.98),
        "lines": list(range(1, min(scenario.num_robots, 4) + 1)),
    })  # fmt: skip


def loops(scenario: Scenario) -> Family:
    """Return loops on which cars drive in file or by themselves, by their speed, number of lanes and inset."""
    first = [
        {"cruise": 0.8, "lanes": lanes, "inset": inset, "start": start}
        for lanes, inset, start in ((2, 0.5, 0.9), (4, 0.5, 0.9), (2, 0.1, 0.9), (6, 0.5, 0.9), (2, 0.5, 0.0))
    ]
    return with_parameters(scenario, "loops", ("sweep", "laps"), first, {
        "policy": [policy + suffix for policy in ("sweep", "laps") for suffix in _FILTERS],
        "cruise": (0.3, 1.0),
        "lanes": [2, 4, 6, 8],
        "inset": (0.02, 1.5),
    })  # fmt: skip


def with_parameters(
    scenario: Scenario,
    name: str,
    policies: Sequence[str],
    first: Sequence[Variables],
    parameters: Mapping[str, Choices],
) -> Family:
    """Return a family of policies by their parameters, in the units of `baselines.planning.plans.UNITS`.

    Args:
        scenario: The scenario.
        name: Name of the family.
        policies: Policies of cars.
        first: Parameters that are tried first with each policy, the defaults aside.
        parameters: Values that the parameters may have, and those of `policy` if there are more than the first ones.
    """
    if like_cars(scenario) is None:
        needed = f"not cars as for {' and '.join(policies)} (give a turning radius)"
        return Family(name, refusal=f"the robots are of kind {scenario.robot.kind}, {needed}")
    of_each = [{"policy": policy, **settings} for settings in first for policy in policies]
    choices = {"policy": list(policies), "start": _STARTS, **parameters}
    return Family(name, partial(_plan_of, scenario, name), of_each, choices)


def _plan_of(scenario: Scenario, name: str, given: Variables) -> Plan:
    """Return the plan of a policy with parameters, on the scenario or, if `start` is given, on one with that start."""
    shares = {key: value for key, value in given.items() if key not in ("policy", "start")}
    start = given.get("start", 0.0) * robots_top_speed(scenario)
    policy = absolute(PolicySettings(given["policy"], shares), scenario, digits=4)
    words = {key: f"{value:.3g}" if isinstance(value, float) else value for key, value in policy.parameters.items()}
    about = ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in words.items())
    if start:  # evenly spaced on the ellipse in the rectangle, all in the same sense; this is the speed at its fastest
        about += f", start on an ellipse at {start:.3g} m/s"
        ellipse = Curve(scenario.driven.half_width, scenario.driven.half_height, 1, 1)
        rate = float(f"{start / geometry.largest_speed(ellipse):.6g}")
        scenario = named.build(scenario, **formation_overrides(scenario, ellipse, rate))
    return Plan(name, scenario, policy, about)


def formations(scenario: Scenario) -> Family:
    """Return formations by curve, coordinator, and shares of the largest phase rate and of the default coupling."""
    policies = _formation_policies(scenario)
    if not policies:
        return Family(FORMATIONS, refusal=f"no coordinator drives robots of kind {scenario.robot.kind}")
    curves, (usual, *others) = curves_of(scenario), policies
    if not curves:
        return Family(FORMATIONS, refusal=_violation(scenario))
    # Every curve with the first coordinator that fits, then the best ones with the others.
    first = [{"curve": k, "policy": usual, "rate": 1.0} for k in range(len(curves))]
    first += [{"curve": k, "policy": policy, "rate": 1.0} for k in range(len(curves))[:2] for policy in others]
    choices = {
        "curve": list(range(len(curves))),
        "policy": policies,
        "rate": (0.3, 1.3),
        "coupling": (0.2, 5.0),
    }
    return Family(FORMATIONS, partial(_formation, scenario), first, choices)


def _violation(scenario: Scenario) -> str:
    """Return the conditions that the best curve with a + b = N violates."""
    if scenario.num_robots == 1:
        return "one robot leaves a gap on every curve that it can follow"
    curve, robot, sensor, speed = scenario.curve, scenario.robot, scenario.sensing_radius, robots_top_speed(scenario)
    halves, turning = (curve.half_width, curve.half_height), tightest_radius(robot)
    best = best_design(*halves, scenario.num_robots, robot, sensor, speed, turning, scenario.inset)
    violated = best.violations(robot.radius, sensor) or ["robots collide or leave a gap on every curve"]
    return f"the paper's best curve is a = {best.curve.a}, b = {best.curve.b}: {'; '.join(violated)}"


def _formation(scenario: Scenario, given: Variables) -> Plan:
    """Return the formation at a share of the largest phase rate that its robots can drive, less the headroom."""
    curve, policy = curves_of(scenario)[given["curve"]], given["policy"]
    rate = float(f"{given['rate'] * _largest_rate(scenario, curve):.6g}")
    fields = formation_overrides(scenario, curve, rate)
    if "coupling" in given:
        fields["formation.coupling"] *= given["coupling"]
    coordinator, pace = {}, f"omega = {rate:.3g} rad/s"
    if policy.startswith("arc"):
        cruise = min(given["rate"] * (1 - HEADROOM), 1.0) * robots_top_speed(scenario)
        coordinator = {"speed": float(f"{cruise:.6g}")}
        pace = f"{coordinator['speed']:.3g} m/s"
    about = f"a:b = {curve.a}:{curve.b}, p = {fields['formation.p']}, {pace}"
    return Plan(FORMATIONS, named.build(scenario, **fields), PolicySettings(policy, {}, coordinator), about)


def _formation_policies(scenario: Scenario) -> list[str]:
    """Return the policies of formations, the paper's method first if the robots have a stable formation."""
    has_stable = closed_forms.has_unclustered_equilibrium(scenario.num_robots)
    fitting = [name for name in _COORDINATORS if has_stable or name not in _STABLE]
    if scenario.robot.kind == "curve":
        return fitting
    drivers = _FILTERS if like_cars(scenario) is not None else ()
    return [f"{name}-mpcc{suffix}" for suffix in drivers for name in fitting]


@lru_cache(maxsize=64)
def curves_of(scenario: Scenario) -> list[Curve]:
    """Return the driven curves on which the formation of a scenario may work, those with the shortest laps first."""
    n = scenario.num_robots
    half = scenario.driven.half_width, scenario.driven.half_height
    most = n + _MORE_OSCILLATIONS
    # A curve (3) has an odd a, and a and b have no common divisor.
    ratios = ((a, b) for a in range(1, most + 1, 2) for b in range(1, most + 1 - a) if math.gcd(a, b) == 1)
    lap = {curve: 1 / _largest_rate(scenario, curve) for curve in (Curve(*half, a, b) for a, b in ratios)}
    first = sorted(lap, key=lambda curve: (curve.a + curve.b != n, lap[curve]))
    usable = itertools.islice((curve for curve in first if _may_work(scenario, curve)), _MOST_CURVES)
    return sorted(usable, key=lap.__getitem__)


def _may_work(scenario: Scenario, curve: Curve) -> bool:
    """Return whether the undisturbed formation neither collides nor leaves a gap, and cars can follow most of it."""
    n, robot = scenario.num_robots, (like_cars(scenario) or scenario).robot
    least, tightest = 2 * robot.radius * _MARGIN, tightest_radius(robot)
    if geometry.smallest_distance(curve, n, least) < least or geometry.tight_share(curve, tightest) > _TIGHT:
        return False
    gap = geometry.measured_coverage_radius(curve, 1e-2) + math.sqrt(2) * scenario.inset
    return gap * _MARGIN < scenario.sensing_radius


def _largest_rate(scenario: Scenario, curve: Curve) -> float:
    """Return the largest phase rate at which the robots can drive a curve, less the headroom [rad/s]."""
    robot = (like_cars(scenario) or scenario).robot
    grip = robot.lateral_acceleration_max if robot.kind == "car" else math.inf
    return largest_phase_rate(curve, robots_top_speed(scenario), tightest_radius(robot), grip)


def formation_overrides(scenario: Scenario, curve: Curve, rate: float) -> dict[str, Any]:
    """Return the fields that put robots in formation on a curve, as it is driven, at a phase rate omega [rad/s]."""
    p, alpha = best_formation(curve, scenario.num_robots)
    there = scenario.alpha * geometry.curve_length(scenario.driven)
    noise = scenario.formation.start_noise * there / (alpha * geometry.curve_length(curve))
    fields = formation_fields(curve, rate, p, alpha)
    fields |= {"formation.start_noise": noise, "robot.count": scenario.num_robots}
    if scenario.robot.kind == "curve":
        fields["robot.phase_rate_max"] = robots_top_speed(scenario) / (alpha * geometry.largest_speed(curve))
    return fields
