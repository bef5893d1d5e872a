"""Torch tensors as input and output, with the same numbers as NumPy arrays; and networks in torch."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from test_mpcc import CURVE, P, load_benchmark  # noqa: E402
from test_policy_laws import CASES, episode  # noqa: E402

import baselines  # noqa: E402
from baselines.mpcc.solver import Mpcc  # noqa: E402


@pytest.mark.parametrize(("name", "scenario"), CASES)
def test_actions_for_tensors_are_those_for_arrays(name, scenario):
    # Oracle: the policy that was given the same observations as arrays.
    seen, actions = episode(baselines.make(name, scenario, 16), scenario, 16, seed=40)
    policy = baselines.make(name, scenario, 16)
    for rows, action in zip(seen, actions, strict=True):
        got = policy.act(torch.from_numpy(rows))
        assert isinstance(got, torch.Tensor)
        np.testing.assert_array_equal(got.numpy(), action)


def test_the_solver_takes_tensors_as_arrays():
    near = load_benchmark().random_problems(64, CURVE, P, np.random.default_rng(3))
    expected = Mpcc(CURVE, P, 64).solve(near.state, near.phase_rate)
    solution = Mpcc(CURVE, P, 64).solve(torch.from_numpy(near.state), torch.from_numpy(near.phase_rate))
    np.testing.assert_array_equal(solution.control.numpy(), expected.control)
