"""Policies of cars with their parameters changed: partitions, lines, and loops around the boundary or in lanes."""

from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any

from baselines.planning.families.lissajous import on_ellipse
from baselines.planning.plans import FILTERS, Choices, Family, Plan, Settings, absolute, top_speed
from baselines.policies.as_cars import like_cars
from baselines.policies.line_path import why_inside
from baselines.policies.settings import PolicySettings
from lissajous_env.parameters.scenario import Scenario

_STARTS = [0.0, 0.5, 0.7, 0.9]
"""Speeds of a start on an ellipse where it is fastest, over the top speed; 0 for the start of the task."""
_LATE = 1.2
"""Clearance for which a partition is planned, over the one that is asked for: cars are not exactly on their loops."""


def partitions(task: Scenario, clearance: float | None = None) -> Family:
    """Return partitions, by the speed and the division of the rectangle.

    Args:
        task: The task.
        clearance: Least distance of two bodies [m]; partitions without one keep a body's radius between them.
    """
    apart = _LATE * (clearance or 0.0)
    given = {"clearance": float(f"{apart:.4g}")} if apart > task.robot.radius else {}
    first = ({"speed": 0.9}, {"speed": 0.9, "start": 0.7}, {"speed": 0.6}, {"speed": 0.97}, {"speed": 0.8})
    extents: list[Any] = [0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9]
    return timed(task, "partition", ("partition", "partition-repair"), first, {
        "speed": (0.3, 1.0),
        "rows": list(range(1, task.num_robots + 1)),
        "extent_x": extents,
        "extent_y": extents,
        "lanes": [2, 4, 6],
    }, given)  # fmt: skip


def lines(task: Scenario) -> Family:
    """Return lines of cars side by side, by the speed, the number of lines and their turns."""
    if reason := why_inside(task.resolve()):
        return Family("lines", refusal=reason)
    first = ({"lines": 1}, {"lines": 2}, {"speed": 0.6}, {"lines": 3}, {"speed": 0.8})
    return timed(task, "lines", ("line-abreast",), first, {
        "speed": (0.3, 0.98),
        "lines": list(range(1, min(task.num_robots, 4) + 1)),
        "grip": (0.4, 1.0),
        "settle": [0.0, 0.1, 0.25, 0.5],
    })  # fmt: skip


def patrols(task: Scenario) -> Family:
    """Return loops of cars in file or for themselves, by their speed, number of lanes and inset."""
    first = (
        {"cruise": 0.8, "lanes": lanes, "inset": inset, "start": start}
        for lanes, inset, start in ((2, 0.5, 0.9), (4, 0.5, 0.9), (2, 0.1, 0.9), (6, 0.5, 0.9), (2, 0.5, 0.0))
    )
    return timed(task, "loops", ("sweep", "laps"), tuple(first), {
        "policy": [policy + suffix for policy in ("sweep", "laps") for suffix in FILTERS],
        "cruise": (0.3, 1.0),
        "lanes": [2, 4, 6, 8],
        "inset": (0.02, 1.5),
    })  # fmt: skip


def timed(
    task: Scenario,
    name: str,
    policies: Sequence[str],
    first: Sequence[Settings],
    parameters: Mapping[str, Choices],
    fixed: Settings = MappingProxyType({}),
) -> Family:
    """Return a family of policies by their parameters, in the units of `baselines.planning.plans.UNITS`.

    Args:
        task: The task.
        name: Name of the family.
        policies: Policies of cars.
        first: Parameters that are tried first with each policy, the defaults aside.
        parameters: Values that the parameters may have, and those of `policy` if there are more than the first ones.
        fixed: Parameters that all plans have.
    """
    if like_cars(task) is None:
        kind = f"the robots are of kind {task.robot.kind} (give a turning radius)"
        return Family(name, refusal=f"{' and '.join(policies)} drive cars, and {kind}")
    starts = [{"policy": policy, **fixed, **given} for given in first for policy in policies]
    space = {"policy": list(policies), "start": _STARTS, **parameters}
    return Family(name, partial(_plan, task, name), starts, space)


def _plan(task: Scenario, name: str, settings: Settings) -> Plan:
    """Return the policy with the parameters, on the task with another start if one is given."""
    shares = {key: value for key, value in settings.items() if key not in ("policy", "start")}
    start = settings.get("start", 0.0) * top_speed(task)
    policy = absolute(PolicySettings(settings["policy"], shares), task, digits=4)
    about = ", ".join(f"{key.replace('_', ' ')} {_short(value)}" for key, value in policy.parameters.items())
    about += f", start on an ellipse at {start:.3g} m/s" if start else ""
    return Plan(name, on_ellipse(task, start) if start else task, policy, about)


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
