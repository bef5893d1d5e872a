"""A learned choice: it finds a rule in costs, plays exactly what it chose, and refuses what it was not trained for."""

import dataclasses
import json

import numpy as np
import pytest
from test_learned import played

import baselines
import lissajous_env
import training
from baselines.policies import registry
from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.settings import PolicySettings
from lissajous_env import Simulation
from lissajous_env.console.terminal import plain
from lissajous_env.storage.journal import Journal
from training.choosing import chooser, playing, rehearsing
from training.choosing.candidates import Candidate
from training.choosing.chooser import FILE, Chooser, names, outputs
from training.choosing.features import FEATURES, numbers_of
from training.choosing.rehearsing import complementary
from training.learned.network import Network

SCENARIO = lissajous_env.scenario("monitoring-v1-8", **{"task.duration": 2.0, "task.contamination": None})
PATROLS = Candidate("sweep", {"cruise": 0.9, "inset": 0.5}), Candidate("partition"), Candidate("still")


def made(weight=(0.0, 1.0, -1.0), candidates=PATROLS):
    """Return a chooser that ranks the candidates by `weight`, whatever the scenario."""
    count = len(FEATURES)
    network = Network((np.zeros((len(weight), count)),), (np.array(weight),), "tanh")
    wide = tuple((value - 1.0, value + 1.0) for value in numbers_of(SCENARIO).tolist())
    return Chooser(
        network,
        tuple(FEATURES),
        candidates,
        wide,
        wide,
        {"space": "monitoring-v1"},
        plain(SCENARIO.resolve().to_dict()),
    )


def stored(folder, **changes):
    folder.mkdir()
    (folder / FILE).write_text(json.dumps(made().to_dict() | changes))
    return str(folder)


def test_the_best_candidate_is_played(tmp_path):
    """Oracle: the policy with its parameters in the units of the scenario, bit for bit."""
    folder = stored(tmp_path / "choice")
    expected, found = (
        played(baselines.make(name, SCENARIO, 2), Simulation(SCENARIO, 2), 20) for name in ("partition", folder)
    )
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)
    given = training.chosen(folder, SCENARIO)
    assert (given.policy, dict(given.parameters)) == ("partition", {})


def test_parameters_are_relative_to_the_scenario():
    larger = SCENARIO.scaled(3.0, 0.5)
    top, radius = larger.robot.top_speed, larger.sensing_radius
    assert PATROLS[0].settings(larger).parameters == {"cruise": 0.9 * top, "inset": 0.5 * radius}


@pytest.mark.parametrize("name", names())
def test_the_choice_depends_on_no_unit(name):
    learned = Chooser.read(name)
    for seed in range(3):
        made = lissajous_env.scenario(f"monitoring-v1-{seed}")
        scaled = made.scaled(7.0, 0.3)
        assert numbers_of(scaled) == pytest.approx(numbers_of(made), abs=1e-9)
        one, other = (learned.ranked(each) for each in (made, scaled))
        assert [each.policy for each in one] == [each.policy for each in other]


@pytest.mark.parametrize("objective", [playing.DETECTION, playing.GUARANTEE])
def test_the_best_of_the_rehearsed_candidates_is_chosen(objective):
    """Oracle: the candidates' own episodes; the network prefers the one that stands still."""
    scenario = lissajous_env.scenario(
        SCENARIO,
        **{"task.duration": 20.0, "task.contamination": (30, 20), "sensing.radius": 0.8 * SCENARIO.curve.half_height},
    )
    alone = dataclasses.replace(made((0.0, 1.0, 2.0)), limits=tuple((-99.0, 99.0) for _ in FEATURES))
    learned = dataclasses.replace(alone, rehearsed=3, about={"objective": objective}, errors=np.zeros((1, 3)))
    column = "detection_time_mean" if objective == playing.DETECTION else "guaranteed_detection_time"
    costs = {}
    for settings in alone.ranked(scenario):
        rows = lissajous_env.evaluate(settings.make(scenario, 4), scenario, range(800_000, 800_004))
        times = [row[column] for row in rows]
        time = np.mean(times) if objective == playing.DETECTION else max(times)
        if objective == playing.GUARANTEE and any(row["guarantee_open"] for row in rows):
            time = 2 * 20.0
        collisions = np.mean([row["collisions"] for row in rows])
        costs[settings.policy] = np.log(max(time, scenario.task.step)) + 0.1 * min(collisions, 20)
    assert alone.chosen(scenario)[0].policy == "still"
    assert learned.chosen(scenario)[0].policy == min(costs, key=lambda policy: costs[policy]) != "still"
    assert sorted(each.policy for each in learned.chosen(scenario)) == ["partition", "still", "sweep"]


