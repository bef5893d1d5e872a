"""Messages of policies: refused ones, discrete ones, and trainings in which robots speak."""

import numpy as np
import pytest

import lissajous_env
from lissajous_env.envs.sides import action_table

TALKING = {"scenario": "failure", "messages.size": 4, "task.duration": 2.0}


@pytest.mark.parametrize("agents_as_rows", [False, True])
def test_discrete_actions_send_what_the_table_says(agents_as_rows):
    # Oracle: the rows of the table.
    env = lissajous_env.vector_env(num_envs=2, discrete_actions=True, agents_as_rows=agents_as_rows, **TALKING)
    table = action_table(env.scenario)
    env.reset(seed=0)
    chosen = np.random.default_rng(1).integers(0, len(table), (2, 5))
    space = env.single_action_space
    assert (space.n if agents_as_rows else space.nvec[0]) == len(table) == 7 * 5
    rows = env.step(chosen.reshape(env.action_space.shape))[0].reshape(2, 5, -1)
    sent = table[chosen][..., 1:]
    np.testing.assert_array_equal(rows[..., 42:46], sent[:, env.scenario.neighbours[:, 0]])
    np.testing.assert_array_equal(rows[..., 46:50], sent[:, env.scenario.neighbours[:, 1]])
