"""Formations on Lissajous curves: by a : b, ring order, phase rate and coordinator.

Curves with a + b = N are the paper's, with its bounds (6), (7) and (8). Other curves are tried too where N equally
spaced robots of the undisturbed formation neither collide nor leave a gap, by `lissajous_env.theory.geometry`.
"""

import itertools
import math
from functools import lru_cache, partial
from typing import Any

import numpy as np

from baselines.planning.plans import FILTERS, Family, Plan, Settings, top_speed
from baselines.planning.request import paper_design, turning_radius_of
from baselines.policies.as_cars import like_cars
from baselines.policies.settings import PolicySettings
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.parts import Curve
from lissajous_env.theory import closed_forms, geometry
from lissajous_env.theory.design import HEADROOM, best_formation, largest_phase_rate

NAME = "Lissajous"
_KURAMOTO = "kuramoto", "arc"
"""Coordinators that require a stable equilibrium (2) with a place for each robot, which 4 and 6 robots do not have."""
_COORDINATORS = *_KURAMOTO, "consensus", "open-loop", "tracked-reference"
_MOST_CURVES = 12
"""Curves that are tried."""
_MORE = 6
"""Largest a + b that is tried, less the number of robots."""
_TIGHT = 0.35
"""Largest share of the arc of a curve that may turn tighter than the cars can."""
_ROOM = 1.05
"""Least distance of robots in formation, over the sum of their radii; least sensing radius, over what a lap needs."""


def formations(task: Scenario) -> Family:
    """Return formations by curve, coordinator, and shares of the largest phase rate and of the default coupling."""
    policies = _policies(task)
    if not policies:
        return Family(NAME, refusal=f"no coordinator drives robots of kind {task.robot.kind}")
    curves, (paper, *others) = curves_of(task), policies
    if not curves:
        return Family(NAME, refusal=_violation(task))
    # Every curve with the paper's method, then the best ones with other coordinators.
    starts = [{"curve": k, "policy": paper, "rate": 1.0} for k in range(len(curves))]
    starts += [{"curve": k, "policy": policy, "rate": 1.0} for k in range(len(curves))[:2] for policy in others]
    space = {
        "curve": list(range(len(curves))),
        "policy": policies,
        "rate": (0.3, 1.3),
        "coupling": (0.2, 5.0),
        "ring": list(range(4)),
    }
    return Family(NAME, partial(_plan, task), starts, space)


def _violation(task: Scenario) -> str:
    """Return the conditions that the best curve with a + b = N violates."""
    curve, robot = task.curve, task.robot
    best = paper_design(
        curve.half_width, curve.half_height, robot, task.sensing_radius, top_speed(task), task.num_robots, task.inset
    )
    violated = best.violations(robot.radius, task.sensing_radius) or ["robots collide or leave a gap on every curve"]
    return f"the paper's best curve is a = {best.curve.a}, b = {best.curve.b}: {'; '.join(violated)}"


def _plan(task: Scenario, settings: Settings) -> Plan:
    """Return the formation at a share of the largest phase rate that its robots can drive, less the headroom."""
    curve, policy = curves_of(task)[settings["curve"]], settings["policy"]
    rate = float(f"{settings['rate'] * _largest_rate(task, curve):.6g}")
    fields = formation_overrides(task, curve, rate, settings.get("ring", 0))
    if "coupling" in settings:
        fields["formation.coupling"] = settings["coupling"] * rate / (0.3 * fields["formation.alpha"])
    coordinator, pace = {}, f"omega = {rate:.3g} rad/s"
    if policy.startswith("arc"):
        cruise = min(settings["rate"] * (1 - HEADROOM), 1.0) * top_speed(task)
        coordinator = {"speed": float(f"{cruise:.6g}")}
        pace = f"{coordinator['speed']:.3g} m/s"
    about = f"a:b = {curve.a}:{curve.b}, p = {fields['formation.p']}, {pace}"
    return Plan(NAME, named.build(task, **fields), PolicySettings(policy, {}, coordinator), about)


def _policies(task: Scenario) -> list[str]:
    """Return the policies, the paper's method first if the robots have a stable formation."""
    has_stable = closed_forms.has_unclustered_equilibrium(task.num_robots)
    fitting = [name for name in _COORDINATORS if has_stable or name not in _KURAMOTO]
    if task.robot.kind == "curve":
        return fitting
    return [f"{name}-mpcc{suffix}" for suffix in FILTERS for name in fitting] if like_cars(task) is not None else []


