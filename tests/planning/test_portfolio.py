"""Portfolios: the rehearsed patrol that is best drives the robots, and scenarios without a prior are refused."""

import dataclasses

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.planning import plans, portfolio
from baselines.planning.prior import NUMBERS, Layer, Prior, complementary, numbers_of
from baselines.planning.rehearse import DETECTION, GUARANTEE, Result
from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.settings import PolicySettings

SCENARIO = lissajous_env.scenario("monitoring-v1-8", **{"task.duration": 2.0, "task.contamination": None})
PATROLS = PolicySettings("sweep", {"cruise": 0.9, "inset": 0.5}), PolicySettings("partition"), PolicySettings("still")


def prior(values=(0.0, 1.0, -1.0), patrols=PATROLS, objective=DETECTION, within=1.0):
    """Return a prior with the same values, the largest of which is the best, whatever the scenario."""
    layers = Layer(np.zeros((1, len(NUMBERS))), np.zeros(1)), Layer(np.zeros((len(values), 1)), np.array(values))
    numbers = numbers_of(SCENARIO)
    limits = np.stack([numbers - within, numbers + within], axis=1)
    return Prior({}, objective, patrols, limits, limits, np.zeros((1, len(values))), layers)


def test_parameters_are_relative_to_the_scenario():
    larger = SCENARIO.scaled(3.0, 0.5)
    top, radius = larger.robot.top_speed, larger.sensing_radius
    assert plans.absolute(PATROLS[0], larger).parameters == {"cruise": 0.9 * top, "inset": 0.5 * radius}


@pytest.mark.parametrize("name", portfolio.NAMES)
def test_the_order_depends_on_no_unit(name):
    for seed in range(3):
        task = lissajous_env.scenario(f"monitoring-v1-{seed}")
        scaled = task.scaled(7.0, 0.3)
        assert numbers_of(scaled) == pytest.approx(numbers_of(task), abs=1e-9)
        one, other = (portfolio.ordered(Prior.read(name), each, 0) for each in (task, scaled))
        assert [each.policy for each in one] == [each.policy for each in other]


@pytest.mark.parametrize("objective", [DETECTION, GUARANTEE])
def test_the_best_of_the_rehearsed_patrols_is_chosen(objective):
    """Oracle: the patrols' own episodes; the prior prefers the one that stands still."""
    task = lissajous_env.scenario(
        SCENARIO,
        **{"task.duration": 20.0, "task.contamination": (30, 20), "sensing.radius": 0.8 * SCENARIO.curve.half_height},
    )
    given = prior((0.0, 1.0, 2.0), objective=objective, within=99.0)
    column = "detection_time_mean" if objective == DETECTION else "guaranteed_detection_time"
    costs = {}
    for settings in portfolio.ordered(given, task, 0):
        rows = lissajous_env.evaluate(settings.make(task, 4), task, range(800_000, 800_004))
        times = [row[column] for row in rows]
        time = np.mean(times) if objective == DETECTION else max(times)
        if objective == GUARANTEE and any(row["guarantee_open"] for row in rows):
            time = 2 * 20.0
        collisions = np.mean([row["collisions"] for row in rows])
        costs[settings.policy] = np.log(max(time, task.task.step)) + 0.1 * min(collisions, 20)
    assert portfolio.ordered(given, task, 0)[0].policy == "still"
    order = [each.policy for each in portfolio.ordered(given, task, 3)]
    assert order[0] == min(costs, key=lambda policy: costs[policy]) != "still"
    assert sorted(order) == ["partition", "still", "sweep"]


def best(monkeypatch, times, objective, count):
    """Return the index of the best of policies with times in few and in many episodes, and what was played."""
    played = []

    def result_of(settings, task, episodes, *_):
        played.append((settings.policy, episodes))
        return Result(times[settings.policy][episodes > portfolio.FEW], 0.0)

    monkeypatch.setattr(portfolio, "result_of", result_of)
    return portfolio.best_of([PolicySettings(name) for name in times], SCENARIO, objective, count), played


def test_a_lucky_rehearsal_does_not_decide(monkeypatch):
    # Story: `lucky` is the best one in few episodes, and fails in more; `third` is not played again.
    times = {"third": (3.0, None), "lucky": (1.0, 5.0), "second": (2.0, 2.0)}
    assert best(monkeypatch, times, DETECTION, 3)[0] == 2
    assert best(monkeypatch, times, DETECTION, 1)[0] == 0


@pytest.mark.parametrize(("objective", "index"), [(GUARANTEE, 2), (DETECTION, 0)])
def test_a_guarantee_is_rehearsed_until_no_patrol_can_be_better(monkeypatch, objective, index):
    # Story: two finalists of four episodes have a second mode in sixteen; the third is a little longer, in all of them.
    times = {"a": (16.0, 25.8), "b": (16.1, 25.9), "c": (16.3, 16.3), "d": (26.0, 26.0)}
    found, played = best(monkeypatch, times, objective, 4)
    assert found == index
    assert ("d", portfolio.MANY) not in played


def test_rehearsals_for_detection_play_the_rogues_of_the_scenario():
    hunted = lissajous_env.scenario(SCENARIO, **{"targets.rogues": "flee", "targets.speed_limit": 9.0})
    stages = [portfolio.stage(hunted, objective) for objective in (DETECTION, GUARANTEE)]
    assert [each.targets.rogues for each in stages] == ["flee", None]
    assert [each.task.contamination is None for each in stages] == [True, False]


def test_more_patrols_are_rehearsed_outside_of_the_fit(monkeypatch):
    counts = []
    monkeypatch.setattr(portfolio, "_best", lambda given, task, objective, count: counts.append(count))
    seen = prior()
    for each in (seen, dataclasses.replace(seen, seen=seen.seen + 1.5)):
        portfolio.ordered(each, SCENARIO)
    assert counts == [5, 10]


