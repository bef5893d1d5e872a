"""Portfolios: the rehearsed patrol that is best drives the robots, and scenarios that suit none are refused."""

import numpy as np
import pytest

import baselines
import lissajous_env
from baselines.planning import plans, portfolio
from baselines.planning.portfolio import DETECTION, GUARANTEE, cost
from baselines.policies.base import UnsuitableScenarioError
from baselines.policies.settings import PolicySettings

SCENARIO = lissajous_env.scenario("monitoring-v1-8", **{"task.duration": 2.0, "task.contamination": None})
PATROLS = PolicySettings("sweep", {"cruise": 0.9, "inset": 0.5}), PolicySettings("partition"), PolicySettings("still")


@pytest.fixture
def patrols(monkeypatch):
    """Return a function that replaces the patrols of both portfolios."""

    def replace(*settings):
        portfolio._best_rehearsed.cache_clear()
        for name in portfolio.NAMES:
            monkeypatch.setitem(portfolio.PATROLS, name, settings)

    yield replace
    portfolio._best_rehearsed.cache_clear()


def test_parameters_are_relative_to_the_scenario():
    larger = SCENARIO.scaled(3.0, 0.5)
    top, radius = larger.robot.top_speed, larger.sensing_radius
    assert plans.absolute(PATROLS[0], larger).parameters == {"cruise": 0.9 * top, "inset": 0.5 * radius}


@pytest.mark.parametrize("name", portfolio.NAMES)
def test_the_choice_depends_on_no_unit(name, patrols):
    patrols(*PATROLS[:2], PolicySettings("laps", {"cruise": 0.7}))
    chosen = []
    for seed in range(3):
        task = lissajous_env.scenario(f"monitoring-v1-{seed}", **{"task.duration": 5.0, "task.contamination": None})
        one, other = (baselines.chosen(name, scenario) for scenario in (task, task.scaled(8.0, 0.25)))
        assert one.policy == other.policy
        assert one.parameters.keys() == other.parameters.keys()
        chosen.append(one.policy)
    assert len(set(chosen)) > 1, "it depends on the scenario"


@pytest.mark.parametrize("objective", [DETECTION, GUARANTEE])
def test_the_best_of_the_rehearsed_patrols_is_chosen(objective, patrols):
    """Oracle: the patrols' own episodes; the first one stands still."""
    task = lissajous_env.scenario(
        SCENARIO,
        **{"task.duration": 20.0, "task.contamination": (30, 20), "sensing.radius": 0.8 * SCENARIO.curve.half_height},
    )
    column = "detection_time_mean" if objective == DETECTION else "guaranteed_detection_time"
    costs = {}
    for settings in PATROLS:
        rows = lissajous_env.evaluate(plans.absolute(settings, task).make(task, 16), task, range(800_000, 800_016))
        times = [row[column] for row in rows]
        time = np.mean(times) if objective == DETECTION else max(times)
        if objective == GUARANTEE and any(row["guarantee_open"] for row in rows):
            time = 2 * 20.0
        collisions = np.mean([row["collisions"] for row in rows])
        costs[settings.policy] = np.log(max(time, task.task.step)) + 0.1 * min(collisions, 20)
    patrols(*reversed(PATROLS))
    assert baselines.chosen(objective, task).policy == min(costs, key=lambda policy: costs[policy]) != "still"


def test_rehearsals_for_detection_play_the_rogues_of_the_scenario():
    hunted = lissajous_env.scenario(SCENARIO, **{"targets.rogues": "flee", "targets.speed_limit": 9.0})
    for scenario, rogues in ((hunted, "flee"), (lissajous_env.scenario(hunted, rogues="agents"), None)):
        stages = (portfolio.rehearsal_of(scenario.resolve(), objective) for objective in (DETECTION, GUARANTEE))
        fields = [(stage.targets.rogues, stage.task.contamination is None) for stage in stages]
        assert fields == [(rogues, True), (None, False)]


def test_a_patrol_that_does_not_suit_the_scenario_is_passed_over(patrols):
    patrols(PolicySettings("line-abreast"), PolicySettings("sweep"))
    short = lissajous_env.scenario(SCENARIO, **{"sensing.radius": 0.03 * SCENARIO.curve.half_height})
    assert portfolio.chosen("portfolio", short).policy == "sweep"
    assert type(baselines.make("portfolio", short)) is type(baselines.make("sweep", short))
    patrols(PolicySettings("line-abreast"))
    with pytest.raises(UnsuitableScenarioError, match="line"):
        baselines.make("portfolio", short)


def test_other_robots_and_names_are_refused():
    with pytest.raises(UnsuitableScenarioError, match=r"robot\.kind must be car, got curve"):
        baselines.chosen("portfolio", lissajous_env.scenario("ideal"))
    with pytest.raises(ValueError, match=r"portfolio must be one of portfolio, portfolio-guarantee, got 'sweep'"):
        baselines.chosen("sweep", SCENARIO)


def test_below_a_control_step_only_collisions_count():
    costs = [cost(time, collisions, 1.0) for time, collisions in ((0.1, 1.0), (0.9, 0.0), (1.1, 0.0))]
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
