"""The named scenarios: the paper's, and ours. Any field can be overridden when one is made."""

import dataclasses
import difflib
from collections.abc import Mapping
from typing import Any

import numpy as np

from lissajous_env.parameters.scenario import (
    PARTS,
    Curve,
    Faults,
    Formation,
    Noise,
    Robot,
    Scenario,
    Sensing,
    Targets,
    Task,
)
from lissajous_env.wording import shown

# Section VII prints robots 1 to 5 with R_1 = {2, 4}, R_2 = {1, 5}, R_3 = {4, 5}, R_4 = {1, 3}, R_5 = {2, 3}.
_EXPERIMENT_RING = (0, 1, 4, 2, 3)

# With all targets there from the start, most would be detected before a fault could tell.
_ARRIVING = Targets(count=20, arrival_rate=0.5)

_EXPERIMENT = Scenario(
    name="experiment",
    description="Section VII: five cars on curve (16); robots 1 and 5 stop from 24.5 s to 34.5 s (Fig. 7 and 8).",
    curve=Curve(half_width=1.8, half_height=0.8, a=3, b=2),
    formation=Formation(phase_rate=0.3, coupling=1.0, p=2, ring=_EXPERIMENT_RING, start_noise=0.02),
    robot=Robot(kind="car", radius=0.125, model_offset=3.804),
    faults=Faults(schedule=((0, 24.5, 34.5), (4, 24.5, 34.5))),
    targets=_ARRIVING,
    # Cars that are alike to the last digit would keep the formation without any feedback; real ones do not.
    noise=Noise(wheelbase_spread=0.02, drive_spread=0.02),
    task=Task(duration=60.0),
)

_INTRUDERS = Scenario(
    name="intruders",
    description="Five cars in 10.8 m x 4.8 m with a 0.5 m sensor; rogues enter at the boundary, half of them flee.",
    curve=Curve(half_width=5.4, half_height=2.4, a=3, b=2),
    # omega = 2 m/s / max ||r'||: the fastest stretch of the curve takes the car's top speed.
    formation=Formation(phase_rate=0.118, start="rotated", start_noise=0.02),
    # The throttle limit makes the steady top speed 2 m/s: (36.81 tau - 3.681) / 0.945 = 2.
    robot=Robot(kind="car", radius=0.125, throttle_max=0.151345, lateral_acceleration_max=4.0, model_offset=3.804),
    sensing=Sensing(radius=0.5),
    targets=Targets(
        count=0,
        arrival_rate=0.5,
        entry="boundary",
        wandering=0.5,
        fleeing=0.5,
        speed=0.15,
        flee_radius=0.9,
        flee_speed=0.6,
    ),
    task=Task(duration=60.0),
)

_SCENARIOS = (
    Scenario(
        name="ideal",
        description="Fig. 2 and 3: 15 points on the curve in equilibrium, 10,000 moving targets from the start.",
        curve=Curve(half_width=5.0, half_height=5.0, a=7, b=8),
        formation=Formation(phase_rate=0.05, p=7),
        robot=Robot(kind="curve", radius=0.09),
        sensing=Sensing(targets_seen=0),
        targets=Targets(count=10_000, wandering=1.0, speed=0.2),
        task=Task(duration=10.0),
    ),
    Scenario(
        name="perturbation",
        description="Fig. 4: ten points on the curve, robot 1 displaced along it by 0.25 rad.",
        curve=Curve(half_width=5.0, half_height=5.0, a=7, b=3),
        formation=Formation(phase_rate=0.3, p=3, displaced=((0, 0.25),)),
        robot=Robot(kind="curve", radius=0.125),
        task=Task(duration=30.0),
    ),
    Scenario(
        name="failure",
        description="Fig. 6: five points on curve (16), robots 1 and 2 stuck from 9.6 s to 19.5 s.",
        curve=Curve(half_width=1.8, half_height=0.8, a=3, b=2),
        formation=Formation(phase_rate=0.3, p=2, start="rotated"),
        robot=Robot(kind="curve", radius=0.125),
        targets=_ARRIVING,
        faults=Faults(schedule=((0, 9.6, 19.5), (1, 9.6, 19.5))),
        task=Task(duration=30.0),
    ),
    _EXPERIMENT,
    dataclasses.replace(
        _EXPERIMENT,
        name="experiment-printed",
        description="Section VII with the constants as printed (beta = 0.94): infeasible, cars leave the rectangle.",
        robot=Robot(kind="car", radius=0.125, drag=0.94, drive=36.8, offset=0.94, dead_zone=0.0),
    ),
    _INTRUDERS,
    dataclasses.replace(
        _EXPERIMENT,
        name="rough",
        description="The experiment with noise, uneven cars, lost and late messages, random faults, one robot lost.",
        formation=dataclasses.replace(_EXPERIMENT.formation, start="rotated", start_noise=0.1),
        faults=Faults(rate=0.01, mean_duration=5.0, lost=1),
        noise=Noise(
            actuator=0.05,
            position=0.01,
            heading=0.02,
            speed=0.02,
            wheelbase_spread=0.05,
            drive_spread=0.02,
            message_loss=0.1,
            message_delay=0.1,
        ),
    ),
    Scenario(
        name="knot",
        description="Section IV-A: the failure of Fig. 6 on the knot (10) with z = 0.8 sin(7 gamma), points in space.",
        curve=Curve(half_width=1.8, half_height=0.8, a=3, b=2, half_depth=0.8, c=7),
        formation=Formation(phase_rate=0.3, p=2, start="rotated"),
        robot=Robot(kind="curve", radius=0.125),
        targets=_ARRIVING,
        faults=Faults(schedule=((0, 9.6, 19.5), (1, 9.6, 19.5))),
        task=Task(duration=30.0),
    ),
    Scenario(
        name="swarm",
        description="101 points on the curve in 40 m x 25 m, 2,000 targets.",
        curve=Curve(half_width=20.0, half_height=12.5, a=51, b=50),
        formation=Formation(phase_rate=0.02, start="rotated"),
        robot=Robot(kind="curve", radius=0.006),
        targets=Targets(count=2000),
        task=Task(duration=30.0, grid=(80, 50)),
    ),
)

