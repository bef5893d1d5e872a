"""BenchMARL tasks: its algorithms train on them, and logged values are the scores of the simulation."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("benchmarl")

import benchmarl_mappo  # noqa: E402
import tyro  # noqa: E402
from benchmarl.environments import task_config_registry  # noqa: E402
from benchmarl_mappo import Settings, experiment  # noqa: E402
from hydra.core.config_store import ConfigStore  # noqa: E402
from tensordict import TensorDict  # noqa: E402
from torchrl.envs.utils import ExplorationType, set_exploration_type  # noqa: E402

import lissajous_env  # noqa: E402
from training.torchrl import LissajousTorchEnv, ModulePolicy, hydra_run  # noqa: E402
from training.torchrl.benchmarl import LissajousTask, LissajousTaskClass  # noqa: E402
from training.torchrl.env import SCORES  # noqa: E402

# Two seconds in which some targets are there from the start: something is detected.
SHORT = {"task.duration": 2.0, "targets.count": 20}


def scalars(folder):
    """Every curve that was logged: name -> values."""
    files = list(folder.rglob("scalars/*.csv"))
    return {path.stem: np.loadtxt(path, delimiter=",", ndmin=2)[:, 1] for path in files}


def parameters(run, group="robot"):
    return torch.cat([p.detach().flatten().clone() for p in run.losses[group].parameters() if p.requires_grad])


@pytest.mark.filterwarnings("ignore:SyncDataCollector has been deprecated.*:DeprecationWarning")
@pytest.mark.parametrize(
    ("algorithm", "iterations", "overrides"),
    [
        ("mappo", 2, {"state": True, "messages.size": 2}),
        # Robots that are out before the others, and worlds that end before their time.
        ("mappo", 1, {"task.on_collision": "remove", "robot.radius": 0.5, "formation.start": "random"}),
        ("ippo", 1, {}),
        ("qmix", 1, {"state": True, "scenario": lissajous_env.scenario("failure")}),
    ],
)
def test_training(algorithm, iterations, overrides, tmp_path):
    # Oracle: parameters that change; curves with one finite value for each iteration; the action that was requested.
    settings = Settings("intruders", algorithm, iterations, worlds=4, out=tmp_path)
    run = experiment(settings, **SHORT, **overrides)
    before = parameters(run)
    run.run()
    after = parameters(run)
    assert torch.isfinite(after).all()
    assert not torch.equal(before, after)
    assert run.total_frames == iterations * 4 * 20
    assert run.continuous_actions == (algorithm != "qmix")
    assert run.group_map == {"robot": [f"robot_{i}" for i in range(5)]}
    assert (run.state_spec is not None) == overrides.get("state", False)
    curves = scalars(tmp_path)
    for name in (
        "collection_reward_reward_mean",
        "collection_reward_episode_reward_mean",
        "collection_robot_info_reward_detection",
        "collection_score_detected_fraction",
        "collection_score_detection_time_mean",
    ):
        assert curves[name].shape == (iterations,)
    for name, values in curves.items():
        assert np.isfinite(values).all(), name


@pytest.mark.filterwarnings("ignore:SyncDataCollector has been deprecated.*:DeprecationWarning")
@pytest.mark.parametrize("algorithm", ["mappo", "qmix"])
def test_what_was_trained_is_a_policy(algorithm, tmp_path):
    # Oracle: TorchRL's own rollout of the same module in the environment that it was trained on, on the same seeds.
    run = experiment(Settings("intruders", algorithm, 1, worlds=2, out=tmp_path), **SHORT)
    run.run()
    scenario = lissajous_env.scenario("intruders", **SHORT)
    env = LissajousTorchEnv(scenario, 3, seed=6, discrete_actions=algorithm == "qmix")
    with set_exploration_type(ExplorationType.DETERMINISTIC), torch.no_grad():
        last = env.rollout(20, run.policy)["next", "score"][:, -1]
    policy = ModulePolicy(run.policy, scenario, num_worlds=3)
    rows = lissajous_env.evaluate(policy, scenario, range(6, 9))
    for name in SCORES:
        scores = np.array([row[name] for row in rows], dtype=np.float32)
        np.testing.assert_array_equal(last[name][:, 0], scores, err_msg=name)


def test_a_module_of_another_shape_is_refused():
    def pointless(data):
        return data.set(("robot", "action"), data["robot", "observation"])

    seen = np.zeros((2, 5, 42), dtype=np.float32)
    with pytest.raises(ValueError, match=r"actions of function must have shape \(2, 5, 2\), got"):
        ModulePolicy(pointless, "intruders", 2).act(seen)
    with pytest.raises(ValueError, match=r"module must be callable with a TensorDict, got 'policy.pt'"):
        ModulePolicy("policy.pt", "intruders", 2)


def test_the_example_as_a_program(tmp_path):
    # Oracle: the files that it promises.
    arguments = ["--iterations", "2", "--worlds", "2", "--out", str(tmp_path)]
    tyro.cli(benchmarl_mappo.main, args=[*arguments, "--set", "task.duration=1", "targets.count=5"])
    assert scalars(tmp_path)["collection_reward_episode_reward_mean"].shape == (2,)


HYDRA = (
    "task=lissajous/failure", "algorithm=mappo", "experiment.max_n_iters=1",
    "experiment.on_policy_collected_frames_per_batch=60", "experiment.on_policy_n_envs_per_worker=2",
    "experiment.on_policy_minibatch_size=30", "experiment.on_policy_n_minibatch_iters=1",
    "experiment.evaluation=false", "experiment.loggers=[]", "experiment.create_json=false",
    "+task.task.duration=3.0", "+task.targets.count=4",
)  # fmt: skip


def test_the_command_of_hydra_trains_on_a_task_with_fields_of_the_scenario_changed(tmp_path):
    # Oracle: 60 frames of two worlds are 30 steps, the whole of an episode of 3 s: its return is known then. In a
    # process of its own: Hydra's logging keeps the stream of the test in which it began.
    command = [sys.executable, "-m", hydra_run.__name__, *HYDRA]
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert re.search(r"mean return = -?[\d.]+", done.stderr)


def test_every_scenario_is_a_task():
    # Oracle: the library of scenarios.
    names = {task.name.lower().replace("_", "-") for task in LissajousTask}
    assert names == set(lissajous_env.scenarios())
    assert {name for name in task_config_registry if name.startswith("lissajous/")} == {
        f"lissajous/{name}" for name in names
    }
    assert set(ConfigStore.instance().list("task/lissajous")) == {f"{name}.yaml" for name in names}
    for task in LissajousTask:
        instance = task.get_task()
        assert instance.scenario == lissajous_env.scenario(task.name.lower().replace("_", "-"))
        assert instance.max_steps(None) == instance.scenario.task.steps


def test_the_config_of_a_task(tmp_path):
    task = LissajousTask.INTRUDERS.get_task({"task.duration": 30.0, "state": True})
    assert task.scenario == lissajous_env.scenario("intruders", **{"task.duration": 30.0})
    env = task.get_env_fun(num_envs=3, continuous_actions=False, seed=7, device="cpu")()
    assert env.batch_size == (3,)
    assert task.state_spec(env)["state"].shape == env.reset()["state"].shape[1:]
    assert task.action_spec(env)["robot", "action"].shape == (5,)
    assert list(task.observation_spec(env).keys(True, True)) == [("robot", "observation")]
    own = lissajous_env.scenario("rough", **{"robot.radius": 0.1})
    assert LissajousTaskClass("mine", {"scenario": own}).scenario == own
    (tmp_path / "My_Team.toml").write_text('base = "rough"\n[robot]\nradius = 0.1\n')
    assert LissajousTaskClass(str(tmp_path / "My_Team.toml")).scenario.robot == own.robot
    with pytest.raises(ValueError, match=r"did you mean"):
        LissajousTask.INTRUDERS.get_task({"task.duraton": 30.0})


def test_logged_scores_are_means_over_the_episodes_that_ended():
    # Oracle: by hand: two of three worlds ended, one of them without a target to detect.
    values = torch.tensor([[[0.25], [99.0]], [[0.75], [torch.nan]], [[torch.nan], [torch.nan]]])
    score = dict.fromkeys(SCORES, values[:, :1])
    score["detection_time_mean"] = torch.tensor([[[4.0]], [[torch.nan]], [[8.0]]])
    score["idleness_mean"] = torch.full((3, 1, 1), torch.nan)
    done = torch.tensor([[[True]], [[True]], [[False]]])
    batch = TensorDict({"next": {"done": done, "score": score}}, batch_size=(3, 1))
    logged = LissajousTaskClass.log_info(batch)
    assert logged["collection/score/detected_fraction"] == 0.5
    assert logged["collection/score/detection_time_mean"] == 4.0
    assert "collection/score/idleness_mean" not in logged
    assert len(logged) == len(SCORES) - 1


@pytest.mark.filterwarnings("ignore:SyncDataCollector has been deprecated.*:DeprecationWarning")
@pytest.mark.parametrize("algorithm", ["mappo", "qmix"])
def test_both_sides_are_trained(algorithm, tmp_path):
    # Oracle: the parameters of both groups change and stay finite.
    few = {"targets.count": 3, "targets.arrival_rate": 0.0, "targets.entry": "unseen", "sensing.radius": 0.4}
    overrides = {**SHORT, **few, "rogues": "agents"}
    run = experiment(Settings("experiment", algorithm, 2, worlds=4, out=tmp_path), **overrides)
    before = {group: parameters(run, group) for group in ("robot", "rogue")}
    run.run()
    for group, start in before.items():
        assert torch.isfinite(parameters(run, group)).all()
        assert not torch.equal(start, parameters(run, group))
