"""Tracks: what robots remember of the targets that they had in sight, and what they tell each other."""

from itertools import chain

import numpy as np
import pytest
from test_feedback import FIELD, distances, drive

import baselines
import lissajous_env

pytestmark = pytest.mark.filterwarnings("ignore::lissajous_env.parameters.assumptions.AssumptionWarning")

STAY = {"targets.leave": False, "sensing.sight": 5.0, "sensing.tracks_seen": 12, "sensing.teammates_seen": 4}
CELLS = {"sensing.cells_seen": (8, 5), "sensing.memory": 20.0}
MESSY = {"noise.message_delay": 1.0, "noise.message_loss": 0.4}


def simulation_of(worlds=2, seed=0, **overrides):
    return lissajous_env.Simulation(lissajous_env.scenario("intruders", **FIELD | STAY | overrides), worlds, seed=seed)


def entry(simulation, kind, name):
    """(W, N, K) an entry of all tracks or teammates."""
    sensing = simulation.scenario.sensing
    count = sensing.tracks_seen if kind == "track" else sensing.teammates_seen
    places = [simulation.layout.names.index(f"{kind}_{k}_{name}") for k in range(count)]
    return simulation.observation.numpy()[..., places].astype(float)


@pytest.mark.parametrize("shared", ["none", "team"])
def test_tracks_are_what_was_in_sight_within_the_memory(shared):
    # Oracle: NumPy, from distances and places at the end of each step; without delay or loss a team knows all at once.
    removed = {"faults.removed": [(1, 3.0)]}
    simulation = simulation_of(**{"sensing.shared": shared, "sensing.memory": 0.9, "task.step": 0.1} | removed)
    half, last, place = np.array([20.0, 12.5]), np.full((2, 5, 12), -np.inf), np.zeros((2, 5, 12, 2))
    before, compared = np.full((2, 5, 12), False), 0
    for step in chain([-1], drive(simulation)):
        own = distances(simulation) < 5.0
        known = own | (own.any(axis=1, keepdims=True) if shared == "team" else False)
        targets = simulation.targets.position.numpy().astype(float)
        velocity = np.where((known & before)[..., None], (targets[:, None] - place) / 0.1, 0.0)
        last[known], place = step, np.where(known[..., None], targets[:, None], place)
        last[simulation.robots.status.numpy() == 2] = -np.inf  # a removed robot has no tracks
        age = (step - last) * 0.1  # nine float32 steps are more than the memory
        here = simulation.robots.position.numpy()[..., :2].astype(float)
        for w, i in np.ndindex(2, 5):
            there = np.flatnonzero(age[w, i] <= 0.9)
            order = there[np.argsort(np.linalg.norm(place[w, i, there] - here[w, i], axis=-1))]
            count = len(order)
            assert entry(simulation, "track", "present")[w, i].tolist() == [1] * count + [0] * (12 - count)
            ages, owns = (entry(simulation, "track", name)[w, i, :count] for name in ("age", "own"))
            np.testing.assert_allclose(ages * 0.9, age[w, i, order], atol=1e-5)
            np.testing.assert_array_equal(owns == 1, own[w, i, order])
            x = entry(simulation, "track", "x")[w, i, :count]
            np.testing.assert_allclose(x * 40, (place[w, i, order] - here[w, i])[:, 0], atol=1e-3)
            fresh = age[w, i, order] == 0
            x_speed = entry(simulation, "track", "x_velocity")[w, i, :count] * 3.0
            np.testing.assert_allclose(x_speed[fresh], velocity[w, i, order, 0][fresh], atol=1e-3)
            compared += count
        before = known
        assert (np.abs(place) <= half + 1e-3).all()
    assert compared > 400


def test_sharing_more_never_means_to_know_less():
    # Law: what a robot knows without messages it knows with those of its neighbours, and with those of the team.
    kinds = [simulation_of(4, **MESSY, **{"sensing.shared": shared}) for shared in ("none", "ring", "team")]
    more = np.zeros(2)
    for _ in zip(*(drive(simulation) for simulation in kinds), strict=True):
        none, ring, team = (simulation.tracks.sighted_at.numpy() for simulation in kinds)
        assert (none <= ring).all()
        assert (ring <= team).all()
        more += (none < ring).mean(), (ring < team).mean()
        none, ring, team = (simulation.tracks.mate_sent_at.numpy() for simulation in kinds)
        assert (none == -1).all()
        assert (ring <= team).all()
    assert (more > 1).all()


