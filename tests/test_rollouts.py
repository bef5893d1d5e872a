"""The fast loop of PPO against Stable-Baselines3's own, and the worlds that it learns in."""

import io

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

import torch
from rich.console import Console
from stable_baselines3 import PPO

import lissajous_env
from lissajous_env.storage.folder import Folder
from training.learned.card import Card
from training.learned.policy import Learned
from training.sb3 import RobotVecEnv
from training.sb3.critic import CentralCriticPolicy
from training.sb3.rollouts import RobotPPO
from training.sb3.trainer import Sb3Trainer, _Watch, train
from training.settings import TrainingSettings
from training.trainer import Trainer

SHORT = {"task.duration": 2.0, "task.grid": None}


def make_env(central=False, **more):
    # Episodes of 7 and of 20 steps: time limits fall into every rollout of 16.
    scenario = lissajous_env.scenario("intruders", **SHORT)
    return RobotVecEnv(scenario, 8, short=0.5, short_time=0.7, central=central, **more)


def weights(kind, activation, central=False, layers=(16, 8), **settings):
    env = make_env(central)
    inputs = Card.of(env.scenario).network_inputs
    policy, own = (CentralCriticPolicy, {"actor_inputs": inputs}) if central else ("MlpPolicy", {})
    model = kind(
        policy, env, n_steps=16, batch_size=160, n_epochs=2, seed=3, device="cpu",
        policy_kwargs={"net_arch": list(layers), "activation_fn": activation, **own}, **settings,
    )  # fmt: skip
    model.learn(3 * 16 * env.num_envs)
    return np.concatenate([parameter.detach().numpy().ravel() for parameter in model.policy.parameters()])


@pytest.fixture(autouse=True)
def on_one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.mark.parametrize(
    "settings",
    [
        {"activation": torch.nn.ReLU},
        {"activation": torch.nn.Tanh, "ent_coef": 0.01, "vf_coef": 0.3},
        {"activation": torch.nn.ReLU, "use_sde": True, "sde_sample_freq": 5},
        {"activation": torch.nn.Tanh, "central": True},
        {"activation": torch.nn.ReLU, "central": True, "layers": [], "use_sde": True},
    ],
    ids=["relu", "tanh, entropy", "gSDE", "central critic", "no hidden layer"],
)
def test_the_loop_learns_what_the_library_does(settings, monkeypatch):
    # Oracle: PPO itself on the same rows with the same draws. Sums are taken in another order, hence the tolerance.
    monkeypatch.setattr("training.sb3.blocks.BLOCK", 64)
    ours, theirs = weights(RobotPPO, **settings), weights(PPO, **settings)
    assert np.abs(ours - theirs).max() < 1e-6
    assert np.abs(theirs).max() > 0.1


def test_what_is_learned_does_not_depend_on_the_threads(monkeypatch):
    # Oracle: one thread, bit for bit; blocks of 40 rows make four tasks of a minibatch.
    monkeypatch.setattr("training.sb3.blocks.BLOCK", 40)
    alone = weights(RobotPPO, torch.nn.ReLU, threads=1)
    assert (weights(RobotPPO, torch.nn.ReLU, threads=3) == alone).all()


def test_a_critic_alone_learns_where_the_actor_is_held():
    env = make_env()
    model = RobotPPO("MlpPolicy", env, n_steps=8, batch_size=320, n_epochs=1, seed=0, device="cpu")
    held = {name: p.detach().clone() for name, p in model.policy.named_parameters() if "value" not in name}
    for name, parameter in model.policy.named_parameters():
        parameter.requires_grad_("value" in name)
    before = model.policy.value_net.weight.detach().clone()
    model.learn(8 * env.num_envs)
    assert not torch.equal(model.policy.value_net.weight, before)
    assert all(torch.equal(model.policy.get_parameter(name), kept) for name, kept in held.items())


