"""The library's PPO as the trainer uses it, and the environments that it learns in."""

import io

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from rich.console import Console

import lissajous_env
from lissajous_env.storage.folder import Folder
from training.learned.policy import Learned
from training.sb3 import RobotVecEnv
from training.sb3.ppo import RobotPPO
from training.sb3.trainer import Trainer, train
from training.settings import TrainingSettings

pytestmark = pytest.mark.usefixtures("one_thread")
SHORT = {"task.duration": 2.0, "task.grid": None}


def test_collisions_cost_more_while_learning_and_nowhere_else(tmp_path):
    # Oracle: the scenario's own reward, which evaluations keep.
    settings = TrainingSettings("intruders", caution=2.5, overrides={"task.reward_collision": -4.0})
    assert settings.make_cautious_scenario().task.reward_collision == -10.0
    assert settings.make_scenario().task.reward_collision == -4.0
    settings = TrainingSettings("failure", worlds=2, caution=2.5, threads=1, rivals=(), out=tmp_path / "run")
    with Folder(tmp_path / "run") as folder:
        trainer = Trainer(settings, Console(quiet=True), folder)
    learned_in, evaluated_in = trainer.env.scenario, trainer.scenario
    assert learned_in.task.reward_collision == 2.5 * evaluated_in.task.reward_collision


def test_noise_falls_as_the_settings_say(tmp_path, monkeypatch):
    # Oracle: the line from the first to the last, from the end of imitation on; where it would rise it stays.
    seen = []
    learn = RobotPPO.learn_once

    def recorded(model, *args):
        seen.append(model.policy.log_std.detach().mean().item())
        return learn(model, *args)

    monkeypatch.setattr(RobotPPO, "learn_once", recorded)
    small = {"worlds": 4, "rollout": 8, "batch_size": 160, "layers": (4,), "threads": 1, "rivals": (), "epochs": 1,
             "evaluation_episodes": 1, "steps": 800, "imitation_steps": 160, "log_std": -1.0,
             "base": "none"}  # fmt: skip
    quiet = Console(quiet=True)
    train(TrainingSettings("failure", log_std_end=-2.0, out=tmp_path / "falls", **small), quiet)
    assert seen == pytest.approx([-1.0, -1.25, -1.5, -1.75])
    seen.clear()
    train(TrainingSettings("failure", log_std_end=0.0, out=tmp_path / "stays", **small), quiet)
    assert seen == pytest.approx([-1.0] * 4)
    seen.clear()
    train(TrainingSettings("failure", log_std_end=None, out=tmp_path / "learned", **small), quiet)
    assert len(set(seen)) == 4


def test_a_policy_that_was_better_untrained_is_not_said_to_have_become_so(tmp_path, monkeypatch):
    # Story: the base is better than another rival before any training; training then improves it by a tenth.
    out = io.StringIO()
    settings = TrainingSettings(
        "intruders", worlds=4, rollout=8, batch_size=160, layers=(4,), base="sweep", base_parameters=("cruise=1.9",),
        threads=1, epochs=1, evaluation_episodes=1, evaluate_every=160, steps=320, out=tmp_path / "run",
        overrides={"task.duration": 1.0},
    )  # fmt: skip
    played, points = [], iter([2.0, 1.9, 1.8])

    def evaluated(trainer, make):
        policy = make(trainer.scenario, 1)
        played.append(policy)
        time = next(points) if isinstance(policy, Learned) else 2.0 if policy.name == "sweep" else 6.0
        return {"detection_time": time, "collisions": 0.0, "return": -time, "detected_fraction": 0.5}

    monkeypatch.setattr(Trainer, "_evaluated", evaluated)
    monkeypatch.setattr("training.sb3.trainer.best_policies", lambda *given: ("laps",))
    history = train(settings, Console(file=out, width=200))
    assert list(history.rivals) == ["kuramoto-mpcc", "laps", "sweep(cruise=1.9)"]
    (base,) = [policy for policy in played if policy.name == "sweep"]
    assert base.parameters.cruise == pytest.approx(1.9)
    words = out.getvalue()
    assert "sweep(cruise=1.9) (the base): detection 2.00 s" in words
    for rival in ("kuramoto-mpcc", "laps"):
        assert f"the untrained policy is better than {rival} already" in words
        assert f"better than {rival} after" not in words
    assert "better than sweep(cruise=1.9) after" in words
    assert "(10.0% faster than the base sweep(cruise=1.9))" in words.splitlines()[-1]


def test_staggered_worlds_are_at_all_moments_of_an_episode():
    # Story: 20 worlds of 20 steps begin together; after the first episodes each moment of an episode has its world.
    env = RobotVecEnv(lissajous_env.scenario("intruders", **SHORT), 20, staggered=True, seed=0)
    env.reset()
    for _ in range(20):
        env.step(np.zeros((100, 2)))
    moments = env.simulation.clock.step.numpy()
    assert len(set(moments)) >= 16
    # So are the first half of the worlds, which a teacher may drive; and later episodes have their whole time.
    assert len(set(moments[:10] // 4)) == 5
    ended = np.zeros(20)
    for _ in range(40):
        ended += env.step(np.zeros((100, 2)))[2].reshape(20, 5).all(axis=1)
    assert (ended == 2).all()