def test_a_track_ages_by_a_step_unless_somebody_has_the_target_in_sight():
    # Law: the step in which a target was last in sight stays, unless the robot or another one has seen it since.
    simulation = simulation_of(4, **MESSY, **{"sensing.shared": "ring"})
    tracks, before = simulation.tracks, simulation.tracks.sighted_at.numpy().copy()
    for _ in drive(simulation):
        after, now = tracks.sighted_at.numpy().copy(), simulation.clock.step.numpy()[0]
        own, other = tracks.own_sighted_at.numpy() == now, tracks.other_sighted_at.numpy() == now - 2
        np.testing.assert_array_equal(after != before, own | (other & (now - 2 > before)))
        assert (after[own] == now).all()
        assert (after >= before).all()
        before = after


def test_a_neighbours_sighting_arrives_with_its_message():
    # Oracle: the sender's own sightings, as many steps ago as the delay; teammates' places likewise.
    simulation = simulation_of(1, **{"sensing.shared": "ring", "noise.message_delay": 1.0})
    neighbours, seen, places = simulation.scenario.neighbours, [], []
    for step in chain([-1], drive(simulation, 60)):
        seen.append(distances(simulation)[0] < 5.0)
        places.append(simulation.robots.position.numpy()[0, :, :2].copy())
        assert step >= 1 or not entry(simulation, "track", "other").any(), "no message has arrived yet"
        for i in range(5 if step >= 1 else 0):
            other = seen[-3][neighbours[i]].any(axis=0)
            np.testing.assert_array_equal(simulation.tracks.other_sighted_at.numpy()[0, i] == step + 1 - 2, other)
            known = simulation.tracks.mate_position.numpy()[0, i]
            np.testing.assert_allclose(known[neighbours[i]], places[-3][neighbours[i]], atol=1e-4)
            assert entry(simulation, "teammate", "present")[0, i].sum() == 2
            assert entry(simulation, "teammate", "age")[0, i, :2] == pytest.approx([0.1, 0.1])


@pytest.mark.parametrize("shared", ["none", "ring", "team"])
@pytest.mark.parametrize("more", [{}, MESSY, {"noise.message_delay": 0.5, "targets.respawn": True}])
def test_a_track_ends_when_its_target_was_detected_and_left(shared, more):
    # Story: who saw it leave observes that once, and so does who is told; who is not remembers it until it is too old.
    # Older news of it, which arrive later, change nothing, and a target that appears anew has no part in its track.
    simulation = simulation_of(4, **{"targets.leave": True, "sensing.shared": shared, "sensing.memory": 100.0} | more)
    outdated, left, tracks, known = 0, 0, simulation.tracks, np.full((4, 5, 12), -2)
    for step in drive(simulation):
        at, leaves, sent_at = tracks.sighted_at.numpy(), tracks.leaves.numpy() == 1, step - tracks.sighted.shape[2] + 2
        gone, saw = simulation.targets.status.numpy() == 3, tracks.own_sighted_at.numpy()
        left += entry(simulation, "track", "leaves").sum()
        outdated += ((at >= 0) & gone[:, None]).sum()
        assert not ((at >= 0) & gone[:, None] & (saw >= simulation.targets.found_at.numpy()[:, None])).any()
        assert (at > known)[at >= 0].all()
        assert (sent_at > known)[tracks.other_sighted_at.numpy() == sent_at].all()
        assert np.linalg.norm(tracks.velocity.numpy()[at >= 0], axis=-1).max(initial=0) < 1.001
        known = np.where(leaves, at, known)
    assert (outdated > 0) == ("targets.respawn" not in more and (shared != "team" or more is MESSY))
    assert left > 0
    assert shared != "team" or more or left % 5 == 0


def roam(simulation):
    """Let the robots drive on at full throttle with random steering, and yield the number of each step."""
    draw, steering = np.random.default_rng(5), np.zeros(simulation.action_shape[:2])
    for step in range(80):
        steering = np.where(draw.random(steering.shape) < 0.1, draw.uniform(-1, 1, steering.shape), steering)
        simulation.step(np.stack([steering, np.ones_like(steering)], axis=-1).astype(np.float32))
        yield step


