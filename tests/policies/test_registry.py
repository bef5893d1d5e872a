"""The registry of policies: no name is registered twice, and a broken plug-in does not affect others."""

import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import EntryPoint

import pytest

import baselines
import training
from baselines.planning import portfolio
from baselines.policies import registry
from baselines.policies.patrol import Laps, Still
from lissajous_env import plugins, scenario
from training.learned.policy import register_shipped


def test_a_name_may_be_registered_again_by_the_same_policy_alone():
    with pytest.raises(ValueError, match=r"name of a policy must be new, got 'still', which another one has"):
        baselines.register("still", None, Laps)
    assert type(baselines.make("still", "failure")) is Still
    before = baselines.names()
    baselines.register("still", None, Still)
    mine = partial(Still, parameters=None)
    for _ in range(2):
        baselines.register("mine", "car", mine)
    register_shipped()
    assert set(baselines.names()) == {*before, "mine", "mine-safe", "mine-proved"}
    with pytest.raises(ValueError, match="must be new, got 'mine'"):
        baselines.register("mine", "car", partial(Laps))
    with pytest.raises(ValueError, match="must drive robots of kind curve, got mine, which drives kind car"):
        registry.as_factory(mine, "mine")(scenario("failure"), 1, "cpu")  # as of `module:factory`


@pytest.mark.parametrize(("arguments", "words"), [
    (("", None, Still), "name of a policy must be a word, got ''"),
    ((None, None, Still), "name of a policy must be a word, got None"),
    (("mine", "boat", Still), "kind of mine must be one of car, differential, curve, velocity, or None, got 'boat'"),
    (("mine", None, "Still"), "factory of mine must be callable, got 'Still'"),
    (("mine", None, Still, "watch"), "made_for of mine must be a tuple of names of scenarios, got 'watch'"),
    (("mine-safe", None, Still), "name of a policy must not end in -safe, which adds a filter, got mine-safe"),
])  # fmt: skip
def test_what_is_no_policy_is_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        baselines.register(*arguments)


@pytest.mark.parametrize(("name", "scenario", "words"), [
    (3, "failure", "policy must be a name or a folder, got"),
    ("runs/none/best", "failure", "folder of a policy must exist, got 'runs/none/best'"),
    ("kuramoto-safe", "failure", "of kind car to be wrapped by -safe, got kuramoto-safe, which drives kind curve"),
    ("kuramoto-mpcc-safe", "failure", "of kind curve, got kuramoto-mpcc-safe, which drives kind car"),
    ("kuramoto", "rough", "policy for rough must drive robots of kind car, got kuramoto, which drives kind curve"),
    ("kuramoto-mpcc", "watch", "must drive robots of kind velocity, got kuramoto-mpcc, which drives kind car"),
    ("random-safe", "watch", "must drive robots of kind velocity, got random-safe"),
])  # fmt: skip
def test_what_cannot_be_made_is_refused(name, scenario, words):
    with pytest.raises(ValueError, match=words):
        baselines.make(name, scenario)


def adds_one():
    time.sleep(0.1)
    baselines.register("added", None, Still)
    assert "added" in baselines.names(), "what is loaded may ask for names itself"


def takes_a_name():
    baselines.register("still", None, Laps)


def test_entry_points_that_cannot_be_loaded_are_named_and_do_no_harm(monkeypatch):
    group = registry.POLICIES.group
    broken = EntryPoint("broken", "no_such_module:register", group)
    thief = EntryPoint("thief", f"{__name__}:takes_a_name", group)
    entries = [broken, thief, EntryPoint("good", f"{__name__}:adds_one", group)]
    monkeypatch.setattr(plugins, "entry_points", lambda group: entries)
    monkeypatch.setattr(registry.POLICIES, "broken", [])
    monkeypatch.setattr(registry.POLICIES, "_loaded", False)
    with pytest.warns(RuntimeWarning) as warned, ThreadPoolExecutor(2) as pool:  # both threads need all of them
        names, others = pool.map(lambda _: baselines.names(), range(2))
    of_broken, of_thief = sorted({str(warning.message) for warning in warned})
    words = "cannot be loaded: ModuleNotFoundError: No module named 'no_such_module'"
    assert of_broken == f"the entry point broken (no_such_module:register) {words}"
    assert "the entry point thief" in of_thief
    assert {"added", "kuramoto", "still"} <= set(names) == set(others)
    assert type(baselines.make("still", "failure")) is Still
    with pytest.raises(ValueError, match=r"got .from-the-broken-one.; the entry point broken .* cannot be"):
        baselines.make("from-the-broken-one", "failure")


def test_learned_policies_are_told_from_classical_ones():
    everything = {*training.names(), *portfolio.NAMES}
    learned = {name for name in baselines.names() if not registry.is_classical(name)}
    assert {name for name in learned if not registry.split_suffix(name)[1]} == everything
    assert {registry.split_suffix(name)[0] for name in learned} == everything
    assert not registry.is_classical("nothing")


def test_a_wrapped_policy_has_its_own_name_also_beside_a_folder_of_that_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("kuramoto-mpcc-safe", "kuramoto-mpcc-proved"):
        (tmp_path / name).mkdir()
        assert baselines.make(name, "experiment").name == name
    assert registry.describe("random-safe")["kind"] == "car", "a policy for all robots drives cars under a filter"
