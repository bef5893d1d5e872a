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


@pytest.mark.parametrize("attack", ["actions", "resets", "batch_law", "overflow"])
def test_other_attacks(attack):
    assert failures(getattr(core, attack), 12) == []
