"""The search for the rogue that a policy misses, where gaps are narrow: other grids, other discs, the speed limit."""

import numpy as np
import pytest
import warp as wp
from test_witness import corridor, missed

import baselines
import lissajous_env
from lissajous_env.episodes.witness import nearest
from lissajous_env.episodes.witness.larger import certain_increase, with_larger_discs
from lissajous_env.episodes.witness.played import peaks, play, resolution
from lissajous_env.episodes.witness.tracing import rough_way


def test_a_way_avoids_nodes_that_are_sensed_between_two_ticks():
    # Oracle: the simulation detects the rogue. A tick of `team` lasts six steps, in which cars pass over many nodes.
    found = missed("team", "sweep", 31)
    assert found.stated == pytest.approx(60.0)
    assert found.undetected >= found.stated - 0.8


def test_a_way_through_narrow_gaps_is_no_faster_than_the_speed_limit():
    # Oracle: the speed limit. A rough way may be ahead by the longest hop and by the rounding of each of them.
    made = lissajous_env.scenario("evaders-failure")
    for played in play(baselines.make("kuramoto-mpcc", made, 3), made, [0, 5, 7]):
        (since, until), moved = peaks(played)[0], made.rogue_speed * made.task.step
        with wp.ScopedDevice("cpu"):
            way = rough_way(played, (since, until), [])[since : until + 1]
        ahead = 5**0.5 * 0.0405 + moved
        for steps in (20, 40, 80):
            away = np.linalg.norm(way[steps:] - way[:-steps], axis=1).max()
            assert away <= steps * moved * (1 + 1 / 255) + ahead


def test_a_rogue_that_passes_cells_within_a_step_is_found():
    # Oracle: the simulation detects the rogue. It moves 2.2 cells in a step, past gaps that open for a moment.
    for policy, seed in (("open-loop-mpcc", 5), ("random", 5)):
        found = missed("evaders-fast", policy, seed)
        assert found.undetected >= found.stated - 0.2


@pytest.mark.long
def test_rogues_between_the_narrow_gaps_of_the_hall_are_found():
    # Oracle: the simulation detects the rogue. Gaps narrower than a cell follow the rogue for most of its way.
    overrides = {"task.duration": 120.0}
    found = missed("hall", "kuramoto-mpcc", 1, **overrides)
    assert found.undetected >= found.stated - found.resolution - 0.1


def test_the_worst_case_of_larger_discs_is_that_of_robots_that_have_them():
    # Oracle: an ordinary episode of a scenario with that radius. The robot follows the curve whatever it senses.
    made, larger = corridor(), corridor(**{"sensing.radius": 0.6})
    played = play(baselines.make("open-loop", made, 1), made, [0])
    (repeated,) = with_larger_discs(played, 0.1)
    (other,) = play(baselines.make("open-loop", larger, 1), larger, [0])
    assert np.array_equal(repeated.track, played[0].track)
    worst = [each.score["guaranteed_detection_time"] for each in (repeated, other, played[0])]
    assert worst[0] == pytest.approx(worst[1], abs=0.1)
    assert worst[0] < worst[2] - 0.3


def test_where_a_grid_lets_a_rogue_pass_the_bound_includes_a_finer_grid():
    # Oracle: the contamination stage on cells a third as long. In seed 1 the grid lets a rogue pass a closed gap.
    made = lissajous_env.scenario("evaders-failure")
    found = missed("evaders-failure", "open-loop-mpcc", 1)
    finer = lissajous_env.scenario(made, **{"task.contamination": (270, 120)})
    score = lissajous_env.evaluate(baselines.make("open-loop-mpcc", finer, 1), finer, [1])[0]
    truth = float(score["guaranteed_detection_time"])
    assert truth < found.stated - resolution(made) * made.task.step - 0.1
    assert found.stated - found.resolution <= truth + 0.1
    assert found.undetected == pytest.approx(truth, abs=0.8)


def test_the_increase_of_the_discs_follows_from_the_ways_of_the_robots():
    # Oracle: the numbers of the argument. A robot on a circle of radius R is c^2 / 8 R away from the chord.
    made = lissajous_env.scenario("evaders", **{"task.duration": 2.0})
    (played,) = play(baselines.make("still", made, 1), made, [0])
    spacing, moved = 3.6 / 89, 0.03
    still = 5**0.5 / 2 * max(spacing, 1.6 / 39) + moved
    resting = type(played)(**{**vars(played), "track": np.zeros_like(played.track)})
    assert certain_increase([resting]) == pytest.approx(still, rel=1e-6)
    moving = resting.track.copy()
    moving[7, 0, :, 0] = [0.0, 0.1, 0.2]
    moving[7, 0, 1, 1] = 0.01
    driven = type(played)(**{**vars(played), "track": moving})
    assert certain_increase([driven]) == pytest.approx(still + 0.2**2 / 8 / 0.6 + 0.01, rel=1e-6)


def test_a_search_along_larger_discs_begins_only_where_it_must(monkeypatch):
    # Law: an episode whose rogue is undetected for as long as the stage reports needs no second search.
    made = lissajous_env.scenario("evaders", **{"task.duration": 12.0})
    episodes = play(baselines.make("kuramoto-mpcc", made, 2), made, [0, 1])
    monkeypatch.setattr(nearest, "with_larger_discs", lambda *_: pytest.fail("searched again"))
    for played, found in zip(episodes, nearest.longest_ways(episodes), strict=True):
        (since, until), way = peaks(played)[0], found.way
        assert abs((way.unseen_until - way.appears_at) - (until - since)) <= found.resolution + 1


def test_no_target_stays_at_a_node_that_is_sensed_between_two_ticks():
    # Oracle: distances in float64 from the recorded robots, at the ends of the steps from a tick to the next one.
    made = lissajous_env.scenario("team", **{"task.duration": 6.0})
    (played,) = play(baselines.make("sweep", made, 1), made, [0])
    hops = made.spreading
    x, y = (np.linspace(-5, 5, count) for count in (hops.columns, hops.rows))
    assert hops.period == 6
    lost = 0
    for tick, bits in enumerate(played.stays):
        if tick == 0:  # targets of the beginning are sensed from the first step on
            continue
        stays = np.unpackbits(bits.view(np.uint8), axis=1, count=hops.columns, bitorder="little").astype(bool)
        there = played.labels[tick] < played.labels.max()
        for step in range(6 * tick, 6 * tick + 6):
            for place in played.track[step, played.works[step], -1].astype(float):
                away = np.hypot(x - place[0], y[:, None] - place[1])
                assert not (stays & (away < hops.radius - 1e-4)).any()
        lost += np.count_nonzero(there & ~stays)
    assert lost > 100
