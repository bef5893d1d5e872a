"""Policies that react to targets: what each does in a story, what it may use, and what reacting is worth."""

import itertools

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.policies import reacting
from baselines.policies.dividing import Cover, DividedPursuit, Herd
from baselines.policies.index_rule import Index
from baselines.policies.reacting import Chase, Force, Lanes, VoronoiPursuit, greedy_division
from lissajous_env.world.observation import layout

POLICIES = {
    "watch": ("lanes", "follow", "a-cmommt", "greedy-cover", "greedy-herd"),
    "intercept": ("pure-pursuit", "lead-pursuit", "divided-pursuit", "voronoi-pursuit"),
    "hotspots": ("index", "index-learned", "learned-intercept", "learned-watch"),
}


def place_all(simulation, robots, targets):
    """Place robots and targets of the only world [m], and let robots observe them."""
    simulation.robots.position.assign(np.pad(np.array(robots, dtype=np.float32), ((0, 0), (0, 1)))[None])
    simulation.robots.speed.zero_()
    simulation.targets.position.assign(np.array(targets, dtype=np.float32)[None])
    simulation.step(np.zeros(simulation.action_shape, dtype=np.float32))


CORNERS = [(-18.0, -10.0), (18.0, -10.0), (-18.0, 10.0), (18.0, 10.0), (0.0, 0.0)]


@pytest.mark.parametrize("scenario", POLICIES)
def test_policies_play_alike_at_another_scale(scenario):
    # Law: in scaled units nothing changes; powers of two are exact.
    base = lissajous_env.scenario(scenario)
    for name in POLICIES[scenario]:
        rows = []
        for task in (base, base.scaled(2.0, 4.0)):
            simulation, policy = lissajous_env.Simulation(task, 2, seed=1), baselines.make(name, task, num_worlds=2)
            for _ in range(8):
                simulation.step(policy.act(simulation.observation))
            rows.append(simulation.observation.numpy().copy())
        np.testing.assert_array_equal(*rows, err_msg=name)


def test_the_lanes_are_a_closed_tour_that_drives_no_stretch_twice():
    high = {"curve.half_width": 12.5, "curve.half_height": 20}
    policy, other = (Lanes(lissajous_env.scenario("hotspots", **fields), lanes=8) for fields in ({}, high))
    corners, edge = policy.corners, policy.corners.max(axis=0)
    assert sorted(other.corners[1:].tolist()) == sorted(corners[1:, ::-1].tolist()), "along the shorter side"
    assert corners[0].tolist() == corners[-1].tolist() == [edge[0], -edge[1]]
    assert sorted({round(x, 6) for x in corners[:, 0]}) == pytest.approx(np.linspace(-edge[0], edge[0], 8))
    assert ((np.diff(corners, axis=0) == 0).sum(axis=1) == 1).all(), "every stretch is along x or y"
    middles = [tuple(middle) for middle in (corners[1:] + corners[:-1]) / 2]
    assert len(set(middles)) == len(middles), "no stretch is driven twice"
    assert lissajous_env.evaluate(policy, "hotspots", seeds=[0])[0]["sensed_fraction"] > 0.95


@pytest.mark.parametrize("noise", [{}, {"noise.message_delay": 3.0}, {"noise.message_loss": 0.3}])
def test_no_two_robots_follow_one_place_in_the_lanes(noise):
    simulation = lissajous_env.Simulation(lissajous_env.scenario("watch", **noise), 50, seed=1)
    policy = Lanes(simulation.scenario, 50)
    for _ in range(40):
        simulation.step(policy.act(simulation.observation))
    assert all(len(set(slots)) == policy.num_robots for slots in policy._slot.tolist())


def test_a_force_draws_a_robot_to_its_target_and_away_from_others():
    # Story: one target to the right of robot 4; then another robot observes it, and robot 4 patrols.
    simulation = lissajous_env.Simulation("watch", seed=1)
    far = [(-19.0, 12.0 - k) for k in range(9)]
    place_all(simulation, CORNERS, [(3.5, 0.0), *far])
    alone = Force(simulation.scenario).act(simulation.observation.numpy())[0, 4]
    assert abs(alone[1]) < 0.3 < 0.9 < alone[0]
    place_all(simulation, [*CORNERS[:3], (3.6, 3.3), (0.0, 0.0)], [(3.5, 0.0), *far])
    shared = Force(simulation.scenario).act(simulation.observation.numpy())[0, 4]
    patrol = Lanes(simulation.scenario, reach=simulation.scenario.sight).act(simulation.observation.numpy())[0, 4]
    np.testing.assert_allclose(shared, patrol, atol=1e-6)
    assert not np.allclose(shared, alone, atol=0.1)


