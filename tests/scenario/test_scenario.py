"""Scenarios: every field refuses what its rule forbids, overrides find their field, numbers do not change unnoticed."""

import dataclasses
import json
import math
import re
from decimal import Decimal
from typing import Any

import numpy as np
import pytest

import lissajous_env
from lissajous_env.parameters.scenario import PARTS, Curve, Formation, Scenario, Task
from lissajous_env.theory import closed_forms

# Digests of all numbers of the scenarios that ship: a line that differs is a number that changed.
DIGESTS = {
    "ideal": "c6f5bd24a1e153e2",
    "perturbation": "8bda1adb0ccf2c85",
    "failure": "1c88657e2075d6a9",
    "experiment": "dce49c50117f2bfe",
    "experiment-printed": "d4c3f6cd134c41de",
    "intruders": "77bbd1e623cd9cb7",
    "intruders-walls": "8d94fa0c9776affd",
    "intruders-inside": "f4dc476d378a42b0",
    "evaders": "01d27d5ed0b059ad",
    "evaders-failure": "0ad29e21c1188811",
    "evaders-lost": "1513b737631f7faf",
    "evaders-fast": "d96deb5fedd1c691",
    "evaders-uneven": "fc40d7233d422e3c",
    "hall": "15824bfc2c07ca0c",
    "evaders-walls": "8e5593b3682107b8",
    "rough": "1161d3dbf4917ba6",
    "rough-lost": "0c8849f1d0de71f9",
    "team": "433717f53e7589fd",
    "redundant": "fbdccc8f1b05adec",
    "knot": "f738b45d5be0bbce",
    "swarm": "1d930c6b2fd28c91",
    "city": "ddad9ccf46874121",
    "watch": "a3fb1c95674aa224",
    "intercept": "e048b518cb991beb",
    "hotspots": "dadcf7f587c41c76",
}

KINDS: dict[str, Any] = dict(PARTS)
FIELDS = [(part, field) for part, kind in PARTS.items() for field in dataclasses.fields(kind)]
FIELD_NAMES = [f"{part}.{field.name}" for part, field in FIELDS]

# What no field takes, whatever its rule: also values that are easily mistaken for a number.
WRONG_FOR_ALL = [math.nan, -math.inf, "nonsense", object(), 1j, b"1", {"a": 1}, np.array([1.0, np.nan]), (0.5, "x")]
BAD_ROWS = {
    "formation.ring": [(0, -1), (0, 1.5), (False, True), ("0", "1"), 5, [[0], [1]]],
    "formation.displaced": [(0, 0.25), ((0, math.nan),), ((0, 1e39),), ((-1, 0.1),), ((0.5, 0.1),), ((0,),), None],
    "robot.drive_factors": [(0, 1.1), ((0, 0.0),), ((0, 11.0),), ((0, math.nan),), ((-1, 1.0),), ((0,),), None],
    "faults.schedule": [
        (0, 1.0, 2.0), ((0, 2.0, 1.0),), ((0, -1.0, 2.0),), ((0, math.nan, 2.0),), ((-1, 1.0, 2.0),),
        ((True, 1.0, 2.0),), ((0, 1e10, 1e11),), ((0, 1.0, 10**400),), None,
    ],
    "faults.removed": [(0, 5.0), ((0, -1.0),), ((0, math.inf),), ((0.5, 1.0),), None],
    "sensing.cells_seen": [(0, 16), (36, 65), (36.5, 16), (36,), (1, 2, 3), 36],
    "task.grid": [(0, 16), (36, 4097), (36.5, 16), (36,), (1, 2, 3), 36],
    "task.contamination": [(0, 16), (36, 4097), (36.5, 16), (36,), (1, 2, 3), 36],
}  # fmt: skip


