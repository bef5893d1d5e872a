"""Loops: cars in file around the boundary or up and down lanes, and cars that go around for themselves."""

from baselines.planning.families.lissajous import on_ellipse
from baselines.planning.family import FILTERS, Family, Settings, of_cars_alone
from baselines.planning.plans import Plan, top_speed
from baselines.policies.as_cars import like_cars
from baselines.policies.patrol_path import cruising_speed
from baselines.policies.settings import PolicySettings
from lissajous_env.parameters.scenario import Scenario

_ELLIPSE = "ellipse"
"""Word for robots that begin evenly spaced on an ellipse, all in the same sense, as the file goes around."""
_FASTEST = 0.9
"""Speed of the start on the ellipse where it is fastest, over the top speed."""
_FILE = {"policy": "sweep", "start": _ELLIPSE, "cruise": 0.8}


def patrols(task: Scenario) -> Family:
    """Return loops with their speed, number of lanes and inset: shares of the top speed and of the sensing radius."""
    cars = like_cars(task)
    if cars is None:
        return of_cars_alone("loops", "sweep and laps", task)

    def plan(settings: Settings) -> Plan:
        fastest = min(_FASTEST * top_speed(task), cruising_speed(cars))
        start = on_ellipse(task, fastest) if settings["start"] == _ELLIPSE else task
        cruise = settings["cruise"] * top_speed(task)
        inset = min(settings["inset"] * task.sensing_radius, 0.9 * task.curve.half_height, 0.9 * task.curve.half_width)
        given = {"lanes": settings["lanes"], "inset": float(f"{inset:.4g}"), "cruise": float(f"{cruise:.4g}")}
        about = f"{given['lanes']} lanes, inset {inset:.3g} m, {cruise:.3g} m/s"
        return Plan("loops", start, PolicySettings(settings["policy"], given), about)

    starts = [
        {**_FILE, "lanes": 2, "inset": 0.5},
        {**_FILE, "lanes": 4, "inset": 0.5},
        {**_FILE, "lanes": 2, "inset": 0.5, "policy": "sweep-safe"},
        {**_FILE, "lanes": 2, "inset": 0.1},
        {**_FILE, "lanes": 6, "inset": 0.5},
        {**_FILE, "lanes": 2, "inset": 0.5, "policy": "laps"},
        {**_FILE, "lanes": 2, "inset": 0.5, "start": "task"},
    ]
    space = {
        "policy": [policy + suffix for policy in ("sweep", "laps") for suffix in FILTERS],
        "start": [_ELLIPSE, "task"],
        "lanes": [2, 4, 6, 8],
        "inset": (0.02, 1.5),
        "cruise": (0.3, 1.0),
    }
    return Family("loops", plan, starts, space)
