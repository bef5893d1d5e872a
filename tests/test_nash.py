"""Nash averaging of teams against rogues, tested by laws of zero-sum games."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from baselines.exploitability.nash import equilibrium

TIMES = hnp.arrays(
    float, st.tuples(st.integers(1, 5), st.integers(1, 5)), elements=st.integers(0, 60).map(lambda x: x / 2)
)


def test_matching_pennies_are_mixed_evenly():
    # Oracle: the textbook; the value is the mean.
    found = equilibrium(np.array([[0.0, 10.0], [10.0, 0.0]]))
    assert found.teams == pytest.approx([0.5, 0.5], abs=1e-5)
    assert found.rogues == pytest.approx([0.5, 0.5], abs=1e-5)
    assert found.value == pytest.approx(5.0)


@settings(max_examples=30, deadline=None)
@given(TIMES)
def test_no_side_gains_by_another_choice(times):
    # Law: an equilibrium; no NaN, also where rows or columns have no spread.
    found = equilibrium(times)
    assert found.teams.sum() == pytest.approx(1.0)
    assert found.rogues.sum() == pytest.approx(1.0)
    assert min(found.teams.min(), found.rogues.min()) >= 0
    assert found.against_rogues.min() == pytest.approx(found.value, abs=1e-3)
    assert found.against_teams.max() == pytest.approx(found.value, abs=1e-3)


@settings(max_examples=20, deadline=None)
@given(TIMES, st.randoms(use_true_random=False))
def test_the_order_does_not_matter(times, draw):
    # Law: permuted teams and rogues have permuted averages.
    rows, columns = (draw.sample(range(n), n) for n in times.shape)
    first, second = equilibrium(times), equilibrium(times[rows][:, columns])
    assert second.value == pytest.approx(first.value, abs=1e-3)
    assert second.teams == pytest.approx(first.teams[rows], abs=0.02)
    assert second.rogues == pytest.approx(first.rogues[columns], abs=0.02)


@settings(max_examples=20, deadline=None)
@given(TIMES)
def test_a_copy_of_a_team_changes_no_value(times):
    # Law: a copy shares the probability of its original, and all values stay.
    first, second = equilibrium(times), equilibrium(np.vstack([times, times[:1]]))
    assert second.value == pytest.approx(first.value, abs=1e-3)
    assert second.rogues == pytest.approx(first.rogues, abs=0.02)
    assert second.against_rogues[:-1] == pytest.approx(first.against_rogues, abs=0.6)
    assert second.teams[0] == pytest.approx(second.teams[-1], abs=0.02)


def test_a_dominated_team_and_a_dominated_rogue_have_no_probability():
    # Story: the third team is worse than the first against all, the third rogue better detected by all than the first.
    times = np.array([[1.0, 5.0, 0.5], [5.0, 1.0, 4.0], [2.0, 6.0, 1.5]])
    found = equilibrium(times)
    assert found.teams[2] == 0
    assert found.rogues[2] == 0
    assert found.teams[:2] == pytest.approx([0.5, 0.5], abs=1e-4)


def test_a_column_without_spread_is_no_number_that_is_missing():
    # Story: all teams do the same against the second rogue, and in a game of equal times all mixtures are even.
    found = equilibrium(np.array([[1.0, 2.0], [3.0, 2.0]]))
    assert np.isfinite([found.value, *found.against_rogues, *found.against_teams]).all()
    assert found.value == pytest.approx(2.0)
    flat = equilibrium(np.full((3, 2), 7.0))
    assert flat.value == pytest.approx(7.0)
    assert flat.teams == pytest.approx([1 / 3] * 3)


def test_times_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="times must be finite"):
        equilibrium(np.array([[1.0, np.nan]]))
    with pytest.raises(ValueError, match=r"times must be of shape \(teams, rogues\), both at least 1, got \(0, 3\)"):
        equilibrium(np.zeros((0, 3)))
