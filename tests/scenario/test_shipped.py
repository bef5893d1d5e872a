"""Included scenarios: the numbers support the purpose of each, and the value of feedback on it."""

import json

import pytest

import baselines
import lissajous_env
from baselines.benchmark.statistics import summarize
from lissajous_env.console.scenarios import measured, scenarios, value_of_feedback
from lissajous_env.console.terminal import Output
from lissajous_env.world.columns import COLUMNS
from lissajous_env.world.simulation import Simulation


def played(name, scenario, column, episodes=4):
    rows = lissajous_env.evaluate(baselines.make(name, scenario, episodes), scenario, range(episodes))
    return summarize([row[column] for row in rows], COLUMNS[column].summary)


def test_a_team_that_reacts_keeps_apart_and_one_that_drives_detects():
    # Story: two robots stop for 10 s and resume. Those that react close the gap and keep their distance; those that
    # do not pass the places of others from then on. Either detects far sooner than robots that do not move.
    names = ("kuramoto-mpcc", "open-loop-mpcc", "still")
    detection = {name: played(name, "team", "detection_time_mean") for name in names}
    collisions = {name: played(name, "team", "collisions") for name in names}
    spacing = {name: played(name, "team", "spacing_factor") for name in names}
    assert collisions["kuramoto-mpcc"].value < 0.6 * collisions["open-loop-mpcc"].value
    assert spacing["kuramoto-mpcc"].high < spacing["open-loop-mpcc"].low
    assert max(detection["kuramoto-mpcc"].high, detection["open-loop-mpcc"].high) < 0.2 * detection["still"].low


def test_a_clustered_formation_comes_back_and_the_open_loop_does_not():
    # Story of Section V, with Fig. 6: those that stop resume; only who hears the others can close the gap again.
    recovery = {name: played(name, "redundant", "recovery_time", 2) for name in ("kuramoto", "open-loop")}
    assert recovery["kuramoto"].max < 15
    assert recovery["open-loop"].known == 0


@pytest.mark.parametrize(("name", "lost"), [("rough", 0), ("rough-lost", 1)])
def test_only_one_of_the_two_rough_ones_loses_a_robot(name, lost):
    scenario = lissajous_env.scenario(name)
    simulation = Simulation(scenario, 4)
    removed = simulation.robots.removed_at.numpy() <= scenario.task.steps
    assert (removed.sum(axis=1) == lost).all()


def test_the_measured_values_are_those_of_the_scenarios_as_they_are():
    # Oracle: the prototypes of these tasks: 2.3, 100 and 1.7.
    assert set(measured()) == {"watch", "intercept", "hotspots"}
    for name, least in {"watch": 2.0, "intercept": 20.0, "hotspots": 1.4}.items():
        scenario = lissajous_env.scenario(name)
        assert value_of_feedback(scenario) == measured()[name]["value"] > least
        assert measured()[name]["low"] < measured()[name]["value"] < measured()[name]["high"]
        assert value_of_feedback(lissajous_env.scenario(name, **{"sensing.radius": 1.2})) is None


@pytest.mark.parametrize("field", ["targets.respawn", "sensing.sight", "targets.leave", "targets.entry"])
def test_feedback_is_worth_nothing_unless_an_observation_tells_where_targets_are(field):
    value = {"targets.respawn": True, "sensing.sight": 2.0, "targets.leave": False, "targets.entry": "hotspots"}[field]
    plain = {"targets.count": 5, "task.contamination": None}
    assert value_of_feedback(lissajous_env.scenario("evaders", **plain)) == 1.0
    assert value_of_feedback(lissajous_env.scenario("evaders", **plain, **{field: value})) is None


def test_the_command_prints_the_value(capsys):
    scenarios(("watch", "evaders"), Output(json=True))
    watch, evaders = json.loads(capsys.readouterr().out)
    assert watch["value_of_feedback"] == measured()["watch"]["value"]
    assert evaders["value_of_feedback"] == 1.0