def test_a_lucky_rehearsal_does_not_decide(monkeypatch):
    # Story: `lucky` is the best one in few episodes, and fails in more; `third` is not played again.
    times = {("lucky", 4): 1.0, ("lucky", 16): 5.0, ("second", 4): 2.0, ("second", 16): 2.0, ("third", 4): 3.0}

    def play(settings, scenario, episodes, objective, first_seed):
        return {"time": times[settings.policy, episodes], "collisions": 0.0}

    monkeypatch.setattr(rehearsing, "play", play)
    given = [PolicySettings(name, {}) for name in ("third", "lucky", "second")]
    assert rehearsing.best_rehearsed(given, SCENARIO, playing.DETECTION, 3) == 2
    assert rehearsing.best_rehearsed(given, SCENARIO, playing.DETECTION, 1) == 0


def test_rehearsals_for_detection_play_the_rogues_of_the_scenario(monkeypatch):
    stages = []

    def play(settings, scenario, episodes, objective, first_seed):
        stages.append(scenario)
        return {"time": 1.0, "collisions": 0.0}

    monkeypatch.setattr(rehearsing, "play", play)
    hunted = lissajous_env.scenario(SCENARIO, **{"targets.rogues": "flee", "targets.speed_limit": 9.0})
    for objective in (playing.DETECTION, playing.GUARANTEE):
        rehearsing.best_rehearsed([PolicySettings("sweep", {})], hunted, objective, 1)
    assert [each.targets.rogues for each in stages] == ["flee", None]
    assert [each.task.contamination is None for each in stages] == [True, False]


def test_more_candidates_are_rehearsed_outside_of_the_training(monkeypatch):
    counts = []
    monkeypatch.setattr(chooser, "best_rehearsed", lambda ranked, scenario, objective, count: counts.append(count))
    learned = dataclasses.replace(made(), rehearsed=1, about={"objective": playing.DETECTION}, errors=np.zeros((1, 3)))
    farther = dataclasses.replace(learned, seen=tuple((value - 1.0, value - 0.5) for value in numbers_of(SCENARIO)))
    for each in (learned, farther):
        each.chosen(SCENARIO)
    assert counts == [1, 2]


def test_candidates_that_fail_together_are_not_rehearsed_together():
    """Two equal candidates are predicted to be the best; the third is better where these are worse than predicted."""
    predicted, errors = np.array([0.0, 0.1, 0.5]), np.array([[1.0, 1.0, 0.0], [-1.0, -1.0, 0.0]])
    assert complementary(predicted, errors) == [0, 2, 1]
    assert complementary(predicted, np.zeros((1, 3))) == [0, 1, 2]


def test_every_candidate_comes_where_it_lowers_the_expected_smallest_cost_most():
    """Oracle: the expected cost of each pair that contains the first one."""
    rng = np.random.default_rng(0)
    predicted, errors = rng.normal(size=6), rng.normal(size=(50, 6))
    costs = predicted + errors
    first, second, *others = complementary(predicted, errors)
    assert sorted([first, second, *others]) == list(range(6))
    assert first == costs.mean(axis=0).argmin()
    pairs = {k: np.minimum(costs[:, first], costs[:, k]).mean() for k in range(6) if k != first}
    assert second == min(pairs, key=lambda k: pairs[k])