def cell_ages(simulation):
    """(W, N, R, C) time since each cell was covered, as far as each robot knows [memory]."""
    rows = simulation.observation.numpy()
    places = [simulation.layout.names.index(f"cell_{k}_age") for k in range(40)]
    ages = rows[..., places].reshape(*rows.shape[:2], 5, 8)
    np.testing.assert_array_equal(baselines.Rows(rows, simulation.scenario).cell_age, ages * np.float32(20.0))
    return ages


def test_cells_age_by_a_step_unless_the_robot_covers_them():
    # Oracle: NumPy, from the places of the sensors and the centres of the cells. One robot fails and covers nothing,
    # one is removed and observes nothing.
    simulation = simulation_of(**CELLS, **{"faults.schedule": [(2, 5.0, 25.0)], "faults.removed": [(4, 30.0)]})
    x, y = (np.linspace(-half, half, 2 * n + 1)[1::2] for n, half in ((8, 20.0), (5, 12.5)))
    last, failed, aging = np.full((2, 5, 5, 8), -np.inf), 0, 0
    for step in chain([-1], roam(simulation)):
        place = simulation.robots.sensor.numpy().astype(float)[..., None, None, :]
        covers = np.hypot(x - place[..., 0], y[:, None] - place[..., 1]) < 3.0
        last[covers] = step
        expected = np.minimum((step - last) * 0.5 / 20.0, 1.0)
        expected[simulation.robots.status.numpy() == 2] = 0.0
        np.testing.assert_allclose(cell_ages(simulation), expected, atol=1e-6)
        failed += not covers[:, 2].any()
        aging += ((step - last < 40) & ~covers).sum()
    assert failed >= 40
    assert aging > 400
    assert (cell_ages(simulation)[:, 4] == 0).all()


def test_a_team_knows_the_least_age_of_its_robots():
    # Law: without delay or loss the elementwise minimum; with them never more than with messages of fewer robots.
    alone, team = (simulation_of(**CELLS, **{"sensing.shared": shared}) for shared in ("none", "team"))
    for _ in zip(roam(alone), roam(team), strict=True):
        least = cell_ages(alone).min(axis=1, keepdims=True)
        np.testing.assert_array_equal(cell_ages(team), np.broadcast_to(least, (2, 5, 5, 8)))
    messy = [simulation_of(**CELLS, **MESSY, **{"sensing.shared": shared}) for shared in ("none", "ring", "team")]
    differ = np.zeros(2)
    for _ in zip(*map(roam, messy), strict=True):
        none, ring, team = map(cell_ages, messy)
        assert (none >= ring).all()
        assert (ring >= team).all()
        differ += (none > ring).mean(), (ring > team).mean()
    assert (differ > 1).all()


def test_a_neighbours_cells_arrive_with_its_message():
    # Story: what a robot covers its neighbour on the ring knows two steps later, as covered then.
    simulation = simulation_of(1, **CELLS, **{"sensing.shared": "ring", "noise.message_delay": 1.0})
    neighbours, covered = simulation.scenario.neighbours, []
    for step in chain([-1], roam(simulation)):
        covered.append(cell_ages(simulation)[0] == 0)
        for i in range(5 if step >= 1 else 0):
            heard = covered[-3][neighbours[i]].any(axis=0)
            assert (cell_ages(simulation)[0, i][heard] <= 1.0 / 20.0 + 1e-6).all()


@pytest.mark.parametrize("value", [(8,), (8, 65), (0, 4)])
def test_cells_are_columns_and_rows(value):
    with pytest.raises(ValueError, match=r"sensing.cells_seen must be \(columns, rows\).* or None, got"):
        simulation_of(**{"sensing.cells_seen": value})


def test_no_tracks_cost_nothing():
    # Story: without tracks there is no stage, no memory and no entry of theirs.
    plain = lissajous_env.Simulation("intruders")
    assert not {"sighting", "tracking", "tracks", "cells"} & {stage.name for stage in plain.stages.stages}
    assert plain.tracks.sighted.size == plain.tracks.mate_sent_at.size == plain.tracks.covered_at.size == 0
    assert not [name for name in plain.layout.names if name.startswith(("track", "teammate", "cell"))]
    assert not [name for name in plain.save_state() if name.startswith("tracks")]
