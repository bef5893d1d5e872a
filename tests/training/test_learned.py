"""Learned policies: the interface of the classical ones, with the observation as the only input."""

import subprocess
import sys

import numpy as np
import pytest
from test_network import make_team

import baselines
import lissajous_env
import training
from baselines.policies import registry
from lissajous_env import Simulation
from training.learned import checkpoint
from training.learned.card import Card
from training.learned.networks import TeamNetwork
from training.learned.policy import LearnedTeam


@pytest.mark.parametrize("name", training.names())
def test_shipped_policies_are_small_and_say_where_they_come_from(name):
    folder = training.learned.policy.find(name)
    assert sum(path.stat().st_size for path in folder.iterdir()) < 1_000_000
    _, card, text = checkpoint.read(folder)
    assert text["command"].startswith("lissajous train")
    assert card.settings["seed"] >= 0
    assert set(text["held_out_scores"]) == set(text["made_for"])


def test_shipped_policies_are_played_like_the_classical_ones():
    assert "learned-watch" in baselines.names("watch")
    assert "learned-watch" not in baselines.names("failure")
    scenario = lissajous_env.scenario("watch", **{"task.duration": 5.0})
    rows = lissajous_env.evaluate(baselines.make("learned-watch", scenario, 2), scenario, seeds=range(2))
    assert [row["policy"] for row in rows] == ["learned-watch"] * 2
    assert registry.is_default_on("learned-watch", "watch")
    assert not registry.is_default_on("learned-watch", "intercept")


@pytest.mark.parametrize("base", ["greedy-cover", "a-cmommt"])
def test_a_network_of_zeros_drives_as_its_base_does(base):
    # Oracle: the base itself, whose robots rest where it wishes less than a quarter of the top speed, for the rows of
    # two episodes, of which one world begins the second one early.
    scenario = lissajous_env.scenario("watch", **{"task.duration": 20.0})
    zeros = TeamNetwork({name: 0 * array for name, array in make_team().arrays.items()})
    learned, rule = LearnedTeam(zeros, Card.of(scenario, base=base), scenario, 2), baselines.make(base, scenario, 2)
    simulation, wish = Simulation(scenario, 2), rule.wish

    def resting(rows):
        velocity = wish(rows)
        return velocity * (np.linalg.norm(velocity, axis=-1, keepdims=True) >= 0.25)

    rule.wish = resting
    for step in range(24):
        rows = simulation.observation.numpy().copy()
        rows[:, 0, 0] *= 20 if step == 23 else 1  # far outside of the rectangle
        action = rule.act(rows)
        assert learned.act(rows) == pytest.approx(action, abs=1e-5)
        simulation.step(action)
        again = simulation.over | [step == 9, False]
        for part in (simulation, learned, rule):
            part.reset(again)


def test_the_shipped_policy_collides_less_than_its_base_and_sees_more_than_another_rule():
    # Oracle: the rule that it corrects, and greedy cover, on the same seeds.
    means = {}
    for name in ("learned-watch", "greedy-herd", "greedy-cover"):
        rows = lissajous_env.evaluate(baselines.make(name, "watch", 32), "watch", range(100, 132))
        means[name] = [np.mean([row[column] for row in rows]) for column in ("observed_fraction", "collisions")]
    assert means["learned-watch"][1] < 0.9 * means["greedy-herd"][1]
    assert means["learned-watch"][0] > 1.1 * means["greedy-cover"][0]


def test_a_policy_of_a_folder_is_for_the_scenario_it_was_trained_on(tmp_path):
    settings = {"overrides": {"sensing.targets_seen": 2}}
    card = Card.of(lissajous_env.scenario("intruders", **settings["overrides"]), settings=settings)
    checkpoint.save(tmp_path, make_team(), card)
    assert training.load(tmp_path).scenario.sensing.targets_seen == 2
    with pytest.raises(ValueError, match="must drive robots of kind car"):
        training.load(tmp_path, "failure")


def test_the_commands_take_a_folder_for_a_name(tmp_path):
    from baselines.benchmark.types import Benchmark, cells_of

    checkpoint.save(tmp_path, make_team(), Card.of(lissajous_env.scenario("intruders")))
    assert isinstance(baselines.make(str(tmp_path), "rough"), LearnedTeam)
    cells = cells_of(Benchmark(("intruders",), (str(tmp_path), "still")))
    assert [cell.policy for cell in cells] == [str(tmp_path), "still"]
    assert isinstance(cells[0].factory(cells[0].scenario, 2, "cpu"), LearnedTeam)
    (tmp_path / "nothing").mkdir()
    with pytest.raises(ValueError, match=r"must contain policy.toml or checkpoint.safetensors, got .*nothing$"):
        baselines.make(str(tmp_path / "nothing"), "rough")
    checkpoint.save(tmp_path / "nothing" / "best", make_team(), Card.of(lissajous_env.scenario("intruders")))
    with pytest.raises(ValueError, match=r"got .*nothing; did you mean .*/nothing/best\?"):
        baselines.make(str(tmp_path / "nothing"), "rough")


@pytest.mark.parametrize("name", ["learned-nothing", "", "/nowhere/at/all"])
def test_an_unknown_name_is_refused_with_what_there_is(name):
    with pytest.raises(ValueError, match=r"policy must be one of learned-.*, or a folder with checkpoint.safetensors"):
        training.load(name)


def test_no_torch_is_needed_and_a_missing_library_is_named_with_its_extra(monkeypatch):
    for name in ("torch", "stable_baselines3"):
        monkeypatch.setitem(sys.modules, name, None)
    policy = training.load("learned-watch", num_worlds=3)
    assert policy.act(Simulation("watch", 3).observation.numpy()).shape == (3, 5, 2)
    for name in [name for name in sys.modules if name.startswith(("training.sb3", "stable_baselines3."))]:
        monkeypatch.delitem(sys.modules, name)
    with pytest.raises(ImportError, match=r"training\.sb3 requires the libraries of the extra train "):
        __import__("training.sb3")


@pytest.mark.parametrize("base", ["learned-watch", "nothing", "folder"])
def test_a_base_that_is_no_classical_policy_is_refused(base, tmp_path):
    # A folder could be that of this very policy.
    if base == "folder":
        checkpoint.save(tmp_path, make_team(), Card.of(lissajous_env.scenario("watch")))
        base = str(tmp_path)
    with pytest.raises(ValueError, match="base must be a registered"):
        Card.of(lissajous_env.scenario("watch"), base=base)


def test_a_network_that_does_not_fit_its_card_is_refused():
    with pytest.raises(ValueError, match="network must have 2 outputs, got 3"):
        LearnedTeam(make_team(3), Card.of(lissajous_env.scenario("watch")), "watch")


def test_a_folder_is_opened_by_a_program_that_imports_baselines_alone():
    folder = training.learned.policy.find("learned-watch")
    program = f"import baselines; print(baselines.make({str(folder)!r}, 'watch').name)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(folder)