def bad_values(name, rule):
    """Out-of-range values for a rule as it is printed: the rule's own words are the oracle."""
    if name in BAD_ROWS:
        return BAD_ROWS[name]
    ends = re.search(r"from (\S+) to (\S+)", rule)
    if ends is not None and "whole number" in rule:
        low, high = int(ends[1]), int(ends[2])
        return [low - 1, low + 0.5, float(low), True, high + 2, -(10**400), 10**30] + ([2, 10] if "odd" in rule else [])
    if ends is not None:
        low, high = float(ends[1]), float(ends[2])
        bad = [math.nextafter(low, -math.inf), math.nextafter(high, math.inf), -1e300, True, 10**400, -(10**30)]
        return (
            bad
            + ([0, 1e-300] if low > 0 and "0 or" not in rule else [])
            + ([math.inf] if "infinite" not in rule else [])
        )
    if "one of" in rule:
        return ["", rule.split()[-1].upper(), 1, ["car"], True]
    if "name of" in rule:
        return ["", " car", 1, ["car"], True]
    if "True or False" in rule:
        return [0, 1, "True", np.array([True, False])]
    raise AssertionError(f"a rule that this test does not know: {rule}")


@pytest.mark.parametrize(("part", "field"), FIELDS, ids=FIELD_NAMES)
def test_every_field_refuses_what_its_rule_forbids(part, field):
    assert "rule" in field.metadata, "every field declares its rule"
    name = f"{part}.{field.name}"
    for value in bad_values(name, field.metadata["rule"]) + WRONG_FOR_ALL:
        if name in ("robot.kind", "targets.rogues") and isinstance(value, str) and value == "nonsense":
            continue  # a word; the scenario checks that it is registered
        with pytest.raises(ValueError) as refused:
            KINDS[part](**{field.name: value})
        got = repr(value) if len(repr(value)) <= 160 else f"{repr(value)[:157]}..."
        assert str(refused.value) == f"{name} {field.metadata['rule']}, got {got}"


@pytest.mark.parametrize(("part", "field"), FIELDS, ids=FIELD_NAMES)
def test_none_is_only_for_fields_that_are_derived_or_switched_off(part, field):
    # Oracle: the annotation says which.
    if "None" in str(field.type):
        assert getattr(KINDS[part](**{field.name: None}), field.name) is None
    else:
        with pytest.raises(ValueError, match=rf"^{part}\.{field.name} must .*, got None$"):
            KINDS[part](**{field.name: None})


TOGETHER = [
    ({"curve.a": 3, "curve.b": 6}, "curve.b must share no factor with a = 3, got 6"),
    ({"robot.throttle_max": 0.05}, "robot.throttle_max must be above throttle_min and dead_zone, 0.1, got 0.05"),
    ({"robot.throttle_max": 0.3, "robot.dead_zone": 0.3}, "robot.throttle_max must be above throttle_min and dead_zo"),
    ({"robot.drive": 1.0}, "robot.throttle_max must lead to a top speed, (drive throttle_max - offset) / drag, from"),
    ({"targets.wandering": 0.6, "targets.fleeing": 0.5}, "targets.fleeing must not make drifting + wandering + fl"),
    ({"task.duration": 0.05}, "task.duration must be at least one step of 0.1 s, got 0.05"),
    ({"task.duration": 1e8, "task.step": 1e-3}, "task.duration must be at most 1048576 steps, got 100000000.0"),
    ({"formation.ring": (0, 1, 2, 3, 3)}, "formation.ring must contain each of the 5 robots"),
    ({"formation.displaced": ((5, 0.1),)}, "formation.displaced must name robots 0 to 4"),
    ({"faults.schedule": ((7, 1.0, 2.0),)}, "faults.schedule must name robots 0 to 4, got (7,)"),
    ({"faults.lost": 6}, "faults.lost must be at most the 5 robots, got 6"),
    ({"curve.half_depth": 1.0}, "curve.half_depth must be 0 for cars [m], got 1.0"),
    ({"targets.arrival_rate": 1e5}, "targets.arrival_rate must bring at most 2097152 targets"),
    ({"curve.a": 1023, "curve.b": 1022}, "robot.count must be given, from 1 to 1024, because a + b is 2045"),
    ({"robot.drag": 60.0, "robot.drive": 1e4}, "robot.drag must be at most 50 with integration steps of"),
    ({"formation.phase_rate": 1e3, "curve.half_width": 1e3}, "formation.phase_rate must keep cars"),
    ({"robot.wheelbase": 1e-3, "robot.steering_max": 1.57}, "robot.wheelbase must keep a car's turn in"),
    ({"noise.message_delay": 0.04}, "noise.message_delay must be 0 or from 1 to 1000 steps"),
    ({"robot.kind": "boat"}, "robot.kind must be one of car, .*, curve, or one that --import adds, got 'boat'"),
    ({"curve.inset": 0.8}, "curve.inset must be below 0.8, half of the rectangle's side"),
    ({"curve.inset": 0.7, "sensing.radius": 0.6}, "sensing.radius must be at least the inset of 0.7"),
    ({"task.boundary": "wall", "robot.radius": 0.9}, "robot.radius must be below 0.8"),
    ({"curv.a": 3}, "override must name one of curve, formation, .*, got 'curv.a'; did you mean curve"),
    ({"wheels": 3}, "override must name one of .*, got 'wheels'; did you mean "),
    ({"robot": {1: 2}}, "override must name one of .*, got 'robot.1'"),
    ({"curve.": 3}, "override must name one of .*, got 'curve.'"),
    ({"curve": 3}, "override curve must be a mapping or a Curve, got 3"),
    ({"curve": Task()}, "override curve must be a mapping or a Curve, got Task"),
    ({"curve.a": Curve()}, "curve.a must be an odd whole number from 1 to 1023, got Curve"),
]


