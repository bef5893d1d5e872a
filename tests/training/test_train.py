"""Training: it learns, writes its files, and resumes bit-identically after a kill."""

import dataclasses
import functools
import hashlib
import json
import os
import signal

import numpy as np
import pytest
from rich.console import Console
from safetensors.numpy import save as to_safetensors

pytest.importorskip("stable_baselines3")


import training
from lissajous_env import Simulation
from lissajous_env.storage.folder import LIST, Folder
from training.learned import checkpoint
from training.sb3.trainer import Trainer, train
from training.settings import TrainingSettings

QUIET = Console(quiet=True)
SMALL = {
    "scenario": "experiment",
    "worlds": 8,
    "rollout": 16,
    "batch_size": 320,
    "steps": 6400,
    "evaluate_every": 1280,
    "evaluation_episodes": 2,
    "layers": (8,),
    "threads": 1,
    "base": "none",
    "rivals": (),
    "imitation_steps": 1920,
    "overrides": {"task.duration": 6.0},
}


def small(tmp_path, **changes):
    return TrainingSettings(**SMALL | {"out": tmp_path / "run"} | changes)


def weights_of(folder):
    network, *_ = checkpoint.read(folder)
    return np.concatenate([array.ravel() for array in (*network.weights, *network.biases)])


def test_ppo_learns_a_two_line_problem(tmp_path):
    # One robot on the curve, no target: the reward is minus the square of its action. The best is not to move.
    alone = {"robot.count": 1, "targets.count": 0, "targets.arrival_rate": 0.0, "faults.schedule": ()}
    effort = {"task.reward_effort": -1.0, "task.duration": 2.0}
    settings = TrainingSettings(
        "failure", steps=60_000, worlds=64, rollout=20, batch_size=320, layers=(8,), base="none", teacher="none",
        log_std=-0.5, learning_rate=1e-2, gamma=0.0, threads=1, rivals=(), evaluation_episodes=2, evaluate_every=60_000,
        out=tmp_path / "run", overrides=alone | effort,
    )  # fmt: skip
    first = dataclasses.replace(settings, steps=1280, out=tmp_path / "first", overrides=alone | effort)
    before, after = train(first, QUIET).curve[-1], train(settings, QUIET).curve[-1]
    assert after["return"] > -0.01
    policy = training.load(tmp_path / "run", num_worlds=4)
    seen = Simulation(policy.scenario, 4, seed=9).observation.numpy()
    assert np.abs(policy.act(seen)).max() < 0.05
    assert before["steps"] == 1280


def test_imitation_comes_close_to_its_teacher(tmp_path):
    # Oracle: the teacher's own action.
    settings = small(
        tmp_path, scenario="failure", teacher="kuramoto", steps=100_000, imitation_steps=100_000, worlds=64,
        layers=(32,), learning_rate=3e-3, evaluate_every=50_000,
        overrides={"task.duration": 6.0, "formation.start_noise": 0.3},
    )  # fmt: skip
    train(settings, QUIET)
    import baselines

    scenario = settings.make_scenario()
    student, teacher = training.load(settings.out, scenario, 16), baselines.make("kuramoto", scenario, 16)
    seen = Simulation(scenario, 16, seed=99).observation.numpy()
    wanted = teacher.act(seen)
    assert np.abs(student.act(seen) - wanted).mean() < 0.2 * np.abs(wanted - wanted.mean()).mean()


def trained(changes, out):
    train(TrainingSettings(**SMALL | changes | {"out": out}), QUIET)


@pytest.mark.parametrize(
    ("changes", "share", "steps"),
    [
        ({"noise_steps": 5, "averaging": 0.5, "critic_steps": 1280}, 0.6, (2560, 3840, 5120)),
        ({"base": "kuramoto-mpcc"}, 0.15, (0,)),
    ],
)
def test_a_killed_training_ends_with_the_same_weights(tmp_path, changes, share, steps):
    # Oracle: the run that nobody killed, on one thread. Killed in the reinforcement learning, and after the
    # evaluation of the untrained policy.
    from tests.storage import killing

    work = functools.partial(trained, changes)
    writes = killing.run(work, tmp_path / "whole").writes
    assert killing.run(work, tmp_path / "cut", round(share * writes)).killed
    assert checkpoint.read_text(tmp_path / "cut")["counters"]["steps"] in steps
    assert killing.run(work, tmp_path / "cut").error == ""
    whole, cut = (killing.result_of_train(tmp_path / name) for name in ("whole", "cut"))
    for name, value in whole.items():
        assert cut[name] == value, name