def test_a_candidate_that_does_not_suit_the_scenario_is_passed_over():
    lines = Candidate("line-abreast"), Candidate("sweep")
    short = lissajous_env.scenario(SCENARIO, **{"sensing.radius": 0.03 * SCENARIO.curve.half_height})
    wide = tuple((-99.0, 99.0) for _ in FEATURES)
    policy = dataclasses.replace(made((1.0, 0.0), lines), limits=wide).make(short)
    assert type(policy) is type(baselines.make("sweep", short))


def test_a_scenario_outside_of_the_training_is_refused_by_name():
    fast = lissajous_env.scenario(SCENARIO, **{"targets.speed": 5 * SCENARIO.robot.top_speed})
    with pytest.raises(UnsuitableScenarioError, match=r"top speed over that of the robots must be at most .* got 2"):
        made().make(fast)
    long = lissajous_env.scenario(SCENARIO, **{"curve.half_width": 900 * SCENARIO.curve.half_height})
    with pytest.raises(UnsuitableScenarioError, match=r"over its height must be from .* to .*, for which .* got 900"):
        made().make(long)
    points = lissajous_env.scenario("ideal")
    with pytest.raises(UnsuitableScenarioError, match=r"robot\.kind must be car, got curve"):
        made().make(points)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format": 2}, "format must be 3"),
        ({"rehearsed": -1}, "rehearsed must be"),
        ({"rehearsed": 2}, "about must contain the objective, detection or guarantee, got"),
        ({"rehearsed": 2, "about": {"objective": "detection"}}, r"errors must have a row or more of 3 numbers"),
        ({"errors": [["many"]]}, "could not convert"),
        ({"features": ["luck"]}, "features must be of"),
        ({"candidates": [{"policy": "sweep", "parameters": {"cruise": "fast"}}]}, "cruise of sweep must be a finite"),
        ({"limits": []}, "limits must have"),
        ({"network": {}}, "must contain 'layers'"),
        ({"candidates": []}, "network must map"),
        ({"candidates": [{"policy": 3}]}, "policy of a candidate must be a name"),
        ({"candidates": [{"policy": "sweep", "parameters": 3}]}, "parameters of sweep must be an object"),
        ({"network": {"activation": "x" * 5000, "layers": [{"weight": [[0.0]], "bias": [0.0]}]}}, "activation must be"),
    ],
)
def test_a_damaged_file_is_named(changes, words, tmp_path):
    folder = stored(tmp_path / "choice", **changes)
    with pytest.raises(ValueError, match=f"{FILE} is damaged: .*{words}") as error:
        Chooser.read(folder)
    assert len(str(error.value)) < 1000


def test_a_chooser_is_read_as_it_was_written(tmp_path):
    folder = stored(tmp_path / "choice")
    assert Chooser.read(folder).to_dict() == made().to_dict()
    other = stored(tmp_path / "other", candidates=[each.to_dict() for each in PATROLS[::-1]])
    assert registry.parts(folder) != registry.parts(other)


def test_costs_order_candidates_by_time_and_collisions():
    made = [SCENARIO]
    found = {
        (SCENARIO.digest(), PATROLS[0].name): {"time": 2.0, "collisions": 1.0},
        (SCENARIO.digest(), PATROLS[1].name): {"time": 1.0, "collisions": 0.0},
        (SCENARIO.digest(), PATROLS[2].name): {"time": None, "collisions": None},
    }
    ((first, second, third),) = playing.costs(found, PATROLS, made)
    assert second == 0.0
    assert first == pytest.approx(np.log(2.0) + 0.1)
    assert third > first


def test_below_a_control_step_only_collisions_count():
    step = SCENARIO.task.step
    found = {
        (SCENARIO.digest(), each.name): {"time": time * step, "collisions": collisions}
        for each, time, collisions in zip(PATROLS, (0.1, 0.9, 1.1), (1.0, 0.0, 0.0), strict=True)
    }
    ((first, second, third),) = playing.costs(found, PATROLS, [SCENARIO])
    assert (first, second, third) == pytest.approx((0.1, 0.0, np.log(1.1)))