def test_a_team_divides_the_targets_that_it_covers():
    # Story: robot 4 is nearest to two targets that one disc covers, robot 3 to one, robot 0 to the others.
    resting = lissajous_env.scenario("watch", **{"targets.wandering": 0.0, "targets.fleeing": 0.0})
    simulation = lissajous_env.Simulation(resting, seed=1)
    place_all(simulation, CORNERS, [(3.0, 1.8), (3.0, -1.8), (15.5, 10.0), *[(-17.0, -9.0)] * 7])
    action = Cover(resting).act(simulation.observation.numpy())[0]
    assert abs(action[4, 1]) < 0.4 < 0.5 < action[4, 0]
    assert action[3, 0] < -0.8
    to_one = Cover(resting, margin=0.1).act(simulation.observation.numpy())[0, 4]
    assert abs(to_one[1]) > 0.4, "a smaller disc covers only one of the two"


def test_a_team_divides_targets_by_places_of_one_time():
    # Oracle: the places of all robots in the simulation two steps ago, when the messages that arrive now were sent.
    simulation = lissajous_env.Simulation(lissajous_env.scenario("watch", **{"noise.message_delay": 2.0}), seed=1)
    policy, places, used = Cover(simulation.scenario), [], []
    divide = policy.division
    policy.division = lambda robots, *rest: used.append(robots) or divide(robots, *rest)
    for _ in range(8):
        places.append(simulation.robots.position.numpy()[0, :, :2].copy())
        simulation.step(policy.act(simulation.observation))
    for known, true in zip(used[2:], places, strict=False):
        np.testing.assert_allclose(np.sort(known[0], axis=1), np.sort([true] * 5, axis=1), atol=1e-4)


def test_a_fleeing_target_is_driven_into_a_corner_before_which_a_robot_rests():
    # Story: a target flees from robot 4 to the upper right. Robot 4 drives to a point behind it, which is to the right
    # of its own way to the target, since the corner is farther up. Then the target stands in the corner.
    fleeing = lissajous_env.scenario("watch", **{"targets.wandering": 0.0, "targets.fleeing": 1.0})
    simulation, far = lissajous_env.Simulation(fleeing, seed=1), [(-19.5, 12.0 - k) for k in range(9)]
    place_all(simulation, [*CORNERS[:3], (18.0, -11.0), (12.0, 5.0)], [(13.5, 5.5), *far])
    simulation.step(np.zeros(simulation.action_shape, dtype=np.float32))
    pursued = Herd(fleeing).act(simulation.observation.numpy())[0, 4]
    straight = Herd(fleeing, behind=0.0).act(simulation.observation.numpy())[0, 4]
    assert straight[0] * pursued[1] - straight[1] * pursued[0] < -0.05, "to the right"
    assert simulation.targets.position.numpy()[0, 0, 0] > 15.0, "it flees"
    place_all(simulation, [*CORNERS[:3], (18.0, -11.0), (17.5, 10.0)], [(20.0, 12.5), *far])
    simulation.step(np.zeros(simulation.action_shape, dtype=np.float32))
    assert not Herd(fleeing).act(simulation.observation.numpy())[0, 4].any()


@pytest.mark.parametrize("shared", ["none", "team"])
def test_robots_without_robots_in_sight_avoid_those_that_they_hear(shared):
    # Story: robots 3 and 4 are near each other, and each hears where the other one is.
    blind = lissajous_env.scenario("watch", **{"sensing.robots_seen": 0, "sensing.shared": shared})
    simulation, policy = lissajous_env.Simulation(blind, seed=1), Lanes(blind)
    place_all(simulation, [*CORNERS[:3], (1.0, 0.0), (0.0, 0.0)], [(-19.0, 12.0 - k) for k in range(10)])
    rows = policy.rows(simulation.observation.numpy())
    away = reacting.away_from_others(np.zeros_like(rows.position), rows)[0, :, 0]
    assert away[4] < -0.9 < 0.9 < away[3]
    assert np.nanmin(np.linalg.norm(reacting.known_places(rows)[0, 4, 1:] - (1.0, 0.0), axis=-1)) < 0.01


