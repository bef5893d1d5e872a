"""Portfolios: the rehearsed patrol that is best drives the robots, and scenarios without a prior are refused."""

import dataclasses

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.planning import plans, portfolio
from baselines.planning.portfolio import DETECTION, GUARANTEE, Layer, Prior, Result, features_of
from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.settings import PolicySettings

SCENARIO = lissajous_env.scenario("monitoring-v1-8", **{"task.duration": 2.0, "task.contamination": None})
PATROLS = PolicySettings("sweep", {"cruise": 0.9, "inset": 0.5}), PolicySettings("partition"), PolicySettings("still")


def prior(values=(0.0, 1.0, -1.0), patrols=PATROLS, objective=DETECTION, within=1.0):
    """Return a prior with the same values, the largest of which is the best, whatever the scenario."""
    numbers = features_of(SCENARIO)
    layers = Layer(np.zeros((1, len(numbers))), np.zeros(1)), Layer(np.zeros((len(values), 1)), np.array(values))
    limits = np.stack([numbers - within, numbers + within], axis=1)
    return Prior({}, objective, patrols, limits, limits, np.zeros((1, len(values))), layers)


def test_parameters_are_relative_to_the_scenario():
    larger = SCENARIO.scaled(3.0, 0.5)
    top, radius = larger.robot.top_speed, larger.sensing_radius
    assert plans.absolute(PATROLS[0], larger).parameters == {"cruise": 0.9 * top, "inset": 0.5 * radius}


@pytest.mark.parametrize("name", portfolio.NAMES)
def test_the_order_depends_on_no_unit(name):
    orders = []
    for seed in range(3):
        task = lissajous_env.scenario(f"monitoring-v1-{seed}")
        scaled = task.scaled(7.0, 0.3)
        assert features_of(scaled) == pytest.approx(features_of(task), abs=1e-9)
        one, other = (portfolio.ordered(Prior.read(name), scenario, 0) for scenario in (task, scaled))
        assert [patrol.policy for patrol in one] == [patrol.policy for patrol in other]
        orders.append([patrol.policy for patrol in one])
    assert orders[0] != orders[1] or orders[1] != orders[2], "it depends on the scenario"


def test_rows_of_faults_that_repeat_or_overlap_count_once():
    once = {"faults.schedule": ((0, 0.5, 1.5),), "faults.removed": ((1, 1.0),)}
    rows = (0, 1.0, 1.5), (0, 0.5, 1.2), (0, 1.0, 1.5), (2, 3.0, 4.0)
    again = {"faults.schedule": rows, "faults.removed": ((1, 1.0), (1, 1.0))}
    one, other = (features_of(lissajous_env.scenario(SCENARIO, **fields)).tolist() for fields in (once, again))
    assert one == other != features_of(SCENARIO).tolist()


@pytest.mark.parametrize("objective", [DETECTION, GUARANTEE])
def test_the_best_of_the_rehearsed_patrols_is_chosen(objective):
    """Oracle: the patrols' own episodes; the prior prefers the one that stands still."""
    task = lissajous_env.scenario(
        SCENARIO,
        **{"task.duration": 20.0, "task.contamination": (30, 20), "sensing.radius": 0.8 * SCENARIO.curve.half_height},
    )
    biased_prior = prior((0.0, 1.0, 2.0), objective=objective, within=99.0)
    column = "detection_time_mean" if objective == DETECTION else "guaranteed_detection_time"
    costs = {}
    for settings in portfolio.ordered(biased_prior, task, 0):
        rows = lissajous_env.evaluate(settings.make(task, 4), task, range(800_000, 800_004))
        times = [row[column] for row in rows]
        time = np.mean(times) if objective == DETECTION else max(times)
        if objective == GUARANTEE and any(row["guarantee_open"] for row in rows):
            time = 2 * 20.0
        collisions = np.mean([row["collisions"] for row in rows])
        costs[settings.policy] = np.log(max(time, task.task.step)) + 0.1 * min(collisions, 20)
    assert portfolio.ordered(biased_prior, task, 0)[0].policy == "still"
    order = [patrol.policy for patrol in portfolio.ordered(biased_prior, task, 3)]
    assert order[0] == min(costs, key=lambda policy: costs[policy]) != "still"
    assert sorted(order) == ["partition", "still", "sweep"]


def test_rehearsals_for_detection_play_the_rogues_of_the_scenario():
    hunted = lissajous_env.scenario(SCENARIO, **{"targets.rogues": "flee", "targets.speed_limit": 9.0})
    stages = [portfolio.rehearsal_of(hunted, objective) for objective in (DETECTION, GUARANTEE)]
    assert [stage.targets.rogues for stage in stages] == ["flee", None]
    assert [stage.task.contamination is None for stage in stages] == [True, False]


def test_more_patrols_are_rehearsed_outside_of_the_fit(monkeypatch):
    counts = []
    monkeypatch.setattr(portfolio, "best_rehearsed", lambda prior, scenario, count: counts.append(count))
    seen = prior()
    for fit in (seen, dataclasses.replace(seen, seen=seen.seen + 1.5)):
        portfolio.ordered(fit, SCENARIO)
    assert counts == [5, 10]


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


@pytest.mark.parametrize("seed", [40, 41])
def test_the_portfolio_never_touches(seed):
    """Scenarios of no split's first ones; robots fail and stop dead, actuators are noisy, and messages are lost."""
    task = lissajous_env.scenario(f"monitoring-v1-{seed}", **{"task.duration": 30.0, "task.contamination": None})
    assert baselines.chosen("portfolio", task).policy.endswith("-proved")
    rows = lissajous_env.evaluate(baselines.make("portfolio", task, 8), task, range(8))
    assert sum(row["collisions"] for row in rows) == 0
    assert all(row["detected_fraction"] > 0 for row in rows)
    assert {row["policy"] for row in rows} == {"portfolio"}