def test_a_state_that_does_not_fit_is_refused_by_its_file(tmp_path):
    from tests.storage import killing

    killing.train(tmp_path)
    text = checkpoint.read_text(tmp_path)
    whole = checkpoint.read_state(tmp_path, text)
    text["counters"]["steps"] = 160
    for name, array in (("rows", None), ("random", np.arange(3)), ("scores", np.ones((2, 2)))):
        arrays = {key: value for key, value in whole.items() if key != name} | ({} if array is None else {name: array})
        data = to_safetensors(arrays)
        digest = hashlib.sha256(data).hexdigest()
        entry = {"name": f"state-{digest[:12]}.safetensors", "sha256": digest}
        (tmp_path / entry["name"]).write_bytes(data)
        with open(tmp_path / LIST, "a") as file:
            file.write(json.dumps({"wrote": entry["name"]}) + "\n")
        (tmp_path / checkpoint.FILE).write_text(json.dumps(text | {"files": text["files"] | {"state": entry}}))
        with pytest.raises(ValueError, match=rf"{entry['name']} must be the state of this training"):
            killing.train(tmp_path)


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_keeps_what_was_learned(tmp_path, monkeypatch):
    # Pressed in the third rollout, far from any evaluation.
    seen, observe = [], Trainer.observe_update

    def pressed(trainer):
        seen.append(trainer.history.steps)
        if len(seen) == 3:
            os.kill(os.getpid(), signal.SIGINT)
        observe(trainer)

    monkeypatch.setattr(Trainer, "observe_update", pressed)
    with pytest.raises(KeyboardInterrupt, match=r"1,920 steps are saved in .*; the same command resumes there"):
        train(small(tmp_path, steps=10**9, evaluate_every=10**9, teacher="none"), QUIET)
    assert seen == [640, 1280, 1920]
    assert checkpoint.read_text(tmp_path / "run")["counters"]["steps"] == 1920


def test_a_training_resumes_if_only_the_words_about_its_scenario_changed(tmp_path):
    lab = tmp_path / "lab.toml"

    def trained(words, duration, steps):
        lab.write_text(f'description = "{words}"\nbase = "failure"\n[task]\nduration = {duration}\n')
        return train(small(tmp_path, steps=steps, scenario=str(lab), overrides={}, teacher="none", layers=()), QUIET)

    done = trained("A hall.", 2.0, 1280).steps
    assert trained("A hall with five robots.", 2.0, 2560).steps > done
    with pytest.raises(ValueError, match="task of the scenario"):
        trained("A hall with five robots.", 3.0, 3840)


def test_a_finished_training_is_left_alone_and_more_steps_extend_it(tmp_path):
    settings = small(tmp_path, steps=1280, teacher="none")
    train(settings, QUIET)
    kept = weights_of(settings.out)
    written = (settings.out / checkpoint.FILE).stat().st_mtime_ns
    train(settings, QUIET)
    assert (settings.out / checkpoint.FILE).stat().st_mtime_ns == written
    history = train(dataclasses.replace(settings, steps=2560), QUIET)
    assert history.steps == 2560
    assert not (weights_of(settings.out) == kept).all()


@pytest.mark.parametrize("phase", [{"teacher": "none"}, {"imitation_steps": 6400}], ids=["ppo", "imitation"])
@pytest.mark.parametrize("rate", [1e15, 1e30])
def test_a_training_that_diverges_ends_in_one_line(tmp_path, phase, rate):
    # Oracle: the checkpoint of the steps before, byte for byte.
    train(small(tmp_path, **phase, steps=1280), QUIET)
    paths = [path for path in (tmp_path / "run").rglob("[!.]*.*") if "tensorboard" not in path.parts]
    before = {path: path.read_bytes() for path in paths}
    settings = small(tmp_path, **phase, steps=6400)
    words = "learning_rate must be low enough that weights and actions stay"
    with checkpoint.hold(settings.out) as folder:
        trainer = Trainer(settings, QUIET, folder)
        trainer.settings = dataclasses.replace(settings, evaluate_every=100_000)
        trainer.model._rate_of = lambda remaining: rate
        trainer.model.lr_schedule = trainer.model._rate_of
        with pytest.raises(ValueError, match=words) as refused:
            trainer.run()
    assert f"got {settings.learning_rate:g}: after " in str(refused.value)
    assert "\n" not in str(refused.value)
    assert {path: path.read_bytes() for path in before} == before