@pytest.mark.parametrize("objective", [playing.DETECTION, playing.GUARANTEE])
def test_what_was_played_is_not_played_again(objective, tmp_path, monkeypatch):
    made = lissajous_env.scenario("monitoring-v1-8", **{"task.duration": 2.0})
    with Journal(tmp_path / "table.jsonl") as journal:
        first = playing.table(PATROLS, [made], 2, objective, journal)
    assert all(each["time"] > 0 for each in first.values())
    monkeypatch.setattr(playing, "play", None)
    with Journal(tmp_path / "table.jsonl") as journal:
        assert playing.table(PATROLS, [made], 2, objective, journal) == first
        monkeypatch.undo()
        changed = lissajous_env.scenario(made, **{"targets.arrival_rate": 2.0})
        assert len(playing.table(PATROLS, [changed], 2, objective, journal)) == 2 * len(PATROLS)
        assert all(each["episodes"] == 1 for each in playing.table(PATROLS, [made], 1, objective, journal).values())


def test_a_rule_in_the_costs_is_found():
    """Oracle: costs that depend on the sign of one number."""
    pytest.importorskip("torch")
    from training.choosing.fitting import fit

    rng = np.random.default_rng(0)
    numbers = rng.normal(5.0, 2.0, (200, 4))
    best = (numbers[:, 1] > 5.0).astype(int)
    costs = np.stack([best, 1.0 - best, np.full(200, 0.6)], axis=1)
    network = fit(numbers, costs, seed=0)
    unseen = rng.normal(5.0, 2.0, (200, 4))
    picked = np.array([np.argmax(outputs(network, each)) for each in unseen])
    assert np.mean(picked == (unseen[:, 1] > 5.0)) > 0.9


def test_the_proved_filter_is_chosen_for_the_detection_time_only(tmp_path):
    pytest.importorskip("torch")
    from training.choosing.command import choose

    with pytest.raises(ValueError, match="proved must be False for the objective guarantee"):
        choose(objective="guarantee", proved=True, out=tmp_path / "choice")
    assert not (tmp_path / "choice").exists()


@pytest.mark.parametrize("seed", [40, 41])
def test_learned_careful_never_touches(seed):
    """Scenarios of no split's first ones; robots fail and stop dead, actuators are noisy, and messages are lost."""
    made = lissajous_env.scenario(f"monitoring-v1-{seed}", **{"task.duration": 30.0, "task.contamination": None})
    assert training.chosen("learned-careful", made).policy.endswith("-proved")
    rows = lissajous_env.evaluate(baselines.make("learned-careful", made, 8), made, range(8))
    assert sum(row["collisions"] for row in rows) == 0
    assert all(row["detected_fraction"] > 0 for row in rows)


def test_a_choice_is_loaded_as_other_learned_policies(tmp_path):
    folder = stored(tmp_path / "choice")
    loaded = lissajous_env.load(folder, SCENARIO, 3)
    assert (loaded.name, loaded.num_worlds, type(loaded)) == (folder, 3, type(baselines.make("partition", SCENARIO)))
    assert lissajous_env.load("learned-patrol").scenario.name == "monitoring-v1-0"
    with pytest.raises(ValueError, match=r"policy must be one of learned-intruders, or"):
        training.load("learned-nothing")


@pytest.mark.parametrize(("objective", "best"), [("guarantee", 2), ("detection", 0)])
def test_a_guarantee_is_rehearsed_until_no_candidate_can_be_better(monkeypatch, objective, best):
    # Story: two finalists of four episodes have a second mode in sixteen; the third is a little longer, in all of them.
    times = {"a": (16.0, 25.8), "b": (16.1, 25.9), "c": (16.3, 16.3), "d": (26.0, 26.0)}
    played = []

    def play(settings, scenario, episodes, objective, first_seed):
        played.append((settings.policy, episodes))
        return {"time": times[settings.policy][episodes > rehearsing.EPISODES], "collisions": 0.0}

    monkeypatch.setattr(rehearsing, "play", play)
    ranked = [PolicySettings(name, {}) for name in times]
    scenario = lissajous_env.scenario("evaders", **{"task.duration": 7.3})
    assert rehearsing.best_rehearsed(ranked, scenario, objective, len(times)) == best
    assert ("d", rehearsing.FINAL_EPISODES) not in played
