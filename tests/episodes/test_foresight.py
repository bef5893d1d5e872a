"""Actions with foresight: labels for rogues, from recorded positions of the sensors."""

import numpy as np
import pytest

import lissajous_env
from lissajous_env.episodes.missed.foresight import Foresight, Moment

FIELD = {"curve.half_width": 4.0, "curve.half_height": 2.0, "sensing.radius": 1.0, "targets.speed_limit": 0.5,
         "targets.speed": 0.2, "targets.flee_speed": 0.2, "robot.count": 1, "task.contamination": None}  # fmt: skip


def field():
    return lissajous_env.scenario("evaders", rogues="agents", **FIELD)


def moments_of(ways, places):
    """Moments of a robot that goes along `ways` (T + 1, 2), with rogues always at the same places (V, 2)."""
    places, worlds = np.asarray(places, dtype=np.float32), np.zeros(len(places), dtype=int)
    return [Moment(np.asarray(at, dtype=np.float32)[None, None], places, worlds, places) for at in ways]


def labels_of(ways, places):
    """Actions (T, V, 2) and gains (T, V) at all moments."""
    labels = Foresight(field()).label(moments_of(ways, places))
    assert np.allclose(labels.rows[: len(places)], places)
    return labels.actions.reshape(-1, len(places), 2), labels.gains.reshape(-1, len(places))


def sweep(steps=60, speed=0.1, y=-0.4, x=-1.9):
    """A robot that comes from the left and goes to the right."""
    return np.stack([x + speed * np.arange(steps), np.full(steps, y)], axis=1)


def test_a_rogue_leaves_the_way_of_a_robot_that_comes():
    # Story: the disc comes along y = -0.4 and reaches up to 0.63; a rogue at 0.4 gets out of its way, up, not ahead.
    # At first there is no hurry; then, for some steps, it must hurry; then it is detected whatever it does.
    actions, gains = labels_of(sweep(x=-3.0), [(-0.5, 0.4)])
    urgent = np.flatnonzero(gains[:, 0] > 0.3)
    assert 2 <= len(urgent) <= 20
    assert urgent[0] > 10
    assert actions[urgent[:3], 0, 1].min() > 0.4


def test_a_rogue_that_no_disc_reaches_may_rest():
    # Story: above the way of the disc all actions are equal, so the labels have no weight and are to rest.
    actions, gains = labels_of(sweep(), [(-0.5, 1.6)])
    assert np.abs(actions).max() == 0
    assert gains == pytest.approx(np.zeros_like(gains), abs=1e-4)


def test_labels_are_mirrored_with_the_world():
    # Law: a world upside down has labels upside down, where one action is the best.
    places = np.random.default_rng(1).uniform((-1.5, -1.0), (1.5, 1.0), (40, 2))
    ways = sweep()
    actions, gains = labels_of(ways, places)
    mirrored, mirrored_gains = labels_of(ways * (1, -1), places * (1, -1))
    assert np.allclose(gains, mirrored_gains, atol=1e-3)
    clear = gains > 0.3
    assert clear.sum() >= 50
    same = np.abs(actions[clear] * (1, -1) - mirrored[clear]).max(axis=1) < 1e-6
    assert same.mean() > 0.8


def test_slower_rogues_gain_less():
    # Law: what a rogue can gain by moving does not grow as it becomes slower; here the speed falls to a twentieth.
    places = np.random.default_rng(2).uniform((-1.5, -1.0), (1.5, 1.0), (60, 2))
    labels = {}
    for speed in (0.5, 0.025):
        changed = {"targets.speed": 0.02, "targets.flee_speed": 0.02, "targets.speed_limit": speed}
        scenario = lissajous_env.scenario(field(), **changed)
        labels[speed] = Foresight(scenario).label(moments_of(sweep(), places))
    assert labels[0.025].gains.mean() < 0.8 * labels[0.5].gains.mean()


def test_values_are_the_times_for_which_a_rogue_can_still_stay_undetected():
    # Story: a disc of 1 m rests at the left for 3 s. A rogue beside it stays undetected to the end, one well inside it
    # is detected at every moment. Law: no rogue stays undetected for longer from discs that are larger.
    moments = moments_of(np.tile([[-2.0, 0.0]], (31, 1)), [(0.0, 0.0)])
    values = [(moment, value.copy()) for moment, value in Foresight(field(), margin=0.0, blur=0.0).values(moments)]
    assert [moment for moment, _ in values] == list(range(30, -1, -1))
    for moment, value in values:
        rows, columns = value.shape[1:]
        beside, inside = value[0, rows // 2, 3 * columns // 4], value[0, rows // 2, columns // 4]
        assert beside == pytest.approx(0.1 * (30 - moment), abs=1e-4)
        assert inside == 0
    for (_, value), (_, larger) in zip(values, Foresight(field(), margin=0.3, blur=0.0).values(moments), strict=True):
        assert (larger <= value).all()
    assert larger.sum() < value.sum()