def test_a_division_gives_each_robot_one_thing():
    # Oracle: by hand. Robot 0 is best at both things, takes the better one, and leaves the other to robot 1.
    worth, things = np.array([[[[2.0, 3.0], [1.9, 1.0]]]]), []

    def take(thing):
        things.append(thing.item())
        worth[..., thing.item()] = 0.0

    assert greedy_division(lambda free: worth * free, take, worth.shape[:3]).item() == 1
    assert things == [1, 0]


def test_pursuers_divide_their_targets_and_help_each_other():
    # Story: robots 3 and 4 know of two targets, and the one nearer to both is nearest to robot 4. Without the other
    # target, robot 3 helps robot 4.
    simulation = lissajous_env.Simulation("intercept", seed=1)
    robots = [(-19.0, -12.0), (-19.0, 12.0), (19.0, 12.0), (-4.0, 0.0), (0.0, 0.0)]
    place_all(simulation, robots, [(2.0, 0.0), (-4.0, 9.0), (19, -12), (19, -12)])
    other = DividedPursuit(simulation.scenario).act(simulation.observation.numpy())[0, 3]
    place_all(simulation, robots, [(2.0, 0.0), (19, -12), (19, -12), (19, -12)])
    helping = DividedPursuit(simulation.scenario).act(simulation.observation.numpy())[0, 3]
    assert other[1] > 0.6 > 0.3 > abs(helping[1])
    assert helping[0] > 0.7


def test_a_pursuer_drives_to_the_border_of_the_cells():
    # Oracle: of a robot and a target of equal speed the border is half-way; from near, the robot drives straight.
    simulation = lissajous_env.Simulation("intercept", seed=1)
    place_all(simulation, [*CORNERS[:4], (-4.0, 0.0)], [(4.0, 0.0), (-19, 0), (19, 0), (19, 12)])
    rows = simulation.observation.numpy()
    slow = VoronoiPursuit(simulation.scenario, fade=100.0)
    slow.pace = 1.0
    ahead = slow.act(rows)[0, 4]
    assert abs(ahead[1]) < 0.3 < 0.9 < ahead[0]
    straight = VoronoiPursuit(simulation.scenario, near=100.0).act(rows)
    np.testing.assert_allclose(straight, Chase(simulation.scenario, lead=0.0).act(rows), atol=1e-5)


def test_a_target_that_leaves_is_not_pursued():
    # Story: a target in sight counts, until its track says that it was detected and leaves.
    simulation, policy = lissajous_env.Simulation("intercept", seed=1), Chase("intercept")
    place_all(simulation, CORNERS, [(4.0, 0.0), (-19, 0), (19, 0), (19, 12)])
    rows = policy.rows(simulation.observation.numpy())
    assert policy.in_sight(rows)[0, 4].any()
    rows.track_leaves = np.ones_like(rows.track_leaves)
    assert not policy.in_sight(rows).any()


def test_a_chase_with_a_lead_meets_a_target_that_crosses():
    # Oracle: a target that flees along y is chased ahead of it, the more the longer the lead.
    simulation = lissajous_env.Simulation("intercept", seed=1)
    for y in (0.0, 0.5):
        place_all(simulation, CORNERS, [(6.0, y), (-19, 0), (19, 0), (19, 12)])
        simulation.targets.position.assign(np.array([[(6.0, y), (-19, 0), (19, 0), (19, 12)]], dtype=np.float32))
    known, rows = simulation.tracks.velocity.numpy()[0, 4, 0], simulation.observation.numpy()
    chased = [Chase(simulation.scenario, lead=lead).act(rows)[0, 4, ::-1] for lead in (0.0, 0.5, 1.0)]
    assert np.abs(known[1]) > 0.1
    assert (np.sign(known[1]) * np.diff([np.arctan2(*way) for way in chased]) > 0).all()


