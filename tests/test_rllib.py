"""RLlib: the environment's contract, its policies, and trainings that lose a process, a node or a file."""

import json
import math
import pickle
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from rich.console import Console

import lissajous_env
from lissajous_env import Simulation

ray = pytest.importorskip("ray")
pytest.importorskip("ray.rllib")
pytest.importorskip("stable_baselines3")

import torch  # noqa: E402
from ray.cluster_utils import Cluster  # noqa: E402
from ray.rllib.core.columns import Columns  # noqa: E402
from ray.rllib.env.env_context import EnvContext  # noqa: E402
from ray.rllib.env.multi_agent_episode import MultiAgentEpisode  # noqa: E402
from ray.rllib.utils.pre_checks.env import check_multiagent_environments  # noqa: E402
from test_cluster import HEAD, STORE  # noqa: E402
from test_network import outputs  # noqa: E402

import training  # noqa: E402
from training.learned import checkpoint  # noqa: E402
from training.learned.card import Card  # noqa: E402
from training.learned.network import Network  # noqa: E402
from training.rllib import LissajousMultiAgentEnv, ppo  # noqa: E402
from training.rllib.trainer import RllibTrainer, train  # noqa: E402
from training.settings import TrainingSettings  # noqa: E402

QUIET = Console(quiet=True)
SHORT = {"scenario": "failure", "task.duration": 3.0}
CRASHING = {**SHORT, "task.on_collision": "remove", "robot.radius": 0.2, "formation.start": "random"}
ROWS = 5 * 2 * 4 * 8
"""Steps of a robot in an iteration of the trainings below: robots, workers, worlds of each, steps."""


def settings(out, **changes):
    given = {
        "scenario": "failure", "overrides": {"task.duration": 3.0}, "out": out, "engine": "ray", "base": "none",
        "steps": 12 * ROWS, "worlds": 8, "workers": 2, "rollout": 8, "batch_size": 64, "epochs": 1, "layers": (16, 8),
        "evaluate_every": ROWS, "evaluation_episodes": 2, "rivals": (), "threads": 1,
    }  # fmt: skip
    return TrainingSettings(**given | changes)


def play(env, seed, steps=300):
    """Return the results of the reset and of each step; actions depend on the seed alone."""
    draw = np.random.default_rng(seed)
    returned = [env.reset(seed=seed)]
    for _ in range(steps):
        actions = {agent: draw.uniform(-1, 1, env.action_spaces[agent].shape) for agent in env.agents}
        returned.append(env.step(actions))
        if returned[-1][2]["__all__"] or returned[-1][3]["__all__"]:
            break
    return returned


def counted(out):
    """(steps, iterations) of the checkpoint of a training."""
    counters = json.loads((out / checkpoint.FILE).read_text())["counters"]
    return counters["steps"], counters["updates"]


# The environment.


def test_agents_and_spaces_are_constant_and_in_order():
    # Oracle: the numbers; twelve robots, of which a sort by letters would put robot_10 before robot_2.
    env = LissajousMultiAgentEnv({"scenario": "swarm", "robot.count": 12, "task.duration": 1.0})
    names = [f"robot_{i}" for i in range(12)]
    assert env.possible_agents == list(env.observation_spaces) == list(env.action_spaces) == names
    check_multiagent_environments(env)
    for observations, *_ in play(env, 3):
        assert list(observations) == names
        assert all(env.observation_spaces[agent].contains(row) for agent, row in observations.items())
    assert env.get_observation_space("robot_3") is env.observation_spaces["robot_3"]


def test_it_is_the_simulation_of_the_same_seed():
    # Oracle: `Simulation`, to the last bit.
    env, draw = LissajousMultiAgentEnv(SHORT), np.random.default_rng(5)
    simulation = Simulation(lissajous_env.scenario("failure", **{"task.duration": 3.0}), seed=5)
    observations, _ = env.reset(seed=5)
    for _ in range(30):
        assert (np.stack(list(observations.values())) == simulation.observation.numpy()[0]).all()
        actions = draw.uniform(-1, 1, simulation.action_shape).astype(np.float32)
        observations, rewards, *_ = env.step(dict(zip(env.agents, actions[0], strict=True)))
        simulation.step(actions)
        assert list(rewards.values()) == simulation.reward.numpy()[0].tolist()
    assert str(env.score()) == str(simulation.score()[0])