def test_other_settings_are_refused_by_name(tmp_path):
    settings = small(tmp_path, steps=1280, teacher="none")
    train(settings, QUIET)
    with pytest.raises(ValueError, match=r"gamma = 0.99 there, 0.5 here"):
        train(dataclasses.replace(settings, gamma=0.5), QUIET)
    with pytest.raises(ValueError, match=r"overrides = .* there"):
        train(dataclasses.replace(settings, overrides={"task.duration": 5.0}), QUIET)


def test_a_training_starts_from_another(tmp_path):
    settings = small(tmp_path, steps=1280, teacher="none")
    train(settings, QUIET)
    after = dataclasses.replace(settings, out=tmp_path / "next", start=str(settings.out), learning_rate=1e-9)
    train(after, QUIET)
    assert weights_of(after.out) == pytest.approx(weights_of(settings.out), abs=1e-5)
    with pytest.raises(ValueError, match=r"start must have the same layers \(\(4,\)\)"):
        train(dataclasses.replace(after, out=tmp_path / "other", layers=(4,)), QUIET)


def test_the_critic_may_learn_alone_first(tmp_path):
    # Oracle: the weights that a training begins with.
    settings = small(tmp_path, steps=2560, teacher="none", critic_steps=1280)
    with Folder(tmp_path / "fresh") as folder:
        fresh = Trainer(settings, QUIET, folder).network().to_arrays()
    train(dataclasses.replace(settings, steps=1280, critic_steps=1280), QUIET)
    kept = checkpoint.read(settings.out)[0].to_arrays()
    assert all((kept[name] == array).all() for name, array in fresh.items())
    train(settings, QUIET)
    assert not (weights_of(settings.out) == np.concatenate([array.ravel() for array in fresh.values()])).all()


def test_the_result_may_be_an_average(tmp_path, monkeypatch):
    # Oracle: the weights after each update, averaged by hand.
    seen = []
    average_in = Trainer.average_in

    def recorded(trainer):
        seen.append(trainer.model.network().to_arrays())
        average_in(trainer)

    monkeypatch.setattr(Trainer, "average_in", recorded)
    settings = small(tmp_path, teacher="none", steps=2560, averaging=0.5)
    train(settings, QUIET)
    assert len(seen) == 4
    for name, array in checkpoint.read(settings.out)[0].to_arrays().items():
        first, second, third, last = (each[name] for each in seen)
        assert array == pytest.approx(first / 8 + second / 8 + third / 4 + last / 2, abs=1e-6)


def test_what_a_training_leaves(tmp_path):
    settings = small(tmp_path, rivals=("sweep",))
    history = train(settings, QUIET)
    assert [point["steps"] for point in history.curve] == [0, 1280, 2560, 3840, 5120, 6400]
    assert history.rivals["sweep"]["detection_time"] is not None
    assert {path.name.partition("-")[0] for path in settings.out.iterdir()} == {
        "checkpoint.json", "weights", "state", "best", "report.html", "tensorboard", LIST,
    }  # fmt: skip
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(settings.out / "tensorboard"))
    events.Reload()
    tags = set(events.Tags()["scalars"])
    assert {"rollout/collisions", "evaluation/detection_time", "train/approx_kl", "imitation/error"} <= tags
    assert events.Scalars("train/approx_kl")[-1].step == 6400
    rows = training.load(settings.out / "best", num_worlds=2).act(
        Simulation(settings.make_scenario(), 2).observation.numpy()
    )
    assert np.isfinite(rows).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"steps": 0}, "steps must be a whole number from 1 to .*, got 0"),
        ({"learning_rate": -1.0}, "learning_rate must be from .*, got -1.0"),
        ({"layers": (8, 0)}, r"layers must be whole numbers from 1 to 65,536, got \(8, 0\)"),
        ({"scenario": "intruder"}, "scenario must be one of .*did you mean intruders"),
        ({"base": "swep"}, "did you mean sweep"),
        ({"base": "kuramoto"}, "must drive robots of kind car"),
        ({"base": "sweep", "teacher": "sweep"}, "teacher must be none if there is a base, got 'sweep'"),
        ({"inputs": ("speeed",)}, "lacks speeed"),
        ({"overrides": {"task.stepp": 1}}, "did you mean task.step"),
    ],
)
def test_bad_settings_are_refused_with_name_rule_and_value(tmp_path, changes, words):
    with pytest.raises(ValueError, match=words):
        train(small(tmp_path, **changes), QUIET)


def test_two_trainings_do_not_share_a_folder(tmp_path):
    settings = small(tmp_path, steps=1280)
    with Folder(settings.out), pytest.raises(ValueError, match="in use by another process"):
        train(settings, QUIET)