@pytest.mark.parametrize(("fields", "message"), TOGETHER, ids=[message.split()[0] for _, message in TOGETHER])
def test_rules_that_join_fields_and_fields_that_are_none(fields, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message).replace(re.escape('.*'), '.*')}"):
        lissajous_env.scenario(Scenario(), **fields)


@pytest.mark.parametrize(
    ("part", "got", "kind"), [("name", 3, "text"), ("robot", None, "a Robot"), ("noise", Task(), "a Noise")]
)
def test_parts_have_their_types(part, got, kind):
    with pytest.raises(ValueError, match=rf"^{part} must be {kind}, got {re.escape(repr(got)[:9])}"):
        Scenario(**{part: got})


def test_numbers_of_any_make_become_plain_ones():
    # Oracle: the same scenario made of Python's own numbers, by equality, hash and digest.
    plain = lissajous_env.scenario("ideal", **{"curve.half_width": 6.0, "curve.a": 7, "task.grid": (3, 4)})
    for whole, number in [(np.int64, np.float32), (np.int8, Decimal), (int, int)]:
        other = lissajous_env.scenario(
            "ideal", **{"curve.half_width": number(6), "curve.a": whole(7), "task.grid": [whole(3), whole(4)]}
        )
        assert other == plain
        assert hash(other) == hash(plain)
        assert other.digest() == plain.digest()
        assert type(other.curve.half_width) is float
        assert type(other.curve.a) is int
    assert Formation(ring=np.arange(3)).ring == (0, 1, 2)  # type: ignore[arg-type]


# Overrides.


def test_overrides_dotted_and_nested_are_the_same():
    changes = {"curve.a": 11, "curve.b": 4, "task.duration": 20}
    dotted = lissajous_env.scenario("ideal", **changes)
    nested = lissajous_env.scenario("ideal", curve={"a": 11, "b": 4}, task={"duration": 20.0})
    whole = lissajous_env.scenario("ideal", curve=Curve(5.0, 5.0, 11, 4), **{"task.duration": 20})
    assert dotted == nested == whole
    assert dotted.digest() == nested.digest()
    assert (dotted.curve.a, dotted.curve.b, dotted.curve.half_width, dotted.task.duration) == (11, 4, 5.0, 20.0)
    assert dotted.targets == lissajous_env.scenario("ideal").targets
    assert lissajous_env.scenario(lissajous_env.scenario("ideal"), **changes) == dotted


# What ships.

FOLLOWING = ("sensing.sight", "targets.speed_min")
"""Fields that remain None, so that they follow an override of the radius, or of the speed."""


def test_digests_of_what_ships_and_the_printed_ring():
    assert {name: lissajous_env.scenario(name).digest() for name in lissajous_env.scenarios()} == DIGESTS
    # Oracle: Section VII, R_1 = {2, 4}, R_2 = {1, 5}, R_3 = {4, 5}, R_4 = {1, 3}, R_5 = {2, 3}.
    neighbours = lissajous_env.scenario("experiment").neighbours + 1
    assert [set(pair) for pair in neighbours.tolist()] == [{2, 4}, {1, 5}, {4, 5}, {1, 3}, {2, 3}]