def test_an_episode_repeats_and_processes_of_rllib_play_other_worlds():
    env = LissajousMultiAgentEnv(SHORT)
    assert (
        pickle.dumps(play(env, 7))
        == pickle.dumps(play(env, 7))
        == pickle.dumps(play(pickle.loads(pickle.dumps(env)), 7))
    )
    firsts = set()
    for worker in (1, 2):
        env = LissajousMultiAgentEnv(EnvContext(SHORT, worker_index=worker))
        # RLlib seeds world k of a worker with the seed plus both numbers.
        firsts |= {env.reset(seed=9 + worker + k)[0]["robot_0"].tobytes() for k in range(4)}
    assert len(firsts) == 8


def test_fresh_environments_without_a_seed_begin_differently():
    drawn = [LissajousMultiAgentEnv(SHORT) for _ in range(4)]
    assert len({env.reset()[0]["robot_0"].tobytes() for env in drawn}) == 4
    assert len({env.reset(seed=3)[0]["robot_0"].tobytes() for env in drawn}) == 1
    assert len({env.reset()[0]["robot_0"].tobytes() for env in drawn}) == 1  # drawn from the seed before


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (np.zeros(2), r"action of robot_2 must be numbers of shape \(1,\), got"),
        (np.array([np.nan]), r"action of robot_2 must be finite, got \[nan\]"),
    ],
)
def test_a_wrong_action_is_refused_by_name_on_top_of_a_base_too(action, words):
    card = Card.of(lissajous_env.scenario("failure"), base="kuramoto", residual=0.3)
    env = LissajousMultiAgentEnv({**SHORT, "card": card})
    env.reset(seed=1)
    with pytest.raises(ValueError, match=words):
        env.step(dict.fromkeys(env.agents, np.zeros(1)) | {"robot_2": action})
    with pytest.raises(ValueError, match=r"unknown or not live \['robot_9'\]"):
        env.step(dict.fromkeys([*env.agents, "robot_9"], np.zeros(1)))
    env.step(dict.fromkeys(env.agents, np.zeros(1)))


def in_rllib(env, seed):
    """The episode as RLlib's environment runner records it."""
    episode = MultiAgentEpisode(
        observation_space=env.observation_spaces, action_space=env.action_spaces,
        agent_to_module_mapping_fn=lambda agent, _: "robot",
    )  # fmt: skip
    observations, infos = env.reset(seed=seed)
    episode.add_env_reset(observations=observations, infos=infos)
    draw = np.random.default_rng(seed)
    while not episode.is_done:
        actions = {a: draw.uniform(-1, 1, env.action_spaces[a].shape) for a in sorted(episode.get_agents_to_act())}
        observations, rewards, terminateds, truncateds, infos = env.step(actions)
        episode.add_env_step(observations, actions, rewards, infos, terminateds=terminateds, truncateds=truncateds)
    return episode


def test_the_end_of_time_is_a_truncation_in_rllibs_own_record():
    # Oracle: what its advantages read: a state whose robot was not terminated keeps its value.
    episode = in_rllib(LissajousMultiAgentEnv(SHORT), 1)
    assert (episode.is_terminated, episode.is_truncated, len(episode)) == (False, True, 30)
    for robot in episode.agent_episodes.values():
        assert (robot.is_terminated, robot.is_truncated, len(robot)) == (False, True, 30)


def test_robots_that_a_collision_removed_are_terminated_and_the_rest_truncated():
    # Story: robots leave in pairs, each with a last observation and its punishment; the rest play to the end.
    env = LissajousMultiAgentEnv(CRASHING)
    seed = next(seed for seed in range(50) if 0 < len(left_at_the_end(env, seed)) < 5)
    left = left_at_the_end(env, seed)
    episode = in_rllib(env, seed)
    assert (episode.is_terminated, episode.is_truncated, len(episode)) == (False, True, 30)
    for agent, robot in episode.agent_episodes.items():
        assert (robot.is_terminated, robot.is_truncated) == ((False, True) if agent in left else (True, False))
        assert (len(robot) == 30) == (agent in left)
        assert agent in left or robot.get_rewards(-1) < -0.5


def left_at_the_end(env, seed):
    play(env, seed)
    return {
        agent
        for agent, gone in zip(env.possible_agents, env.inner.simulation.terminated.numpy()[0], strict=True)
        if not gone
    }


