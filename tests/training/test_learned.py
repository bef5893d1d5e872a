"""Learned policies: the interface of the classical ones, with the observation as the only input."""

import re
import subprocess
import sys

import numpy as np
import pytest
from test_network import make_network

import baselines
import lissajous_env
import training
from baselines.policies import registry
from baselines.policies.patrol import Sweep
from baselines.policies.patrol_path import SweepParameters
from lissajous_env import Simulation
from training.learned import checkpoint
from training.learned.card import Card
from training.learned.network import Network
from training.learned.policy import Learned
from training.learned.wiring import Wiring


def by_torch(network, rows):
    """Outputs of a network, clipped to [-1, 1]."""
    import torch

    rows = torch.from_numpy(rows)
    for weight, bias in zip(network.weights, network.biases, strict=True):
        linear = torch.nn.functional.linear(rows, torch.tensor(weight), torch.tensor(bias))
        rows = linear.relu()
    return linear.clamp(-1, 1).numpy()


def played(policy, simulation, steps):
    """Observations and actions (steps, W, N ...) of an episode."""
    observations, actions = [], []
    observation = simulation.observation
    for _ in range(steps):
        observations.append(observation.numpy().copy())
        actions.append(policy.act(observations[-1]))
        observation, *_ = simulation.step(actions[-1])
    return np.array(observations), np.array(actions)


def home(name):
    return checkpoint.read(training.learned.policy.find(name))[1].scenario


@pytest.mark.parametrize("name", training.names())
def test_shipped_policies_are_small_and_say_where_they_come_from(name):
    folder = training.learned.policy.find(name)
    assert sum(path.stat().st_size for path in folder.iterdir()) < 1_000_000
    _, card, text = checkpoint.read(folder)
    assert text["command"].startswith("lissajous train")
    assert card.settings["seed"] >= 0
    assert set(text["held_out_scores"]) == set(text["made_for"])


def test_a_base_carries_the_network():
    # Oracle: the base itself under a network of zeros, and a constant one by hand.
    base = baselines.make("sweep", "intruders", 2)
    card = Card.of(lissajous_env.scenario("intruders"), base="sweep", residual=0.25)

    def constant(*bias):
        return Network((np.zeros((2, 44)),), (np.array(bias),))

    policy = Learned(constant(0.0, 0.0), card, "intruders", 2)
    simulation = Simulation("intruders", 2)
    _, actions = played(policy, simulation, 20)
    _, expected = played(base, Simulation("intruders", 2), 20)
    assert (actions == expected).all()
    policy = Learned(constant(7.0, -0.4), card, "intruders", 2)
    base.reset()
    observation = simulation.observation.numpy().copy()
    wanted = np.clip(base.act(observation) + 0.25 * np.array([1.0, -0.4], np.float32), -1, 1)
    assert policy.act(observation) == pytest.approx(wanted, abs=1e-6)


def test_a_base_has_the_parameters_of_the_card(tmp_path):
    # Oracle: the base made with them by hand, under a network of zeros, after a checkpoint was written and read.
    scenario, parameters = lissajous_env.scenario("intruders"), SweepParameters(cruise=1.2, inset=0.4)
    given = {"cruise": 1.2, "inset": 0.4}
    network = Network((np.zeros((2, 44)),), (np.zeros(2),))
    checkpoint.save(tmp_path, network, Card.of(scenario, base="sweep", base_parameters=given))
    _, actions = played(training.load(tmp_path, num_worlds=2), Simulation(scenario, 2), 30)
    _, expected = played(Sweep(scenario, 2, "cpu", parameters), Simulation(scenario, 2), 30)
    _, default = played(baselines.make("sweep", scenario, 2), Simulation(scenario, 2), 30)
    assert (actions == expected).all()
    assert (actions != default).any()
    trained = Wiring(checkpoint.read(tmp_path)[1], scenario, 2)
    rows = trained.read(Simulation(scenario, 2).observation.numpy())
    assert (rows[:, :, -2:] == expected[0]).all()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"base": "sweep", "base_parameters": {"cruise": "fast"}}, "base_parameters must be numbers by name"),
        ({"base_parameters": {"cruise": 1.0}}, "base_parameters must be empty without a base"),
        ({"base": "sweep", "base_parameters": {"crise": 1.0}}, "got 'crise'; did you mean cruise?"),
        ({"base": "sweep", "base_parameters": {"cruise": -1.0}}, "cruise must be from 0.001"),
        ({"base": "still", "base_parameters": {"cruise": 1.0}}, "parameters must be empty for still"),
    ],
)
def test_wrong_parameters_of_a_base_are_refused(more, message):
    scenario = lissajous_env.scenario("intruders")
    with pytest.raises(ValueError, match=re.escape(message)):
        Card.of(scenario, **more).make_base(scenario, 1, "cpu")


def test_a_policy_is_played_as_it_was_trained_to_the_last_bit():
    # Oracle: what training makes of a network's outputs, and what playing does, over an episode of one network.
    scenario, bias = lissajous_env.scenario("intruders"), np.array([0.3141592, -0.2718281], np.float32)
    card = Card.of(scenario, ("x", "speed"), base="sweep", residual=0.3)
    policy = Learned(Network((np.zeros((2, 4)),), (bias,)), card, scenario, 3)
    wiring, simulation = Wiring(card, scenario, 3), Simulation(scenario, 3)
    for _ in range(40):
        observation = simulation.observation.numpy().copy()
        rows = wiring.read(observation)
        assert (rows[:, :, :2] == observation[:, :, [0, 4]]).all()
        action = wiring.actions(np.broadcast_to(bias, (3, 5, 2)))
        assert (action == policy.act(observation)).all()
        assert (np.abs(action - np.clip(rows[:, :, 2:] + 0.3 * bias, -1, 1)) < 1e-6).all()
        simulation.step(action)