def test_collisions_cost_more_while_learning_and_nowhere_else(tmp_path):
    # Oracle: the scenario's own reward, which evaluations keep.
    settings = TrainingSettings("intruders", caution=2.5, overrides={"task.reward_collision": -4.0})
    assert settings.make_cautious_scenario().task.reward_collision == -10.0
    assert settings.make_scenario().task.reward_collision == -4.0
    settings = TrainingSettings("failure", worlds=2, caution=2.5, threads=1, rivals=(), out=tmp_path / "run")
    with Folder(tmp_path / "run") as folder:
        trainer = Sb3Trainer(settings, Console(quiet=True), folder)
    learned_in, evaluated_in = trainer.env.scenario, trainer.scenario
    assert learned_in.task.reward_collision == 2.5 * evaluated_in.task.reward_collision


def test_noise_falls_as_the_settings_say(tmp_path, monkeypatch):
    # Oracle: the line from the first to the last, from the end of imitation on; where it would rise it stays.
    seen = []
    set_noise = _Watch._set_noise

    def recorded(watch):
        set_noise(watch)
        seen.append(watch.model.policy.log_std.detach().mean().item())

    monkeypatch.setattr(_Watch, "_set_noise", recorded)
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


def test_a_training_says_when_it_beat_its_rival(tmp_path, monkeypatch):
    # Story: two evaluations beat it, the first of them is told, once.
    out = io.StringIO()
    settings = TrainingSettings(
        "failure", worlds=4, rollout=8, batch_size=160, layers=(4,), base="none", teacher="none", threads=1,
        epochs=1, rivals=("still",), evaluation_episodes=1, evaluate_every=160, steps=480, out=tmp_path / "run",
    )  # fmt: skip
    points = iter([9.5, 8.0, 7.0])

    def evaluated(trainer, policy):
        rival = not isinstance(policy, Learned)
        trainer.history.seconds = 190.2
        time = 9.0 if rival else next(points)
        return {"detection_time": time, "collisions": 0.0, "return": -time, "detected_fraction": 0.5}

    monkeypatch.setattr(Trainer, "_evaluated", evaluated)
    train(settings, Console(file=out, width=120))
    assert out.getvalue().count("better than still") == 1
    assert "better than still after 0:03:10, 320 steps" in out.getvalue()


def test_steps_without_dictionaries_are_the_same_steps():
    # Oracle: the step of the library's interface, told in its infos.
    first, second = make_env(seed=4), make_env(seed=4)
    assert (first.reset() == second.reset()).all()
    for _ in range(25):
        actions = np.full((40, 2), 0.2)
        (rows, rewards, dones, infos), step = first.step(actions), second.step_rows(actions)
        for ours, theirs in ((step.rows, rows), (step.rewards, rewards), (step.dones, dones)):
            assert (ours == theirs).all()
        for k, last in zip(np.flatnonzero(dones), step.last, strict=True):
            assert (infos[k]["terminal_observation"] == last).all()
            assert infos[k]["TimeLimit.truncated"] == step.truncated[k]


def test_staggered_worlds_are_at_all_moments_of_an_episode():
    # Story: 20 worlds of 20 steps begin together; after the first episodes each moment of an episode has its world.
    env = RobotVecEnv(lissajous_env.scenario("intruders", **SHORT), 20, staggered=True, seed=0)
    env.reset()
    for _ in range(20):
        env.step_rows(np.zeros((100, 2)))
    moments = env.simulation.clock.step.numpy()
    assert len(set(moments)) >= 16
    # So are the first half of the worlds, which a teacher may drive; and later episodes have their whole time.
    assert len(set(moments[:10] // 4)) == 5
    ended = np.zeros(20)
    for _ in range(40):
        ended += env.step_rows(np.zeros((100, 2))).dones.reshape(20, 5).all(axis=1)
    assert (ended == 2).all()


def test_staggered_worlds_go_on_where_they_were():
    # Oracle: the worlds that were not interrupted, in the midst of their first episodes.
    scenario = lissajous_env.scenario("intruders", **SHORT)
    first, second = (RobotVecEnv(scenario, 6, staggered=True, seed=seed) for seed in (0, 9))
    for env in (first, second):
        env.reset()
    for _ in range(8):
        first.step_rows(np.full((30, 2), 0.1))
    second.load_state(first.save_state())
    for _ in range(30):
        ours, theirs = (env.step_rows(np.full((30, 2), 0.1)) for env in (first, second))
        assert (ours.rows == theirs.rows).all()
        assert (ours.dones == theirs.dones).all()