def test_when_all_robots_are_removed_the_episode_is_terminated():
    env = LissajousMultiAgentEnv({**CRASHING, "robot.count": 2, "robot.radius": 0.9, "task.duration": 60.0})
    returned = next(each for each in (play(env, seed, 600) for seed in range(50)) if len(each) <= 600)
    _, _, terminateds, truncateds, _ = returned[-1]
    assert terminateds == {"robot_0": True, "robot_1": True, "__all__": True}
    assert truncateds == {"__all__": False}
    assert env.agents == []


def test_it_renders():
    env = LissajousMultiAgentEnv({**SHORT, "render_mode": "rgb_array"})
    env.reset(seed=1)
    frame = env.render()
    assert (frame.dtype, frame.ndim, frame.shape[2]) == (np.uint8, 3, 3)
    env.close()


def test_a_base_and_chosen_inputs_act_as_the_learned_policy_does():
    # Oracle: `training.Learned`, the network's action clipped, a share of it added to the base's.
    scenario = lissajous_env.scenario("failure", **{"task.duration": 3.0})
    draw = np.random.default_rng(2)
    card = Card.of(scenario, ("cos_phase", "sin_phase", "works"), base="kuramoto", residual=0.3)
    network = Network((draw.normal(0, 2, (1, 4)).astype(np.float32),), (np.zeros(1, np.float32),), "tanh")
    learned, simulation = training.Learned(network, card, scenario), Simulation(scenario, seed=4)
    env = LissajousMultiAgentEnv({"scenario": scenario, "card": card, "residual_penalty": 0.5})
    observations, _ = env.reset(seed=4)
    assert env.observation_spaces["robot_0"].shape == (4,)
    for _ in range(30):
        actions = {agent: outputs(network, row[None])[0] for agent, row in observations.items()}
        observations, rewards, *_ = env.step(actions)
        simulation.step(learned.act(simulation.observation.numpy()))
        penalty = [0.5 * np.clip(action, -1, 1)[0] ** 2 for action in actions.values()]
        assert list(rewards.values()) == pytest.approx(simulation.reward.numpy()[0] - penalty, abs=1e-6)
    expected = simulation.observation.numpy()[0]
    assert env.inner.simulation.observation.numpy()[0] == pytest.approx(expected, abs=1e-5)


# The policy.


@pytest.mark.parametrize("activation", ["relu", "tanh"])
@pytest.mark.parametrize("layers", [(), (16, 8)])
def test_the_network_that_comes_out_acts_as_the_module(activation, layers):
    # Oracle: the module's own forward pass, whose mean is the first half of the distribution's parameters.
    env = LissajousMultiAgentEnv(SHORT)
    model = {"layers": layers, "activation": activation, "log_std": -0.7, "start": None}
    spaces = env.observation_spaces["robot_0"], env.action_spaces["robot_0"]
    module = ppo.RobotModule(observation_space=spaces[0], action_space=spaces[1], model_config=model)
    with torch.no_grad():
        for parameter in module.parameters():
            parameter.add_(torch.randn_like(parameter) * 0.1)
    network = ppo.to_network(module.get_state(), activation)
    rows = np.concatenate([np.stack(list(each[0].values())) for each in play(env, 1)])
    batch = {Columns.OBS: torch.from_numpy(rows)}
    parameters = module.forward_inference(batch)[Columns.ACTION_DIST_INPUTS]
    deterministic = module.get_inference_action_dist_cls().from_logits(parameters).to_deterministic().sample()
    assert network.hidden == layers
    assert outputs(network, rows) == pytest.approx(deterministic.numpy().clip(-1, 1), abs=1e-5)
    started = ppo.RobotModule(
        observation_space=spaces[0], action_space=spaces[1], model_config=model | {"start": network}
    )
    assert str(ppo.to_network(started.get_state(), activation).to_arrays()) == str(network.to_arrays())


# The training.