@pytest.mark.parametrize("delay", [0.0, 2.0])
def test_an_index_rule_learns_where_targets_appear(delay):
    # Story: after an episode the cells near the hotspots have the highest rates.
    scenario = lissajous_env.scenario("hotspots", **{"noise.message_delay": delay})
    simulation, policy = lissajous_env.Simulation(scenario, 3, seed=1), Index(scenario, 3)
    while not simulation.over.all():
        simulation.step(policy.act(simulation.observation))
    places = simulation.targets.position.numpy()
    there = simulation.targets.appears_at.numpy() < 300
    for w in range(3):
        gap = np.linalg.norm(policy.cells[:, None] - places[w, there[w]], axis=-1)
        near = np.bincount(gap.argmin(axis=0), minlength=len(policy.cells))
        assert np.corrcoef(policy.rates()[w, 0], near)[0, 1] > 0.7
        counted, found_at = policy._detections[w].sum(axis=-1), simulation.targets.found_at.numpy()[w]
        detected, unheard = (found_at < 2**30).sum(), (abs(found_at - 300) <= delay).sum()
        assert np.ptp(counted) <= unheard
        assert (np.ptp(policy._idle[w], axis=0) == 0).all(), "the whole team knows the same"
        assert 0.9 * detected <= counted[0] <= detected


def test_a_robot_for_which_no_cell_is_left_drives_to_the_nearest_one():
    # Story: all four cells are covered, and four robots are in the middles of theirs, where they remain.
    small = lissajous_env.scenario("hotspots", **{"curve.half_width": 5.0, "curve.half_height": 3.0})
    simulation, policy = lissajous_env.Simulation(small), Index(small)
    place_all(simulation, [*policy.cells, (0.0, 0.0)], simulation.targets.position.numpy()[0])
    assert np.abs(policy.act(simulation.observation.numpy())[0, :4]).max() < 0.01


@pytest.mark.parametrize(("scenario", "best", "column", "factor"), [
    ("watch", "a-cmommt", "observed_fraction", 1.9), ("intercept", "lead-pursuit", "detection_rate", 10.0),
    ("hotspots", "index-learned", "detection_time_mean", 1 / 1.3),
])  # fmt: skip
def test_reacting_is_worth_a_factor(scenario, best, column, factor):
    # Oracle: the prototypes of these tasks, 0.354 and 0.155, 4.98 and 0.05 a minute, 7.59 s and 13.1 s.
    means = []
    for name in ("lanes", best):
        rows = lissajous_env.evaluate(baselines.make(name, scenario, num_worlds=3), scenario, seeds=range(3))
        means.append(np.mean([row[column] for row in rows]))
    assert means[1] > factor * means[0] if factor > 1 else means[1] < factor * means[0]


def test_scenarios_of_all_splits_have_rows_of_one_length():
    for name in ("watch-v1", "intercept-v1", "hotspots-v1"):
        space = lissajous_env.scenario_space(name)
        scenarios = [task for split in ("test", *space.shifts) for task in itertools.islice(space.scenarios(split), 3)]
        assert len({layout(scenario).size for scenario in scenarios}) == 1


@pytest.mark.parametrize("name", ["follow", "a-cmommt", "greedy-cover", "lead-pursuit", "divided-pursuit"])
def test_without_targets_in_its_row_a_robot_patrols(name):
    blind = lissajous_env.scenario("watch", **{f"sensing.{'targets' if name == 'follow' else 'tracks'}_seen": 0})
    rows = lissajous_env.Simulation(blind, seed=1).observation.numpy()
    patrol = Lanes(blind, reach=blind.resolve().sight).act(rows)
    np.testing.assert_array_equal(baselines.make(name, blind).act(rows), patrol)


def test_what_cannot_work_is_refused_by_name():
    with pytest.raises(ValueError, match="setting of Chase must be an attribute of the class, got lad"):
        Chase("intercept", lad=0.5)
    with pytest.raises(ValueError, match=r"targets.arrival_rate must be above 0 for an index rule \[1/s\], got 0"):
        baselines.make("index", "watch")
    with pytest.raises(ValueError, match=r"sensing.shared must be team, with .* got ring"):
        baselines.make("index", lissajous_env.scenario("hotspots", **{"sensing.shared": "ring"}))