def test_shipped_policies_are_played_like_the_classical_ones():
    assert "learned-intruders" in baselines.names("rough")
    assert "learned-intruders" not in baselines.names("failure")
    rows = lissajous_env.evaluate(baselines.make("learned-intruders", "rough", 2), "rough", seeds=range(2))
    assert [row["policy"] for row in rows] == ["learned-intruders"] * 2
    assert baselines.make("learned-intruders-safe", "rough").name == "learned-intruders-safe"
    assert baselines.policies.registry.made_for("learned-intruders", "intruders")
    assert not baselines.policies.registry.made_for("learned-intruders-safe", "experiment")


@pytest.mark.parametrize(
    ("name", "rival", "scenario", "share", "collisions"),
    [
        ("learned-intruders-proved", "kuramoto-mpcc", "intruders", 0.25, 0.0),
        ("portfolio", "kuramoto-mpcc", "rough-lost", 0.9, 0.0),
    ],
)
def test_shipped_policies_beat_the_papers_method(name, rival, scenario, share, collisions):
    # Oracle: the paper's method, on the same seeds.
    scores = []
    for each in (name, rival):
        rows = lissajous_env.evaluate(baselines.make(each, scenario, 16), scenario, range(100, 116))
        scores.append([np.mean([row[column] for row in rows]) for column in ("detection_time_mean", "collisions")])
    assert scores[0][0] < share * scores[1][0]
    assert scores[0][1] <= collisions


def test_a_policy_of_a_folder_is_for_the_scenario_it_was_trained_on(tmp_path):
    settings = {"overrides": {"sensing.targets_seen": 2}}
    card = Card.of(lissajous_env.scenario("intruders", **settings["overrides"]), settings=settings)
    checkpoint.save(tmp_path, make_network((36, 2)), card)
    policy = training.load(tmp_path)
    assert policy.scenario.sensing.targets_seen == 2
    with pytest.raises(ValueError, match="must drive robots of kind car"):
        training.load(tmp_path, "failure")


def test_the_commands_take_a_folder_for_a_name(tmp_path):
    from baselines.benchmark.running import plan
    from baselines.benchmark.types import Benchmark

    checkpoint.save(tmp_path, make_network((42, 2)), Card.of(lissajous_env.scenario("intruders")))
    assert isinstance(baselines.make(str(tmp_path), "rough"), Learned)
    cells = plan(Benchmark(("intruders",), (str(tmp_path), "still")))
    assert {cell.policy for cell in cells} == {str(tmp_path), "still"}
    assert isinstance(cells[-1].factory(cells[-1].scenario, 2, "cpu"), Learned)
    (tmp_path / "nothing").mkdir()
    with pytest.raises(ValueError, match=r"or a folder with checkpoint.json, got .*nothing"):
        baselines.make(str(tmp_path / "nothing"), "rough")


def test_a_folder_with_the_suffix_of_a_wrapper_is_its_policy_wrapped():
    # Oracle: the included policy of that folder, which has a wrapped one of its own.
    folder = training.learned.policy.find("learned-intruders")
    made = lissajous_env.scenario("rough", **{"task.duration": 5.0})
    ours, same = (
        lissajous_env.evaluate(baselines.make(name, made, 4), made, range(4))
        for name in (f"{folder}-safe", "learned-intruders-safe")
    )
    without_name = [[repr(row | {"policy": ""}) for row in rows] for rows in (ours, same)]  # NaN equals no NaN
    assert without_name[0] == without_name[1]
    assert ours[0]["policy"] == f"{folder}-safe"
    assert registry.home(f"{folder}-safe") == registry.home(str(folder))


@pytest.mark.parametrize("name", ["learned-nothing", "", "/nowhere/at/all"])
def test_an_unknown_name_is_refused_with_what_there_is(name):
    with pytest.raises(ValueError, match=r"policy must be one of learned-.*, or a folder with checkpoint.json"):
        training.load(name)


def test_no_torch_is_needed(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    policy = training.load("learned-intruders", num_worlds=3)
    assert policy.act(Simulation("rough", 3).observation.numpy()).shape == (3, 5, 2)


@pytest.mark.parametrize("base", ["learned-intruders", "learned-intruders-safe", "nothing", "folder"])
def test_a_base_that_is_no_classical_policy_is_refused(base, tmp_path):
    # A folder could be that of this very policy.
    card = Card.of(lissajous_env.scenario("intruders"), base="laps")
    if base == "folder":
        checkpoint.save(tmp_path, make_network((44, 2)), card)
        base = str(tmp_path)
    with pytest.raises(ValueError, match="base must be a registered"):
        Learned(make_network((44, 2)), Card.of(lissajous_env.scenario("intruders"), base=base), "intruders")
    assert Learned(make_network((44, 2)), Card.of(lissajous_env.scenario("intruders"), base="laps-safe"), "intruders")


def test_a_network_that_does_not_fit_its_card_is_refused():
    with pytest.raises(ValueError, match="network must map 42 inputs to 2 components of an action, got 41 to 2"):
        Learned(make_network((41, 2)), Card.of(lissajous_env.scenario("intruders")), "intruders")


def test_a_folder_is_opened_by_a_program_that_imports_baselines_alone():
    folder = training.learned.policy.find("learned-intruders")
    program = f"import baselines; print(baselines.make({str(folder)!r} + '-safe', 'rough').name)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"{folder}-safe"
