"""Episodes without a bound of the worst-case undetected time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import baselines
import lissajous_env
from baselines.benchmark import report_page
from lissajous_env.world.columns import OPEN
from lissajous_env.world.episode import is_open

LEAPS = st.lists(st.tuples(st.integers(1, 30), st.integers(0, 60)), min_size=1, max_size=12)


def ages(leaps):
    """Return the possible undetected time of a rogue, step by step: it grows by 1, and falls when the oldest is
    detected."""
    history = [0]
    for steps, fall in leaps:
        history += [history[-1] + k + 1 for k in range(steps)]
        history.append(max(history[-1] + 1 - fall, 0))
    return np.array(history)


def open_at_each_step(history):
    return [is_open(history[: k + 1].max(), history[k], k) for k in range(len(history))]


@given(LEAPS, st.integers(0, 40))
def test_where_a_bound_holds_no_episode_of_twice_that_time_is_open(leaps, more):
    # Law: B bounds all ages of an episode that is longer than 2 B.
    history = ages(leaps)
    bound = history.max()
    padded = np.append(history, np.zeros(max(2 * bound + 1 - len(history), 0) + more, dtype=int))
    assert not any(open_at_each_step(padded)[2 * bound + 1 :])


@given(LEAPS, st.integers(1, 100), st.data())
def test_a_rogue_that_is_never_detected_makes_every_long_episode_open(leaps, more, draw):
    # Law: from t1 on it is the oldest, and of any age up to t1; then every episode of at least 2 t1 is open.
    before = ages(leaps)
    since = len(before) - 1
    young = draw.draw(st.integers(0, before[-1]))
    history = np.append(before, young + np.arange(1, since + more + 1))
    assert all(open_at_each_step(history)[max(2 * since, 1) :])


@given(LEAPS)
def test_an_open_episode_that_goes_on_stays_open_until_that_rogue_is_detected(leaps):
    history = ages(leaps)
    flags = open_at_each_step(history)
    for k in range(len(history) - 1):
        assert not flags[k] or flags[k + 1] or history[k + 1] <= history[k]


def test_where_a_rogue_stays_unseen_since_the_beginning_every_episode_is_open():
    # Story: cars that do not move. The same world played for longer claims more, and is open all the time.
    rows = []
    for duration in (2.0, 5.0, 12.0):
        scenario = lissajous_env.scenario("evaders", **{"task.duration": duration})
        (row,) = lissajous_env.evaluate(baselines.make("still", scenario), scenario, seeds=[3])
        assert row["guaranteed_detection_time"] == pytest.approx(duration - 0.1)
        rows.append(row)
    assert all(row[OPEN.name] == 1 and report_page.failed(row)[1] for row in rows)


STRAIGHT_ON = {"task.boundary": "remove", "robot.steering_max": 0.05}
FOREVER = {"faults.schedule": [(robot, 45.0, np.inf) for robot in range(5)]}


@pytest.mark.parametrize(("lost", "policy"), [(STRAIGHT_ON, "sweep"), (FOREVER, "partition")])
def test_without_a_robot_left_nothing_bounds_it(lost, policy):
    # Story: the edge removes cars that hardly steer, or all cars fail for good; nobody is left to detect a rogue.
    scenario = lissajous_env.scenario("evaders", **lost, **{"task.duration": 60.0})
    (row,) = lissajous_env.evaluate(baselines.make(policy, scenario), scenario, seeds=[0])
    assert row["guaranteed_detection_time"] < 30
    assert row[OPEN.name] == 1
