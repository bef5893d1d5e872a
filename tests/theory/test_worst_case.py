"""Lower bounds of the worst-case undetected time: closed forms, published packings, shuttles and random sets."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from lissajous_env.theory.worst_case import clearing_time, far_points, revisiting_time

TEAM = {"num_robots": 2, "radius": 0.5, "speed": 1.0}


def test_rogues_at_rest_take_as_long_as_a_sweep():
    # Oracle: by hand. 20 m x 10 m, two discs of 0.5 m at 1 m/s: (200 - pi / 2) / 2.
    assert clearing_time(20, 10, **TEAM) == pytest.approx((200 - math.pi / 2) / 2)
    assert clearing_time(1, 1, num_robots=2, radius=1.0, speed=1.0) == 0


def test_a_disc_as_wide_as_its_corridor_comes_close():
    # Story: it starts across one end and drives to the other; no rogue passes it, however fast.
    for rogue_speed in (0.0, 5.0):
        bound = clearing_time(50, 1, 1, 0.5, 2.0, rogue_speed)
        assert 0.97 * 50 / 2 < bound < 50 / 2


def test_discs_abreast_fail_where_rogues_gain_more_beside_them():
    # Oracle: by hand. In a corridor 4 m wide, two discs advance over 2 m at 1 m/s; rogues of u regain 2 m at u.
    assert clearing_time(100, 4, **TEAM, rogue_speed=0.999) < math.inf
    assert clearing_time(100, 4, **TEAM, rogue_speed=1.001) == math.inf
    assert clearing_time(100, 2, **TEAM, rogue_speed=50.0) < math.inf, "they span the corridor"
    # In a square, half of the area is crossed over a width of at least sqrt(50) m: 2 m x 1 m/s against 5.07 m x u.
    alone = {"num_robots": 1, "radius": 1.0, "speed": 1.0}
    assert clearing_time(10, 10, **alone, rogue_speed=0.394) < math.inf
    assert clearing_time(10, 10, **alone, rogue_speed=0.395) == math.inf
    # In between, the front of 4 m moves by (2 - 2 u) / 4 per second, for nearly all of the time.
    assert clearing_time(1000, 4, **TEAM, rogue_speed=0.5) == pytest.approx(1000 / 0.25, rel=0.02)


def test_the_integral_is_never_rounded_up():
    # Oracle: adaptive quadrature of the rate at which an area is cleared.
    def seconds(area):
        crossed = min(math.sqrt(area), math.sqrt(60 - area), 6)
        return 1 / (2.0 - 0.5 * max(crossed - 2, 0))

    exact, _ = quad(seconds, 0, 60 - 2 * math.pi * 0.25, points=(4, 24, 30, 36, 56), limit=200)
    assert (1 - 1e-3) * exact < clearing_time(10, 6, **TEAM, rogue_speed=0.5) < exact


def test_points_in_a_square_are_no_farther_apart_than_the_best_known():
    # Oracle: Markot and Csendes, "A new verified optimization technique for the packing circles in a unit square
    # problems" (SIAM J. Optim. 2005) and the proved optima before: largest least distances of M points.
    best = {3: math.sqrt(6) - math.sqrt(2), 4: 1, 5: math.sqrt(0.5), 6: math.sqrt(13) / 6, 8: 0.5176381, 9: 0.5}
    best |= {10: 0.4212795, 16: 1 / 3, 25: 0.25, 36: 0.2}
    widest = dict.fromkeys(best, 0.0)
    for robots in (2, 3, 8, 15):
        for points, apart in far_points(1.0, 1.0, robots):
            widest |= {m: max(widest[m], d) for m, d in zip(points.tolist(), apart.tolist(), strict=True) if m in best}
    share = {points: widest[points] / best[points] for points in best}
    assert max(share.values()) < 1 + 1e-6
    assert min(share.values()) > 0.96
    assert [points for points in best if share[points] > 0.9999] == [4, 5, 6, 9, 16, 25, 36]


def test_one_disc_that_shuttles_meets_the_bound():
    # Oracle: the gap of either end: there and back, 10 m less the disc, at 2 m/s.
    assert revisiting_time(10, 1e-3, 1, 0.5, 2.0) == pytest.approx(2 * 9 / 2)
    # In 20 s it changes from one to the other 20 / 4.5 times at most, and is at neither all the time: 40 s that the two
    # ends are left alone, in 3 + 20 / 4.5 periods.
    assert revisiting_time(10, 1e-3, 1, 0.5, 2.0, duration=20.0) == pytest.approx(40 / (20 / 4.5 + 3))
    assert revisiting_time(10, 1e-3, 1, 0.5, 2.0, duration=5.0) == pytest.approx(4.5), "each end once"
    assert revisiting_time(10, 1e-3, 1, 5.0, 2.0) == 0, "it senses both ends"


@given(st.floats(2, 40), st.floats(2, 40), st.integers(1, 8), st.floats(0.1, 3), st.floats(0, 5), st.floats(0.1, 10))
def test_they_obey_the_laws_of_similarity(width, height, robots, radius, rogue_speed, factor):
    for length, time in ((factor, 1.0), (1.0, factor)):
        sides, speed = (width * length, height * length), length / time
        scaled = clearing_time(*sides, robots, radius * length, speed, rogue_speed * speed)
        assert scaled == pytest.approx(time * clearing_time(width, height, robots, radius, 1.0, rogue_speed))
        scaled = revisiting_time(*sides, robots, radius * length, speed, 60 * time)
        assert scaled == pytest.approx(time * revisiting_time(width, height, robots, radius, 1.0, 60))
