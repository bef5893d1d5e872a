"""Invalid extensions, models and names: one clear line names the cause, and no unrequested module is imported."""

import dataclasses
import math
import os
import sys

import numpy as np
import pytest
import warp as wp
from command_line import called
from hypothesis import example, given, settings
from hypothesis import strategies as st
from test_network import make_team

import baselines
import lissajous_env
import training
from baselines.policies import registry
from baselines.policies.base import Policy
from lissajous_env.parameters import named, robot_models
from lissajous_env.world.robots.point import POINT
from training.learned import checkpoint
from training.learned.card import Card

MODULE = """
import sys
import lissajous_env
number = 3
@lissajous_env.reward_term(weight=-0.1)
def term(world): return world.robots.speed
scenario = lissajous_env.scenario("failure")
def same(): return scenario
def needs_more(x): return scenario
def nothing(): pass
def fails(): raise RuntimeError("boom\\nand more")
def leaves(): sys.exit(0)
@lissajous_env.reward_term()
def exits(world): sys.exit(7)
class Exits:
    def __init__(self, scenario, num_worlds, device): sys.exit(3)
def still(scenario, num_worlds, device):
    import baselines
    return baselines.make("still", scenario, num_worlds, device)
"""


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """A folder with a module, in which this process is; what is registered meanwhile is forgotten."""
    (tmp_path / "theirs.py").write_text(MODULE)
    (tmp_path / "broken.py").write_text("1 / 0\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(named, "register_ids", lambda name, **_: None)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    for name in ("theirs", "broken", "evil"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize(("place", "words"), [
    ("no_such_module:mine", "scenario must be module:attribute that can be loaded, got 'no_such_module:mine': Module"),
    ("broken:mine", r"ZeroDivisionError: division by zero \(broken.py, line 1\)"),
    ("theirs:gone", "has no attribute 'gone'"),
    (":mine", "a module and an attribute must stand around a colon"),
    ("theirs:number", "scenario theirs:number must be a Scenario, or a function .* that returns one, got 3"),
    ("theirs:nothing", "theirs:nothing must be a Scenario, .* got None"),
    ("theirs:needs_more", "theirs:needs_more must be .*, got TypeError: needs_more"),
    ("theirs:fails", r"theirs:fails must be .*, got RuntimeError: boom \(theirs.py, line 11\)"),
    ("theirs:leaves", "theirs:leaves must be .*, got SystemExit: 0"),
])  # fmt: skip
def test_a_module_without_a_scenario(place, words, capsys):
    with pytest.raises(ValueError, match=words):
        lissajous_env.scenario(place)
    code, _, error = called(capsys, "evaluate", place, "kuramoto")
    assert (code, len(error.splitlines())) == (2, 1), error


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["run", "ideal", "kuramoto", "--out", "a.npz", "--set", "extensions=theirs:exits"],
            "kuramoto failed on ideal: SystemExit: 7 (theirs.py, line 14)",
        ),
        (["evaluate", "ideal", "theirs:Exits", "--episodes", "1"], "theirs:Exits failed on ideal: SystemExit: 3"),
    ],
)
def test_an_exit_within_ends_a_command_with_words(capsys, arguments, words):
    # Oracle: the same, of a command that is called in this process.
    code, _, error = called(capsys, *arguments, "--quiet")
    assert code == 1
    assert words in error.splitlines()[-1]


def test_a_command_refuses_an_out_that_is_too_long(here, capsys):
    # Oracle: exit code 2, one line, nothing there.
    before = os.listdir(here)
    code, out, error = called(capsys, "evaluate", "ideal", "kuramoto", "--episodes", 1, "--out", f"{'x' * 300}.csv")
    assert (code, out, len(error.splitlines())) == (2, "", 1)
    assert "File name too long" in error
    assert os.listdir(here) == before


FILES = {
    "curve = 3": "curve must be a table, got int",
    "base = ['failure']": "base must be text, got list",
    "[cruve]\na = 3": "'cruve'; did you mean curve",
    "[curve]\na = 2": "curve.a must be an odd whole number from 1 to 1023, got 2",
    "[faults]\nschedule = [[99, 5.0, inf]]": "faults.schedule must name robots 0 to 4",
    "base = 'falure'": "scenario must be one of .* got 'falure'; did you mean failure",
    "base = 'watch-v1'": "must be one scenario .* got the space watch-v1; choose one of its scenarios, as watch-v1-0",
    "base = 'theirs:scenario'": "base must be the name of a scenario, not of a file or a module, got 'theirs:scenario'",
    "extensions = 'theirs:term'": "extensions must be a list, got str",
    "extensions = ['theirs:number']": "extension theirs:number must be made by reward_term",
    "extensions = [3]": "extensions must be objects or module:name, got 3",
    "extensions = [{weight = 1.0}]": "extensions must contain tables with a place, as module:name, got",
    "extensions = [{place = 'theirs:term', wight = 1.0}]": "must be of weight, got 'wight'; did you mean weight?",
    "extensions = [{place = 'theirs:term', name = 'x'}]": "settings of theirs:term must be of weight, got 'name'",
    "name = 'two words'": "name of a scenario must be a word",
    "'curve.a' = 3": "key must be one of name, description, base, extensions, curve, .* got 'curve.a'",
    "x = " + "[" * 5000: "must be a TOML file",
    "#" * 65537: "must be at most 65,536 bytes",
}


