"""ONNX: the exported graph computes the policy's actions."""

import importlib.util
import json
import sys

import numpy as np
import pytest
from test_network import make_network

import lissajous_env
import training
from lissajous_env import Simulation
from lissajous_env.world.observation import layout
from training.learned.card import Card
from training.learned.policy import Learned

needs_onnx = pytest.mark.skipif(
    not all(map(importlib.util.find_spec, ("onnx", "onnxruntime"))), reason="the extra onnx is not installed"
)


def session(path):
    import onnxruntime

    return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])


def test_without_the_extra_it_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ImportError, match=r"export_onnx requires the libraries of the extra onnx"):
        training.export_onnx("learned-intruders", tmp_path / "policy.onnx")
    assert not list(tmp_path.iterdir())


@needs_onnx
@pytest.mark.parametrize("name", ["learned-intruders"])
def test_a_shipped_policy_and_its_graph_do_the_same(tmp_path, name):
    # Oracle: the kernel that plays the policy, over rows of an episode, in onnxruntime.
    training.export_onnx(name, tmp_path / "policy.onnx")
    policy, graph = training.load(name, num_worlds=4), session(tmp_path / "policy.onnx")
    simulation, n = Simulation(policy.scenario, 4, seed=1), policy.scenario.num_robots
    size = policy.scenario.action_size
    for _ in range(30):
        observation = simulation.observation.numpy().copy()
        action = policy.act(observation)
        given = {"observation": observation.reshape(4 * n, -1)}
        if policy.base is not None:
            given["base_action"] = policy.base.action.numpy().reshape(4 * n, size)
        assert graph.run(["action"], given)[0] == pytest.approx(action.reshape(4 * n, size), abs=1e-5)
        simulation.step(action)
    about = graph.get_modelmeta().custom_metadata_map
    assert about["base"] == (policy.card.base or "none")
    assert tuple(json.loads(about["observation"])) == layout(policy.scenario).names


@needs_onnx
def test_a_network_that_reads_sets_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"policy must have a network that reads entries .* got learned-watch"):
        training.export_onnx("learned-watch", tmp_path / "policy.onnx")


@needs_onnx
@pytest.mark.parametrize("base", [None, "sweep"])
def test_large_outputs_are_limited_as_the_policy_limits_them(tmp_path, base):
    # Oracle: the policy itself, with outputs and a base that reach beyond the range; inputs out of order.
    scenario, names = lissajous_env.scenario("intruders"), ("speed", "x", "y")
    card = Card.of(scenario, names, base=base, residual=0.7 if base else 1.0)
    network = make_network((card.network_inputs, 8, 2))
    policy = Learned(network, card, scenario, 3)
    training.export_onnx(policy, tmp_path / "policy.onnx")
    observation = Simulation(scenario, 3, seed=5).observation.numpy().copy()
    action = policy.act(observation).reshape(15, 2)
    given = {"observation": observation.reshape(15, -1)}
    if policy.base is not None:
        given["base_action"] = policy.base.action.numpy().reshape(15, 2)
    assert session(tmp_path / "policy.onnx").run(None, given)[0] == pytest.approx(action, abs=1e-5)
    assert (np.abs(action) == 1).any()
