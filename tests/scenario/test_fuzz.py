"""Any value in any field: the scenario is rejected with a one-line ValueError, or runs and stays finite."""

import numpy as np
import pytest

from tests.adversarial import core


def failures(attempt, tries, first=0):
    seen = ((k, attempt(np.random.default_rng([7, k]))) for k in range(first, first + tries))
    return [f"try {k}: {words}" for k, words in seen if words is not None]


def test_any_value_in_any_field():
    assert failures(core.fields, 60) == []


def test_the_fuzz_is_not_idle():
    # Guard of the test above: many draws are refused, many run. Oracle: counts.
    made = 0
    for k in range(60):
        draw = np.random.default_rng([7, k])
        overrides, base = core.any_fields(draw), str(draw.choice(core.BASES))
        try:
            core.lissajous_env.scenario(base, **overrides)
            made += 1
        except ValueError:
            pass
    assert 10 <= made <= 50


@pytest.mark.parametrize(
    "overrides",
    [
        {"formation.coupling": 1e39},
        {"curve.half_width": 1e20},
        {"robot.wheelbase": 1e-30},
        {"noise.heading": 1e39},
        {"task.reward_detection": 1e39},
        {"robot.drive": 1e12},
        {"formation.p": 10**30},
        {"task.step": 1e-12},
        {"formation.alpha": 2**32 + 3},
        {"curve.a": 10**9 + 1},
        {"faults.schedule": ((0, 1e10, 1e11),)},
        {"robot.drag": 1e3, "task.step": 1.0},
        {"targets.arrival_rate": 1e5},
    ],
    ids=lambda overrides: next(iter(overrides)),
)
def test_numbers_that_gave_nan_or_nonsense_are_refused(overrides):
    name, value = next(iter(overrides.items()))
    with pytest.raises(ValueError, match=rf"^{name} must .*, got ") as refused:
        core.lissajous_env.scenario("experiment", **overrides)
    assert repr(value)[:10] in str(refused.value)


@pytest.mark.parametrize("attack", ["actions", "resets", "batch_law", "overflow"])
def test_other_attacks(attack):
    assert failures(getattr(core, attack), 12) == []


@pytest.mark.long
def test_three_thousand_values():
    assert failures(core.fields, 3000, first=1000) == []