@pytest.mark.parametrize("text", FILES, ids=range(len(FILES)))
def test_a_file_that_holds_no_scenario(text, here):
    (here / "x.toml").write_text(text)
    with pytest.raises(ValueError, match=rf"(?s)x\.toml.*{FILES[text]}"):
        lissajous_env.scenario("x.toml")


def test_what_is_no_file(here, capsys):
    (here / "folder.toml").mkdir()
    os.mkfifo(here / "pipe.toml")
    (here / "bytes.toml").write_bytes(b"name = '\xff'")
    (here / "nowhere.toml").symlink_to("gone.toml")
    plain, read, missing = "must be a plain file, got a ", "must be a file that can be read: ", "is missing"
    refused = {
        "folder": f"{plain}folder", "pipe": f"{plain}folder or pipe", "\0": f"{plain}name with a null character",
        "bytes": "must be a TOML file that can be read: 'utf-8' codec", "nowhere": missing, "gone": missing,
        "no/such": missing, "a" * 999: f"{read}File name too long", "/proc/self/mem/x": f"{read}Not a directory",
    }  # fmt: skip
    for name, words in refused.items():
        with pytest.raises(ValueError, match=words) as error:
            lissajous_env.scenario(f"{name}.toml")
        assert str(error.value).partition("; did you mean")[0].count(".toml") == 1  # the file is named once
    for line in (["scenarios", "folder.toml"], ["evaluate", "gone.toml", "still"], ["policies", "pipe.toml"]):
        code, _, error = called(capsys, *line)
        assert (code, len(error.splitlines())) == (2, 1), error


values = st.recursive(
    st.sampled_from(["1", "-3", "2.5", "inf", "nan", "true", "'word'", "1979-05-27", "9" * 400, "1e999"]),
    lambda inside: st.lists(inside, max_size=3).map(lambda texts: f"[{', '.join(texts)}]"),
)
keys = st.sampled_from([
    "name", "base", "curve.a", "curve.half_width", "robot.kind", "robot.count", "formation.ring", "formation.displaced",
    "faults.schedule", "faults.removed", "targets.count", "targets.arrival_rate", "task.grid", "task.duration",
    "noise.message_delay", "sensing.radius", "robot", "other", "curve.other", "[curve]", "[[task]]",
])  # fmt: skip


@given(st.one_of(st.text(max_size=60), st.dictionaries(keys, values, max_size=4)))
@settings(max_examples=30, derandomize=True)
@example({"task.duration": "inf"})
def test_no_file_ends_in_anything_but_a_scenario_or_a_clear_error(tmp_path_factory, drawn):
    # Oracle: only these two endings, whatever the file contains.
    path = tmp_path_factory.getbasetemp() / "drawn.toml"
    lines = [key if key[0] == "[" else f"{key} = {drawn[key]}" for key in drawn] if type(drawn) is dict else [drawn]
    path.write_text("\n".join(lines), encoding="utf-8", errors="replace")
    try:
        outcome = lissajous_env.scenario(path)
    except ValueError as error:
        outcome = error
    assert isinstance(outcome, lissajous_env.Scenario) or "drawn.toml" in str(outcome)


def test_a_name_that_is_taken():
    mine = lissajous_env.register_scenario(lissajous_env.Scenario(name="mine"))
    assert lissajous_env.register_scenario(lissajous_env.scenario("knot")).name == "knot", "the same as ours"
    for name in ("mine", "knot"):
        other = lissajous_env.Scenario(name=name, description="another one")
        with pytest.raises(ValueError, match=f"name of a scenario must be new, got '{name}', which another one has"):
            lissajous_env.register_scenario(other)
    assert lissajous_env.scenario("mine") == mine


@pytest.mark.parametrize("name", ["", "two words", "a:b", "a/b", "../a", "mine.toml", "-a", "a\n", "x" * 100])
def test_what_is_no_name(name):
    with pytest.raises(ValueError, match="name of a scenario must be a word"):
        lissajous_env.register_scenario(lissajous_env.Scenario(name=name))


@pytest.mark.parametrize("name", [None, 3, [], b"knot", np.array(["knot", "knot"]), object()])
def test_what_names_no_scenario(name):
    with pytest.raises(ValueError, match=r"scenario must be one of .* got"):
        lissajous_env.scenario(name)


