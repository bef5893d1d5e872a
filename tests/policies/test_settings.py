"""Policies in folders: a name with parameters, played as the policy that these make, and nothing else is accepted."""

import re

import numpy as np
import pytest
from command_line import called

import baselines
import lissajous_env
from baselines.policies.base import Filtered
from baselines.policies.coordinators import ArcParameters, KuramotoByArc
from baselines.policies.loops import SweepParameters
from baselines.policies.patrol import Sweep
from baselines.policies.safety.safe import Safe
from baselines.policies.settings import POLICY_FILE, SCENARIO_FILE, PolicySettings
from baselines.policies.trackers import FieldParameters, WithMpcc
from lissajous_env.parameters.scenario_file import as_toml

SHORT = lissajous_env.scenario("evaders", **{"task.duration": 2.0})


def folder_of(path, settings, scenario=SHORT):
    path.mkdir()
    (path / POLICY_FILE).write_text(settings.as_toml())
    (path / SCENARIO_FILE).write_text(as_toml(scenario))
    return str(path)


def arc(scenario, num_worlds, device):
    def coordinator(*args):
        return KuramotoByArc(*args, parameters=ArcParameters(speed=1.1))

    return WithMpcc(coordinator, scenario, num_worlds, device)


@pytest.mark.parametrize(("settings", "factory"), [
    (PolicySettings("sweep", {"lanes": 4, "cruise": 1.5}),
     lambda *args: Sweep(*args, SweepParameters(lanes=4, cruise=1.5))),
    (PolicySettings("arc-mpcc", {}, {"speed": 1.1}), arc),
    (PolicySettings("arc-mpcc-safe", {}, {"speed": 1.1}), lambda *args: Filtered(arc(*args), Safe)),
    (PolicySettings("kuramoto-mpcc"), lambda *args: baselines.make("kuramoto-mpcc", *args)),
])  # fmt: skip
def test_a_folder_is_the_policy_with_its_parameters(settings, factory, tmp_path):
    """Oracle: the policy made by its class in Python, bit for bit."""
    folder = folder_of(tmp_path / "mine", settings)
    rows = lissajous_env.evaluate(baselines.make(folder, SHORT, 2), SHORT, range(2))
    wanted = lissajous_env.evaluate(factory(SHORT, 2, "cpu"), SHORT, range(2))
    for row, other in zip(rows, wanted, strict=True):
        np.testing.assert_equal(row, {**other, "policy": folder})


def test_what_is_not_given_is_scaled_to_the_scenario():
    large = SHORT.scaled(2.0, 3.0)
    policy = PolicySettings("consensus-gvf", {"slowest": 0.5}).make(large)
    assert policy._field.slowest == pytest.approx(0.5)
    assert policy._field.turn == pytest.approx(FieldParameters.of(large).turn)
    assert policy._field.turn < FieldParameters.turn


def test_a_parameter_of_a_registered_partial_keeps_the_others():
    # Story: running-reference fixes two parameters of its coordinator; one is changed, the other stays.
    policy = PolicySettings("running-reference-mpcc", {}, {"catch_up": 1.2}).make(SHORT)
    assert (policy.coordinator.parameters.runs_on, policy.coordinator.parameters.catch_up) == (True, 1.2)


def test_a_folder_accepts_the_suffix_of_a_filter(tmp_path):
    folder = folder_of(tmp_path / "mine", PolicySettings("sweep"))
    policy = baselines.make(f"{folder}-safe", SHORT)
    assert isinstance(policy, Filtered)
    assert (policy.name, type(policy.filter), type(policy.policy)) == (f"{folder}-safe", Safe, Sweep)


def test_commands_play_a_folder(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder_of(tmp_path / "mine", PolicySettings("sweep", {"lanes": 4}))
    for line in (
        "run mine/scenario.toml mine-safe --out b.npz", "replay mine --out c.html --set task.duration=1",
        "benchmark --scenarios mine/scenario.toml --policies mine sweep --episodes 1 --replays 0 --out results",
    ):  # fmt: skip
        code, _, said = called(capsys, *line.split())
        assert code == 0, (line, said)
    (tmp_path / "mine" / POLICY_FILE).write_text(PolicySettings("sweep", {"lanes": 2}).as_toml())
    code, _, said = called(capsys, *line.split())
    assert code == 2, "results of other parameters are not mixed"
    assert "policy of policy.toml" in said


@pytest.mark.parametrize(("text", "message"), [
    ("policy = 'swep'", "policy must be one of"), ("policy = 3", "policy must be text, got int"),
    ("policy = ", "must be a TOML file that can be read"), ("", "file must contain policy, the name of a policy"),
    ("policy = 'sweep'\nlanes = 4", "must be one of policy, parameters, coordinator, got 'lanes'"),
    ("policy = 'sweep'\n[parameters]\nlane = 4", "got 'lane'; did you mean lanes?"), ("policy = '.'", "not a folder"),
    ("policy = 'sweep'\n[coordinator]\nlanes = 4", "coordinator must be empty for sweep"),
])  # fmt: skip
def test_a_wrong_file_is_refused_by_name(text, message, tmp_path):
    folder = folder_of(tmp_path / "mine", PolicySettings("still"))
    (tmp_path / "mine" / POLICY_FILE).write_text(text)
    with pytest.raises(ValueError, match=re.escape(message)) as refused:
        baselines.make(folder, SHORT)
    assert str(tmp_path / "mine" / POLICY_FILE) in str(refused.value)
