"""Defaults of a training, its terminal output, and its comparison with rivals."""

import io
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

pytest.importorskip("stable_baselines3")

from test_train import QUIET, SMALL

import lissajous_env
from tests.storage import killing
from training.display import Display
from training.learned import checkpoint
from training.learned.card import Card
from training.learned.history import History
from training.learned.network import Network
from training.sb3.trainer import train
from training.settings import TrainingSettings

CIRCLE = {"curve.harmonics": ((0.0, 0.7, 0.7, 0.0),), "robot.count": 3, "sensing.radius": 0.5, "formation.ring": None,
          "formation.p": None, "faults.schedule": ()}  # fmt: skip


@pytest.mark.parametrize(
    ("given", "base", "rivals", "imitated"),
    [
        ({"scenario": "intruders"}, "kuramoto-mpcc", ("kuramoto-mpcc",), None),
        ({"scenario": "perturbation"}, "kuramoto", ("kuramoto",), None),
        # Contouring control follows Lissajous curves alone.
        ({"scenario": "experiment", "overrides": CIRCLE}, "kuramoto-gvf", ("kuramoto-gvf",), None),
        ({"scenario": "experiment", "overrides": CIRCLE, "base": "none"}, None, ("kuramoto-gvf",), "arc-gvf"),
        ({"base": "none"}, None, ("kuramoto-mpcc",), "arc-mpcc"),
        ({"base": "laps"}, "laps", ("kuramoto-mpcc",), None),
        ({"start": "learned-intruders"}, "sweep-safe", ("kuramoto-mpcc",), None),
        ({"teacher": "sweep"}, None, ("kuramoto-mpcc",), "sweep"),
        ({"rivals": ("still",)}, "kuramoto-mpcc", ("still",), None),
    ],
)
def test_the_papers_method_is_the_base_and_the_rival(given, base, rivals, imitated):
    settings = TrainingSettings(**given)
    assert (settings.chosen_base, settings.chosen_rivals, settings.imitated) == (base, rivals, imitated)
    assert settings.to_dict()["base"] == (base or "none")
    assert settings.num_worlds == (512 if base is None else 128)


