"""The value of feedback: where it is measured, where it is 1, and what the command prints."""

import json

import pytest

import lissajous_env
from lissajous_env.console.scenarios import measured, scenarios, value_of_feedback
from lissajous_env.console.terminal import Output


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