def test_patrols_that_fail_together_are_not_rehearsed_together():
    """Two equal patrols are predicted to be the best; the third is better where these are worse than predicted."""
    predicted, errors = np.array([0.0, 0.1, 0.5]), np.array([[1.0, 1.0, 0.0], [-1.0, -1.0, 0.0]])
    assert complementary(predicted, errors) == [0, 2, 1]
    assert complementary(predicted, np.zeros((1, 3))) == [0, 1, 2]


def test_every_patrol_comes_where_it_lowers_the_expected_smallest_cost_most():
    """Oracle: the expected cost of each pair that contains the first one."""
    rng = np.random.default_rng(0)
    predicted, errors = rng.normal(size=6), rng.normal(size=(50, 6))
    costs = predicted + errors
    first, second, *others = complementary(predicted, errors)
    assert sorted([first, second, *others]) == list(range(6))
    assert first == costs.mean(axis=0).argmin()
    pairs = {k: np.minimum(costs[:, first], costs[:, k]).mean() for k in range(6) if k != first}
    assert second == min(pairs, key=lambda k: pairs[k])


def test_a_patrol_that_does_not_suit_the_scenario_is_passed_over(monkeypatch):
    lines = prior((1.0, 0.0), (PolicySettings("line-abreast"), PolicySettings("sweep")), within=99.0)
    monkeypatch.setattr(Prior, "read", lambda name: lines)
    short = lissajous_env.scenario(SCENARIO, **{"sensing.radius": 0.03 * SCENARIO.curve.half_height})
    assert portfolio.chosen("portfolio", short).policy == "sweep"
    assert type(baselines.make("portfolio", short)) is type(baselines.make("sweep", short))


def test_a_scenario_outside_of_the_limits_is_refused_by_name():
    fast = lissajous_env.scenario(SCENARIO, **{"targets.speed": 5 * SCENARIO.robot.top_speed})
    with pytest.raises(UnsuitableScenarioError, match=r"top speed over that of the robots must be at most .* got 2"):
        portfolio.ordered(prior(), fast)
    long = lissajous_env.scenario(SCENARIO, **{"curve.half_width": 900 * SCENARIO.curve.half_height})
    with pytest.raises(UnsuitableScenarioError, match=r"over its height must be from .* to .*, for which .* got 900"):
        portfolio.ordered(prior(), long)
    with pytest.raises(UnsuitableScenarioError, match=r"robot\.kind must be car, got curve"):
        portfolio.ordered(prior(), lissajous_env.scenario("ideal"))
    with pytest.raises(ValueError, match=r"portfolio must be one of portfolio, portfolio-guarantee, got 'sweep'"):
        baselines.chosen("sweep", SCENARIO)


def test_below_a_control_step_only_collisions_count():
    costs = [Result(time, collisions).cost(1.0) for time, collisions in ((0.1, 1.0), (0.9, 0.0), (1.1, 0.0))]
    assert costs == pytest.approx((0.1, 0.0, np.log(1.1)))


def test_what_was_played_for_a_prior_is_not_played_again(tmp_path, monkeypatch):
    pytest.importorskip("torch")
    import prior as fitting

    task = lissajous_env.scenario("monitoring-v1-8", **{"task.duration": 2.0, "task.contamination": None})
    first = fitting.results(tmp_path / "table.jsonl", prior(), [task], 2)
    assert first.shape == (1, 3, 2)
    assert (first[..., 0] > 0).all()
    monkeypatch.setattr(fitting, "result_of", None)
    np.testing.assert_array_equal(fitting.results(tmp_path / "table.jsonl", prior(), [task], 2), first)
    with pytest.raises(TypeError):
        fitting.results(tmp_path / "table.jsonl", prior(), [task], 1)


def test_a_rule_in_the_costs_is_found_and_written(tmp_path, monkeypatch):
    """Oracle: costs that depend on the sign of one number; five digits change no prediction by more than 1 %."""
    pytest.importorskip("torch")
    import prior as fitting

    rng = np.random.default_rng(0)
    numbers = rng.normal(5.0, 2.0, (200, 4))
    rule = (numbers[:, 1] > 5.0).astype(float)
    layers = fitting.fit(numbers, np.stack([rule, 1.0 - rule, np.full(200, 0.6)], axis=1), seed=0)
    unseen = rng.normal(5.0, 2.0, (200, 4))
    picked = np.array([fitting.costs_of(layers, each).argmin() for each in unseen])
    assert np.mean(picked == (unseen[:, 1] > 5.0)) > 0.9
    monkeypatch.setattr("baselines.planning.prior.FOLDER", tmp_path)
    (tmp_path / "fitted.json").write_text(fitting.as_text(dataclasses.replace(prior(), layers=layers)))
    again = Prior.read("fitted")
    assert again.patrols == PATROLS
    np.testing.assert_allclose(
        [fitting.costs_of(again.layers, each) for each in unseen],
        [fitting.costs_of(layers, each) for each in unseen],
        atol=0.01,
    )


@pytest.mark.parametrize("seed", [40, 41])
def test_the_portfolio_never_touches(seed):
    """Scenarios of no split's first ones; robots fail and stop dead, actuators are noisy, and messages are lost."""
    task = lissajous_env.scenario(f"monitoring-v1-{seed}", **{"task.duration": 30.0, "task.contamination": None})
    assert baselines.chosen("portfolio", task).policy.endswith("-proved")
    rows = lissajous_env.evaluate(baselines.make("portfolio", task, 8), task, range(8))
    assert sum(row["collisions"] for row in rows) == 0
    assert all(row["detected_fraction"] > 0 for row in rows)
    assert {row["policy"] for row in rows} == {"portfolio"}
