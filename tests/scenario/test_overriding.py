"""Overrides of included scenarios: dependent fields adapt to another number of robots, or raise an error; `--set`."""

import math

import numpy as np
import pytest

import baselines
import lissajous_env
from lissajous_env.console.terminal import parse_overrides
from lissajous_env.envs.sides import action_table, state_names
from lissajous_env.episodes import guarantee, recording
from lissajous_env.episodes.missed.played import check_contamination
from lissajous_env.theory import closed_forms
from lissajous_env.world.observation import layout

SHORT = {"task.duration": 1.0}


@pytest.mark.parametrize(("name", "overrides", "count"), [
    ("experiment", {"robot.count": 7}, 7),
    ("experiment", {"robot": {"count": 7}}, 7),
    ("experiment", {"curve.a": 5, "curve.b": 4}, 9),
    ("rough", {"robot.count": 4}, 4),
    ("perturbation", {"robot.count": 20}, 20),
    ("ideal", {"robot.count": 11}, 11),
])  # fmt: skip
def test_another_number_of_robots_has_a_formation_of_its_own(name, overrides, count):
    # Story: `robot.count=7` on `experiment` requested a ring, which the user had never set. Oracle: the defaults of N.
    scenario = lissajous_env.scenario(name, **overrides)
    assert scenario.num_robots == count
    assert scenario.ring == tuple(range(count))
    assert scenario.p == closed_forms.default_p(count)
    env = lissajous_env.parallel_env(name, **overrides, **SHORT)
    observations, _ = env.reset(seed=0)
    assert len(observations) == count


def test_the_same_number_keeps_the_formation_and_what_is_given_stays():
    base = lissajous_env.scenario("experiment")
    assert lissajous_env.scenario("experiment", **{"robot.count": 5}).ring == base.ring
    fields = {"robot.count": 7, "formation.ring": (6, 5, 4, 3, 2, 1, 0), "formation.p": 2}
    scenario = lissajous_env.scenario("experiment", **fields)
    assert (scenario.ring, scenario.p) == ((6, 5, 4, 3, 2, 1, 0), 2)
    whole = lissajous_env.Formation(p=2)
    assert lissajous_env.scenario("experiment", formation=whole, **{"robot.count": 7}).p == 2
    with pytest.raises(ValueError, match=r"^formation.ring must contain each of the 7 robots once, got \(0, 1\)$"):
        lissajous_env.scenario("experiment", **{"robot.count": 7, "formation.ring": (0, 1)})


TAKES_A_SCENARIO = {
    "state_names": state_names,
    "layout": lambda scenario: layout(scenario).names,
    "action_table": lambda scenario: action_table(scenario).tolist(),
    "IdealFormation": lambda scenario: guarantee.IdealFormation(scenario).against(0.1).to_dict(),
    "check_contamination": check_contamination,
    "Simulation": lambda scenario: lissajous_env.Simulation(scenario).observation.numpy().tolist(),
    "names": baselines.names,
    "Rows": lambda scenario: baselines.Rows(np.zeros((1, 5, 42)), scenario).scenario.to_dict(),
}


@pytest.mark.parametrize("name", TAKES_A_SCENARIO)
def test_a_file_will_do_wherever_a_scenario_is_taken(name, tmp_path):
    # Story: `state_names("mine.toml")` was an AttributeError. Oracle: the same of the scenario that the file makes.
    path = tmp_path / "mine.toml"
    path.write_text("base = 'evaders'\n[task]\nduration = 2.0\n")
    call = TAKES_A_SCENARIO[name]
    assert call(str(path)) == call(path) == call(lissajous_env.scenario(path))


def test_overrides_wherever_worlds_are_made():
    # Story: `RobotVecEnv("failure", **{"task.duration": 5.0})` was a TypeError. Oracle: the length of the episode.
    assert lissajous_env.Simulation("failure", 2, **SHORT).scenario.task.steps == 10
    policy = baselines.make("kuramoto", "failure")
    scenario = lissajous_env.scenario("failure", **SHORT)
    rows = lissajous_env.evaluate(policy, "failure", seeds=[3], **SHORT)
    assert str(rows) == str(lissajous_env.evaluate(policy, scenario, seeds=[3]))
    assert len(recording.record(policy, "failure", 3, **SHORT)) == 11


# `--set`: literals, which are never executed, words, infinity.


def test_overrides_are_literals_words_and_infinity():
    words = [["curve.a=5", "task.grid=(4, 2)"], ["formation.start=random", "task.duration=inf"]]
    words.append(["robot.count=None", "robot.kind=ñandú"])
    assert parse_overrides(words) == {
        "curve.a": 5, "task.grid": (4, 2), "formation.start": "random", "task.duration": float("inf"),
        "robot.count": None, "robot.kind": "ñandú",
    }  # fmt: skip
    for entry in ("curve.a", "=3"):
        with pytest.raises(ValueError, match="--set must be given as name=value"):
            parse_overrides([[entry]])


@pytest.mark.parametrize(
    ("text", "value"),
    [("((0,1,inf),)", ((0, 1, math.inf),)), ("-inf", -math.inf), ("[inf, -inf]", [math.inf, -math.inf]), ("+3", 3),
     ("-(-(2))", 2), ("2 * 30", 60),
     ("{'a': inf}", {"a": math.inf}), ("'inf'", "inf"), ("infinite", "infinite"), ("True", True)],
)  # fmt: skip
def test_infinity_may_stand_inside_a_literal(text, value):
    assert parse_overrides([[f"curve.a={text}"]]) == {"curve.a": value}


@pytest.mark.parametrize(
    "text", ["nan", "-nan", "((0, nan),)", "1j", "b''", "f''", "{**{}}", "...", "{1}", "3 +", "__import__('os')"]
)
def test_what_is_no_literal_is_no_value(text):
    with pytest.raises(ValueError, match=r"--set curve\.a must be given"):
        parse_overrides([[f"curve.a={text}"]])
