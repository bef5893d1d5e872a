"""Parsing of `--set`: literals, which are never executed, words, infinity."""

import math

import pytest

from lissajous_env.console.terminal import parse_overrides


def test_overrides_are_literals_words_and_infinity():
    given = [["curve.a=5", "task.grid=(4, 2)"], ["formation.start=random", "task.duration=inf", "robot.count=None"]]
    assert parse_overrides(given) == {
        "curve.a": 5, "task.grid": (4, 2), "formation.start": "random", "task.duration": float("inf"),
        "robot.count": None,
    }  # fmt: skip


@pytest.mark.parametrize("entry", ["curve.a", "=3", "curve.a=3 +", "curve.a=__import__('os')"])
def test_an_override_that_is_no_value_is_refused(entry):
    with pytest.raises(ValueError, match="--set"):
        parse_overrides([[entry]])


@pytest.mark.parametrize(
    ("text", "value"),
    [("((0,1,inf),)", ((0, 1, math.inf),)), ("-inf", -math.inf), ("[inf, -inf]", [math.inf, -math.inf]), ("+3", 3),
     ("-(-(2))", 2), ("2 * 30", 60),
     ("{'a': inf}", {"a": math.inf}), ("'inf'", "inf"), ("infinite", "infinite"), ("True", True)],
)  # fmt: skip
def test_infinity_may_stand_inside_a_literal(text, value):
    assert parse_overrides([[f"curve.a={text}"]]) == {"curve.a": value}


@pytest.mark.parametrize("text", ["nan", "-nan", "((0, nan),)", "1j", "b''", "f''", "{**{}}", "...", "{1}"])
def test_what_is_no_literal_is_no_value(text):
    with pytest.raises(ValueError, match=r"--set curve\.a must be given"):
        parse_overrides([[f"curve.a={text}"]])
