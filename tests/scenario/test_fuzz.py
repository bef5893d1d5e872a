"""Any value in any field: the scenario is rejected with a one-line ValueError, or runs and stays in its ranges."""

import dataclasses
import math
import re

import numpy as np

import lissajous_env
from lissajous_env.parameters.scenario import PARTS
from lissajous_env.world.columns import COLUMNS

FIELDS = [(part, field) for part, kind in PARTS.items() for field in dataclasses.fields(kind)]
BASES = ("experiment", "intruders", "rough", "failure", "knot", "perturbation")
MAY_BE_NAN = {column.name for column in COLUMNS.values() if column.empty}
STRANGE = (
    None, True, False, "", "1", "nan", b"1", 1j, object, (), [], (0,), ((0, 1),), ((0, 1, 2),), ((1.0, 0.2),), {},
    math.nan, math.inf, -math.inf, 0, 0.0, -0.0, 10**30, -(10**30), 10**400, 2**31, 2**32 + 3, np.float32(2), np.nan,
    ((0, 1e10, 1e11),), ((0, 1.0, math.inf),), ((0, math.nan, 1),), ((-1, 0, 1),), ((2**70, 1, 2),), (1, 1), (4096, 1),
    np.array([1.0, np.nan]), np.ones((2, 2)), "open", "wall", "remove", "stop", "curve", "car", "random", "boundary",
    "unseen",
)  # fmt: skip


def any_value(draw, field):
    """Return a value of any size and kind, or one inside the field's range, its ends among them."""
    kind = draw.integers(4)
    if kind == 0:
        return STRANGE[draw.integers(len(STRANGE))]
    if kind == 1 or not re.search(r"from (\S+) to (\S+)", field.metadata["rule"]):
        value = float(draw.choice([-1, 1]) * 10 ** draw.uniform(-300, 300))
        return int(value) if draw.random() < 0.2 else value
    return within_range(draw, field)


def within_range(draw, field):
    """Return a value inside the range that the rule of a field names, of any order of magnitude; else its default."""
    rule = field.metadata["rule"]
    ends = re.search(r"from (\S+) to (\S+)", rule)
    if ends is None or not rule.startswith("must be") or "(columns" in rule:
        return field.default
    low, high = float(ends[1]), float(ends[2])
    if draw.random() < 0.2:
        value = low if draw.random() < 0.5 else high
    elif low < 0:
        value = draw.uniform(low, high)
    else:
        least = max(low, 1e-6 * high)
        value = least * (high / least) ** draw.random()
    return round(value) if "whole" in rule else float(min(max(value, low), high))


def any_fields(draw):
    """Return overrides of one to three fields with any values, or of many with values inside their ranges."""
    inside = draw.random() < 0.3
    picked = draw.choice(len(FIELDS), draw.integers(*((3, 12) if inside else (1, 4))), replace=False)
    value = within_range if inside else any_value
    return {f"{FIELDS[k][0]}.{FIELDS[k][1].name}": value(draw, FIELDS[k][1]) for k in picked}


def assert_in_range(simulation):
    rows, layout = simulation.observation.numpy(), simulation.layout
    assert np.isfinite(rows).all()
    assert ((rows >= layout.low) & (rows <= layout.high)).all()
    robots, targets = simulation.robots, simulation.targets
    for array in (simulation.reward, simulation.reward_terms, robots.position, robots.heading, robots.speed,
                  robots.phase, targets.position):  # fmt: skip
        assert np.isfinite(array.numpy()).all()
    for row in simulation.score():
        for name, value in row.items():
            assert not isinstance(value, float) or math.isfinite(value) or name in MAY_BE_NAN, name


def play(scenario, draw):
    """Step one or two worlds with random and extreme actions; scenarios of seconds a step are left out."""
    work = scenario.num_robots * (math.prod(scenario.task.grid or (0,)) + scenario.target_capacity)
    if work > 3e7:
        return
    simulation = lissajous_env.Simulation(scenario, int(draw.integers(1, 3)), seed=int(draw.integers(2**31 - 2)))
    for _ in range(min(8, max(int(3e7 // (work + 1)), 1))):
        shape = simulation.action_shape
        extreme = draw.choice([np.nan, np.inf, -np.inf, 1e300, -1e-300, 0.5], shape)
        simulation.step((draw.choice([-1.0, 1.0], shape), extreme, draw.uniform(-1.5, 1.5, shape))[draw.integers(3)])
        assert_in_range(simulation)
    simulation.reset()
    assert_in_range(simulation)


def test_any_value_in_any_field():
    played, errors = 0, []
    for k in range(40):
        draw = np.random.default_rng([7, k])
        overrides, base = any_fields(draw), str(draw.choice(BASES))
        try:
            scenario = lissajous_env.scenario(base, **overrides)
        except ValueError as error:
            errors.append(str(error))
            continue
        play(scenario, draw)
        played += 1
    assert [words for words in errors if not words or words.count("\n") > 2] == []
    assert min(played, len(errors)) > 7, "the test is not idle"
