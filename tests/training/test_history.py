"""History of a training: its best evaluation, and the first that beats a rival."""

import pytest

from training.learned.history import OFTEN, History

RIVAL = {"detection_time": 6.0, "collisions": 0.0, "return": -5.0, "detected_fraction": 0.8}


def point(steps, detection=5.0, collisions=0.0, earned=-3.0):
    scores = {"detection_time": detection, "collisions": collisions, "return": earned, "detected_fraction": 0.9}
    return {"steps": steps, "seconds": steps / 10, **scores}


def best(points, rivals):
    history, kept = History(rivals=rivals), None
    for each in points:
        if history.add(each):
            kept = each["steps"]
    return kept


@pytest.mark.parametrize(
    ("points", "wanted"),
    [
        ([point(1, earned=-4), point(2, earned=-3), point(3, earned=-3.5)], 2),
        ([point(1, earned=-4), point(2, earned=-2, collisions=0.3)], 1),
        ([point(1, earned=-2, collisions=0.3), point(2, earned=-4)], 2),
        ([point(1, earned=-4), point(2, earned=-3, collisions=OFTEN)], 2),
        ([point(1, earned=-4, collisions=3), point(2, earned=-3, collisions=5)], 2),
        ([point(1, earned=None), point(2, earned=-9)], 2),
        ([point(1, earned=None)], None),
    ],
    ids=["return", "careful first", "careful later", "hardly more", "none careful", "no return at first", "no return"],
)
def test_the_best_is_the_highest_return_among_the_careful(points, wanted):
    # Oracle: the rule, by hand.
    assert best(points, {"rival": RIVAL}) == wanted


def test_a_rival_that_collides_allows_as_much():
    points = [point(1, earned=-4), point(2, earned=-3, collisions=30.0)]
    assert best(points, {"rival": RIVAL | {"collisions": 37.0}}) == 2
    assert best(points, {}) == 2


def test_the_first_better_evaluation_detects_sooner_without_colliding():
    history = History(rivals={"rival": RIVAL})
    for each in (point(1, detection=7.0), point(2, detection=5.0, collisions=2.0), point(3, detection=None)):
        history.add(each)
        assert history.first_better("rival") is None
    for each in (point(4, detection=5.5), point(5, detection=4.0)):
        history.add(each)
        assert history.first_better("rival")["steps"] == 4