@lru_cache(maxsize=64)
def curves_of(task: Scenario) -> list[Curve]:
    """Return the driven curves on which the formation of a task may work, those with the shortest laps first."""
    n = task.num_robots
    half = task.driven.half_width, task.driven.half_height
    ratios = ((a, b) for a in range(1, n + _MORE + 1, 2) for b in range(1, n + _MORE + 1 - a) if math.gcd(a, b) == 1)
    lap = {curve: 1 / _largest_rate(task, curve) for curve in (Curve(*half, a, b) for a, b in ratios)}
    first = sorted(lap, key=lambda curve: (curve.a + curve.b != n, lap[curve]))
    usable = itertools.islice((curve for curve in first if _may_work(task, curve)), _MOST_CURVES)
    return sorted(usable, key=lap.__getitem__)


def _may_work(task: Scenario, curve: Curve) -> bool:
    """Return whether the undisturbed formation neither collides nor leaves a gap, and cars can follow most of it."""
    n, robot = task.num_robots, (like_cars(task) or task).robot
    apart, halves = 2 * robot.radius * _ROOM, np.pi * np.arange(1, n // 2 + 1) / n
    # The distances at some phases refuse most curves, long before the smallest of all phases is known.
    if geometry.chord_length(curve, geometry.lap_phases(curve, 1)[:, None], halves).min(initial=math.inf) < apart:
        return False
    if geometry.smallest_distance(curve, n) < apart:
        return False
    if geometry.tight_share(curve, turning_radius_of(robot)) > _TIGHT:
        return False
    gap = geometry.measured_coverage_radius(curve, 1e-2) + math.sqrt(2) * task.inset
    return gap * _ROOM < task.sensing_radius


def _largest_rate(task: Scenario, curve: Curve) -> float:
    """Return the largest phase rate at which the robots can drive a curve, less the headroom [rad/s]."""
    robot = (like_cars(task) or task).robot
    grip = robot.lateral_acceleration_max if robot.kind == "car" else math.inf
    return largest_phase_rate(curve, top_speed(task), turning_radius_of(robot), grip)


def formation_overrides(task: Scenario, curve: Curve, rate: float, ring: int = 0) -> dict[str, Any]:
    """Return the fields that put the robots of a task in formation on a curve.

    Args:
        task: The task.
        curve: The curve, as it is driven.
        rate: Phase rate omega [rad/s].
        ring: Index of the equilibrium, and thereby of the order of the robots; 0 for the one that recovers fastest.
    """
    n = task.num_robots
    p, alpha = best_formation(curve, n)
    if closed_forms.cluster_size(n, p, alpha) > 1:
        p, alpha = 1, 1  # equally spaced, though no stable equilibrium of (1)
    others = [other for other in closed_forms.stable_equilibria(n) if math.gcd(other, n) == 1 and other != p]
    if 0 < ring <= len(others):
        p = others[ring - 1]
        alpha = closed_forms.default_alpha(curve, n, p)
    if closed_forms.cluster_size(n, p, alpha) > 1:
        raise ValueError(f"p and alpha must give every robot a place of its own, got {p} and {alpha}")
    there = task.alpha * geometry.curve_length(task.driven)
    noise = task.formation.start_noise * there / (alpha * geometry.curve_length(curve))
    point = {"robot.phase_rate_max": top_speed(task) / (alpha * geometry.largest_speed(curve))}
    return {
        "curve.a": curve.a, "curve.b": curve.b, "curve.harmonics": (), "curve.half_depth": 0.0,
        "formation.phase_rate": rate, "formation.coupling": rate / (0.3 * alpha),
        "formation.p": p, "formation.alpha": alpha, "formation.ring": tuple(range(n)), "formation.displaced": (),
        "formation.start_noise": noise, "robot.count": n,
        **(point if task.robot.kind == "curve" else {}),
    }  # fmt: skip


def on_ellipse(task: Scenario, fastest: float) -> Scenario:
    """Return a task whose robots begin evenly spaced on the ellipse in its rectangle, all in the same sense.

    Args:
        task: The task.
        fastest: Speed of the start where the ellipse is fastest [m/s].
    """
    ellipse = Curve(task.driven.half_width, task.driven.half_height, 1, 1)
    rate = float(f"{fastest / geometry.largest_speed(ellipse):.6g}")
    return named.build(task, **formation_overrides(task, ellipse, rate))