def run_command(out, steps, workers):
    made = settings(out, steps=steps, workers=workers)
    program = (
        "import pickle, sys; from rich.console import Console; from training.rllib.trainer import train;"
        "train(pickle.loads(bytes.fromhex(sys.argv[1])), Console(width=200))"
    )
    command = [sys.executable, "-c", program, pickle.dumps(made).hex()]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def test_killed_and_called_again_it_goes_on_with_equal_counters(tmp_path):
    # Oracle: steps = iterations x rows, before and after, with two workers and with one that has all the worlds;
    # nothing is lost, nothing counted twice.
    process = run_command(tmp_path, 1000 * ROWS, workers=2)
    deadline = time.monotonic() + 900
    while time.monotonic() < deadline and process.poll() is None:
        if (tmp_path / checkpoint.FILE).exists() and counted(tmp_path)[1] >= 2:
            break
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    said = process.communicate()[0]
    assert process.returncode == -signal.SIGKILL, said
    steps, iterations = counted(tmp_path)
    assert steps == iterations * ROWS > 0

    process = run_command(tmp_path, steps + 3 * ROWS, workers=1)
    said = process.communicate(timeout=300)[0]
    assert process.returncode == 0, said
    assert counted(tmp_path) == (steps + 3 * ROWS, iterations + 3)
    points = [point["steps"] for point in json.loads((tmp_path / checkpoint.FILE).read_text())["curve"]]
    assert points == sorted(set(points))
    assert points[-3:] == [steps + k * ROWS for k in (1, 2, 3)]
    assert not list(tmp_path.rglob("*.pkl"))
    policy = training.load(tmp_path, num_worlds=2)
    assert [row["seed"] for row in lissajous_env.evaluate(policy, policy.scenario, range(2))] == [0, 1]


@pytest.mark.long
def test_a_node_is_killed_and_the_training_goes_on(tmp_path, monkeypatch):
    # Story: one worker is lost with its node; the other samples alone, and the lost one comes back on a third node.
    cluster = Cluster(initialize_head=True, head_node_args=HEAD)
    other = cluster.add_node(num_cpus=1, object_store_memory=STORE)
    ray.init(cluster.address, log_to_driver=False, logging_level="ERROR")
    held = checkpoint.hold(tmp_path)
    trainer = RllibTrainer(settings(tmp_path, steps=20 * ROWS, evaluate_every=1000 * ROWS), QUIET, held)
    healthy, stop = [], trainer.stop_if_asked

    def watch():
        group = trainer.algorithm.env_runner_group
        healthy.append(group.num_healthy_remote_workers())
        if len(healthy) == 3:
            cluster.remove_node(other, allow_graceful=False)
        if len(healthy) == 6:
            cluster.add_node(num_cpus=1, object_store_memory=STORE)
        stop()

    monkeypatch.setattr(trainer, "stop_if_asked", watch)
    try:
        history = trainer.run()
    finally:
        held.close()
        ray.shutdown()
        cluster.shutdown()
    assert history.steps >= 20 * ROWS
    assert healthy[:3] == [2, 2, 2]
    assert 1 in healthy[3:]
    assert math.isfinite(history.curve[-1]["return"])
    assert training.load(tmp_path).card.scenario == "failure"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"algorithm": "dagger", "teacher": "kuramoto"}, "algorithm of engine ray must be ppo"),
        ({"critic": "world"}, "critic of engine ray must be robot, got world"),
        ({"noise_steps": 30}, "noise_steps of engine ray must be 1, got 30"),
        ({"teacher": "kuramoto"}, "teacher of engine ray must be none"),
        ({"device": "cuda:1"}, "device of engine ray"),
    ],
)
def test_settings_that_rllib_cannot_train_with_are_refused(tmp_path, changes, words):
    with pytest.raises(ValueError, match=words):
        train(settings(tmp_path / "out", **changes), QUIET)
    assert not (tmp_path / "out").exists()


def test_the_results_of_others_are_refused(tmp_path):
    scenario = lissajous_env.scenario("failure")
    network = Network((np.zeros((1, 42), np.float32),), (np.zeros(1, np.float32),), "relu")
    checkpoint.save(tmp_path / "sb3", network, Card.of(scenario))
    with pytest.raises(ValueError, match=r"engine = None there, 'ray' here"):
        train(settings(tmp_path / "sb3"), QUIET)
    other = Card.of(scenario, settings=settings(tmp_path, gamma=0.5).to_dict())
    checkpoint.save(tmp_path / "other", network, other)
    with pytest.raises(ValueError, match=r"gamma = 0\.5 there, 0\.99 here"):
        train(settings(tmp_path / "other"), QUIET)