def test_parameters_of_the_base_are_given_or_those_of_the_start(tmp_path):
    given = ("cruise=1.9", "inset=0.05")
    settings = TrainingSettings(base="sweep", base_parameters=given)
    assert settings.chosen_base_parameters == {"cruise": 1.9, "inset": 0.05}
    card = Card.of(settings.make_scenario(), base="sweep", base_parameters=settings.chosen_base_parameters)
    checkpoint.save(tmp_path, Network((np.zeros((2, 44)),), (np.zeros(2),)), card)
    assert TrainingSettings(start=str(tmp_path)).chosen_base_parameters == settings.chosen_base_parameters
    assert TrainingSettings(start=str(tmp_path), base="sweep").chosen_base_parameters == {}
    # A training refuses to resume with other parameters, also where one has none.
    default, stored = TrainingSettings(base="sweep"), settings.to_dict()
    assert [each.split()[0] for each in default.differences(stored)] == ["base_parameters"]
    assert [each.split()[0] for each in settings.differences(default.to_dict())] == ["base_parameters"]
    assert settings.differences(stored) == []


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"base": "sweep", "base_parameters": ("cruise",)}, "base_parameters must be given as name=number"),
        ({"base": "sweep", "base_parameters": ("cruise=fast",)}, "got 'cruise=fast'"),
        ({"base": "sweep", "base_parameters": ("cruise=1", "cruise=2")}, "got 'cruise=2'"),
        ({"base": "sweep", "base_parameters": ("crise=1",)}, "did you mean cruise?"),
        ({"base": "none", "base_parameters": ("cruise=1",)}, "base_parameters must be left out without a base"),
    ],
)
def test_wrong_parameters_of_the_base_are_refused(given, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        TrainingSettings(**given)


def test_a_robot_of_ones_own_has_no_base(monkeypatch):
    import dataclasses

    from lissajous_env.parameters import robot_models
    from lissajous_env.world.robots.point import POINT

    monkeypatch.setitem(robot_models._MODELS, "hovering", dataclasses.replace(POINT, name="hovering"))
    settings = TrainingSettings("perturbation", overrides={"robot.kind": "hovering"})
    assert (settings.chosen_base, settings.chosen_rivals, settings.imitated) == (None, (), None)
    assert settings.reason_for_base == "there is none for robots of kind hovering"


def printed(settings):
    out = io.StringIO()
    history = train(settings, Console(file=out, width=200))
    return history, out.getvalue()


def test_the_terminal_says_what_was_chosen_how_far_it_is_and_how_it_ended(tmp_path):
    points = {"scenario": "failure", "overrides": {"task.duration": 3.0}, "steps": 2560, "evaluate_every": 1280}
    history, words = printed(TrainingSettings(**SMALL | points | {"base": None, "rivals": None, "out": tmp_path / "a"}))
    assert "base: kuramoto (the paper's method for robots of kind curve; --base none trains without)" in words
    assert "PPO from 0 steps" in words
    assert "(PPO, " in words
    assert "k steps/s" in words
    assert history.rivals.keys() == {"kuramoto"}
    _, words = printed(
        TrainingSettings(**SMALL | points | {"out": tmp_path / "b", "imitation_steps": 1920, "steps": 3200})
    )
    assert "base: none (given by --base)" in words
    assert words.index("imitation of kuramoto from 0 steps") < words.index("PPO from 1,920 steps")
    assert "left of this phase)" in words


def scores(detection, collisions):
    return {"detection_time": detection, "collisions": collisions, "return": 0.0, "detected_fraction": 1.0}


@pytest.mark.parametrize(
    ("ours", "theirs", "worse"),
    [
        (scores(4.0, 0.0), scores(5.0, 0.0), []),
        (scores(4.0, 0.015), scores(5.0, 0.0), []),
        (scores(9.41, 3.59), scores(4.96, 0.0), ["detection time 9.41 s, 4.5 s more (rival: 4.96 s)",
                                                 "collisions 3.59 per episode, 3.6 more"]),
        (scores(None, 0.0), scores(5.0, 0.0), ["detection time none (rival: 5 s)"]),
        (scores(4.0, 0.0), scores(None, 1.0), []),
    ],
)  # fmt: skip
def test_what_the_best_policy_loses_is_said(ours, theirs, worse):
    history = History(rivals={"rival": theirs})
    history.best = {"steps": 1000} | ours
    assert history.losses("rival") == worse
    out = io.StringIO()
    settings = TrainingSettings(base="none", rivals=())
    Display(settings, Console(file=out, width=200), history).conclude()
    words = out.getvalue()
    assert ("warning: it loses to rival: " + "; ".join(worse) in words) == bool(worse)
    assert ("more --steps, another --seed or a smaller --residual may help" in words) == bool(worse)


def test_the_writers_of_the_docs_receive_what_tensorboard_shows(tmp_path, monkeypatch):
    # Oracle: TensorBoard's own file. Weights & Biases and MLflow are stood in for by lists.
    text = (Path(__file__).parents[2] / "docs" / "train.md").read_text(encoding="utf-8")
    (body,) = [block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "import wandb" in block]
    told, ended = {"wandb": {}, "mlflow": {}}, []

    def keep(name):
        return lambda values, step: [told[name].setdefault((step, key), value) for key, value in values.items()]

    ends = {"finish": lambda: ended.append("wandb")}, {"end_run": lambda: ended.append("mlflow")}
    wandb = SimpleNamespace(init=lambda **_: None, log=keep("wandb"), **ends[0])
    mlflow = SimpleNamespace(log_params=lambda _: None, log_metrics=keep("mlflow"), **ends[1])
    monkeypatch.setitem(sys.modules, "wandb", wandb)
    monkeypatch.setitem(sys.modules, "mlflow", mlflow)
    names: dict = {"__name__": "my_run"}
    exec(compile(body, "train.md", "exec"), names)
    names["run"](**SMALL | {"out": tmp_path / "run", "teacher": "none", "steps": 2560})
    rows = killing.tensorboard_rows(tmp_path / "run" / "tensorboard")
    shown = {(step, name): value for name, points in rows.items() for step, value in points}
    assert {"rollout/ep_rew_mean", "train/approx_kl", "evaluation/detection_time"} <= {name for _, name in shown}
    for values in told.values():
        assert shown.keys() <= values.keys()
        assert all(values[key] == pytest.approx(value, rel=1e-5) for key, value in shown.items())
    assert sorted(ended) == ["mlflow", "wandb"]


@pytest.mark.parametrize("base", [None, "none"])
def test_a_training_learns_the_same_at_another_scale(tmp_path, base, monkeypatch):
    # Oracle: the training itself. Lengths times 2 and times times 4 move exponents alone.
    from test_train import weights_of

    from lissajous_env.parameters.registry import SCENARIOS

    scenario = lissajous_env.scenario("intruders", **{"task.duration": 6.0})
    learned = []
    for k, made in enumerate((scenario, scenario.scaled(2.0, 4.0))):
        monkeypatch.setitem(SCENARIOS, "scaled", made)
        settings = TrainingSettings(**SMALL | {
            "scenario": "scaled", "overrides": {}, "base": base, "imitation_steps": 640, "steps": 2560,
            "evaluate_every": 1280, "out": tmp_path / f"{k}",
        })  # fmt: skip
        train(settings, QUIET)
        learned.append(weights_of(settings.out))
    assert (learned[0] == learned[1]).all()