_BY_NAME = {each.name: each for each in _SCENARIOS}

_MOST_STEPS = 2**20
"""Steps of the longest episode."""


class UnknownSettingError(ValueError, TypeError):
    """A setting that no part of a scenario has.

    It is a `ValueError`, as every wrong setting, and a `TypeError`, as every unexpected keyword argument: libraries
    that try which keywords an environment takes go on from that.
    """


def scenarios() -> tuple[str, ...]:
    """Names of the scenarios that ship with the package."""
    return tuple(_BY_NAME)


def scenario(name: str | Scenario, /, **overrides: Any) -> Scenario:
    """Make a named scenario, with any field overridden.

    Overrides are dotted (`**{"curve.a": 11}`) or nested (`curve={"a": 11}`, `curve=Curve(...)`); also takes a
    `Scenario` to override.

    Raises:
        UnknownSettingError: an unknown field; the message offers the nearest.
        ValueError: an unknown scenario, or a value that a rule forbids.
    """
    if isinstance(name, Scenario):
        base = name
    elif isinstance(name, str) and name in _BY_NAME:
        base = _BY_NAME[name]
    else:
        raise ValueError(f"scenario must be one of {', '.join(_BY_NAME)}, got {shown(name)}{_nearest(name, _BY_NAME)}")
    whole: dict[str, Any] = {}
    changed: dict[str, dict[str, Any]] = {}
    for key, value in overrides.items():
        part, dot, field = key.partition(".")
        if key == "extensions":
            whole[key] = value
            continue
        if part not in PARTS:
            # The last words are Python's own, by which TorchRL knows a keyword that it may leave out.
            raise UnknownSettingError(
                f"override must name one of {', '.join(PARTS)}, got {key!r}{_nearest(part, PARTS)} "
                f"(unexpected keyword argument {key!r})"
            )
        if not dot and isinstance(value, PARTS[part]):
            whole[part] = value
            continue
        if not dot and not isinstance(value, Mapping):
            raise ValueError(f"override {part} must be a mapping or a {PARTS[part].__name__}, got {shown(value)}")
        fields = {field: value} if dot else dict(value)
        known = [f.name for f in dataclasses.fields(PARTS[part])]
        for field_name in fields:
            if field_name not in known:
                raise UnknownSettingError(
                    f"override must name a field of {part} ({', '.join(known)}), got {part}.{field_name}"
                    f"{_nearest(field_name, known)}"
                )
        changed.setdefault(part, {}).update(fields)
    for part, fields in changed.items():
        whole[part] = dataclasses.replace(whole.get(part, getattr(base, part)), **fields)
    return dataclasses.replace(base, **whole)


def with_cycles(made: Scenario, max_cycles: int | None) -> Scenario:
    """Give a scenario an episode of so many steps in place of its `task.duration`; None leaves it as it is.

    Raises:
        ValueError: not a whole number from 1 to 2^20.
    """
    if max_cycles is None:
        return made
    whole = isinstance(max_cycles, (int, np.integer)) and not isinstance(max_cycles, bool)
    if not whole or not 1 <= max_cycles <= _MOST_STEPS:
        raise ValueError(f"max_cycles must be a whole number from 1 to {_MOST_STEPS}, got {shown(max_cycles)}")
    return scenario(made, **{"task.duration": int(max_cycles) * made.task.step})


def _nearest(word: Any, words: Any) -> str:
    match = difflib.get_close_matches(str(word), list(words), n=1, cutoff=0.0)
    return f"; did you mean {match[0]}?" if match else ""