def test_what_a_file_names_is_looked_up_and_never_loaded(here):
    # Story: a checkpoint of a stranger names a module of the folder that one is in.
    (here / "evil.py").write_text("open('done', 'w')\n")
    folder = here / "policy"
    card = Card.of(lissajous_env.scenario("rough"))
    for name in ("evil:scenario", "evil.toml", "theirs:scenario"):
        fields = {**card.scenario_fields, "extensions": [{"place": name}]}
        checkpoint.save(folder, make_team(), dataclasses.replace(card, scenario=name, scenario_fields=fields))
        (here / "evil.toml").write_text("base = 'evil:scenario'")
        with pytest.raises(ValueError, match="no module is imported because a folder names it"):
            training.load(folder)
        with pytest.raises(ValueError, match="base must be the name of a scenario"):
            lissajous_env.scenario("evil.toml")
    assert not (here / "done").exists()
    assert {"evil", "theirs"} & set(sys.modules) == set()


def test_the_decorator_returns_what_it_is_given_and_refuses_what_is_taken():
    @baselines.register("mine")
    class Mine(Policy):
        """Cars that do nothing.

        And more.
        """

        kind = "car"

        def decide(self, observation):
            return np.zeros(self.action.shape)

    @baselines.register("made", kind="curve", made_for=("failure",))
    def make(scenario, num_worlds, device):
        """Points that do nothing."""
        return type("Points", (Mine,), {"kind": "curve"})(scenario, num_worlds, device)

    about = [registry.describe(name) for name in ("mine", "made")]
    assert [(policy["kind"], policy["made_for"]) for policy in about] == [("car", []), ("curve", ["failure"])]
    assert [policy["description"] for policy in about] == ["Cars that do nothing.", "Points that do nothing."]
    assert isinstance(baselines.make("made", "failure"), Mine)
    assert "mine-safe" in baselines.names("rough"), "the filter goes over it too"
    for name, rule in (("mine", "be new"), ("still", "be new"), ("mine-safe", "not end in -safe")):
        with pytest.raises(ValueError, match=f"name of a policy must {rule}.*, got '?{name}"):
            baselines.register(name, kind="car")(make)
    with pytest.raises(ValueError, match="factory of other must be callable, got 3"):
        baselines.register("other")(3)


class Returning(Policy):
    """Returns what it is told to."""

    def __init__(self, scenario, num_worlds=1, device="cpu", *, value=None):
        super().__init__(scenario, num_worlds, device)
        self.value = value

    def decide(self, observation):
        self.seen = observation
        return self.value


@pytest.mark.parametrize("arrays", ["numpy", "torch", "warp"])
def test_a_policy_gets_the_arrays_that_it_asks_for(arrays):
    # Oracle: the rows themselves; and whoever changes an observation in place changes nobody else's.
    torch = pytest.importorskip("torch") if arrays == "torch" else None
    kind = {"numpy": np.ndarray, "torch": torch and torch.Tensor, "warp": wp.array}[arrays]
    policy = type("Asking", (Returning,), {"arrays": arrays})("failure", 2, value=np.full((2, 5, 1), 0.25))
    simulation = lissajous_env.Simulation("failure", 2)
    rows = simulation.observation.numpy().copy()
    assert (policy.act(simulation.observation).numpy() == np.float32(0.25)).all()
    assert (type(policy.seen), policy.seen.shape) == (kind, rows.shape)
    np.testing.assert_array_equal(policy.seen if arrays == "numpy" else policy.seen.numpy(), rows)
    if arrays != "warp":
        policy.seen[...] = 7.0
        np.testing.assert_array_equal(simulation.observation.numpy(), rows)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"name": ""}, "name of a robot model must be of letters, digits, _ and -, got ''"),
        (
            {"table": ((math.nan,),)},
            "table of robot model mine must contain rows of 1 numbers from -1 to 1, got (nan,)",
        ),
        ({"rest": (0.0,)}, "rest of robot model mine must be a function of a Robot, got (0.0,)"),
        ({"rest": lambda robot: (0.0, 0.0)}, "rest of robot model mine must contain rows of 1 numbers"),
        ({"actions": ("a", "a"), "table": ((0.0, 0.0),)}, "robot model mine must have an action of at least one"),
        ({"table": ()}, "robot model mine must have a table of at least one row"),
        ({"move": print}, "robot model mine must move by a Warp kernel"),
        ({"name": "car"}, "name of a robot model must be new, got 'car'"),
    ],
)
def test_a_model_of_robots_that_cannot_be_one(changed, words):
    # Oracle: the message, and that the table of models is as before.
    before = dict(robot_models.MODELS)
    with pytest.raises(ValueError, match="robot model") as error:
        lissajous_env.register_robot_model(dataclasses.replace(POINT, **{"name": "mine"} | changed))
    assert words in str(error.value)
    assert before == robot_models.MODELS