@pytest.mark.parametrize("name", lissajous_env.scenarios())
def test_resolve_fills_everything_in_once(name):
    scenario = lissajous_env.scenario(name)
    resolved = scenario.resolve()
    assert resolved.resolve() == resolved
    assert resolved.resolve().digest() == resolved.digest()
    nothing = {f"{part}.{field}" for part in PARTS for field, v in resolved.to_dict()[part].items() if v is None}
    off = {"sensing.cells_seen", "task.grid", "task.contamination", "targets.rogues", "targets.sight"}
    assert nothing <= off | {*FOLLOWING}
    for derived in ("num_robots", "p", "alpha", "clusters", "ring", "detection_time_bound", "target_capacity"):
        assert getattr(resolved, derived) == getattr(scenario, derived)
    assert np.array_equal(resolved.neighbours, scenario.neighbours)
    assert np.array_equal(resolved.equilibrium, scenario.equilibrium)
    assert json.loads(json.dumps(resolved.to_dict()))["name"] == name


def test_digest_is_of_the_numbers_alone():
    base = Scenario()
    assert Scenario(name="other", description="words").digest() == base.digest()
    assert dataclasses.replace(base, task=Task(duration=60)).digest() == base.digest()
    seen = {base.digest(), base.resolve().digest()}
    changes = {"curve.half_width": 1.8000001, "faults.schedule": ((0, 1.0, 2.0),), "task.grid": None}
    for name, value in changes.items():
        digest = lissajous_env.scenario(base, **{name: value}).digest()
        assert digest not in seen
        seen.add(digest)


@pytest.mark.parametrize("name", lissajous_env.scenarios())
def test_what_ships_is_a_formation_that_works(name):
    # Oracle: Theorem 1, Lemma 1, the alpha rule, (6) and (8).
    scenario = lissajous_env.scenario(name)
    n = scenario.num_robots
    places, clusters = scenario.curve.a + scenario.curve.b, 2 if name == "redundant" else 1
    assert (n, scenario.clusters) == (clusters * places, clusters)
    assert n < 4 * scenario.p < 3 * n
    assert closed_forms.ring_lies_on_ellipse(scenario.curve, places, scenario.p // clusters, scenario.alpha)
    if name != "evaders-walls":  # the curve that fits between its walls is too small for (6): 0.122 m
        assert scenario.robot.radius < scenario.robot_radius_bound
    too_short = "intruders", "evaders", "hall", "watch", "intercept", "hotspots"
    if not name.startswith(too_short):  # their sensors are too short for (8) on purpose
        assert scenario.resolve().sensing.radius == pytest.approx(scenario.detection_radius)


@pytest.mark.parametrize("curve", [Curve(20, 12.5, 3, 2), Curve(20, 12.5, harmonics=((6, 0, 0, 4), (0, 2, 1, 0)))])
def test_a_curve_with_an_inset_is_that_of_the_rectangle_without_the_strip(curve):
    # Law: scaled to its own rectangle, the curve that is driven is the same curve.
    inset = dataclasses.replace(curve, inset=1.5)
    gamma = np.linspace(0, 2 * np.pi, 100)
    size, smaller = np.array([20, 12.5]), np.array([18.5, 11])
    driven = closed_forms.curve_point(inset.driven, gamma)
    np.testing.assert_allclose(driven / smaller, closed_forms.curve_point(curve, gamma) / size, atol=1e-12)
    assert inset.driven.driven == inset.driven
    assert curve.driven is curve


def test_walls_bring_an_inset_that_scales_with_lengths_and_times():
    walled = lissajous_env.scenario("evaders", **{"task.boundary": "wall", "noise.position": 0.01})
    assert lissajous_env.scenario("evaders").inset == 0
    assert walled.inset > walled.robot.radius + 0.03
    assert walled.scaled(3.0, 2.0).inset == pytest.approx(3 * walled.inset)
    assert walled.resolve().curve.inset == walled.inset
    assert walled.resolve().resolve() == walled.resolve()
