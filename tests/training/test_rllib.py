"""RLlib: the environment's contract, and the example that trains with RLlib's own PPO."""

import logging

import numpy as np
import pytest

import lissajous_env
from lissajous_env import Simulation

ray = pytest.importorskip("ray")
pytest.importorskip("ray.rllib")

import rllib_ppo  # noqa: E402
import torch  # noqa: E402
from ray.rllib.core.columns import Columns  # noqa: E402
from ray.rllib.env.env_context import EnvContext  # noqa: E402
from ray.rllib.env.multi_agent_episode import MultiAgentEpisode  # noqa: E402
from ray.rllib.utils.pre_checks.env import check_multiagent_environments  # noqa: E402

from training.rllib import LissajousMultiAgentEnv  # noqa: E402

SHORT = {"scenario": "failure", "task.duration": 3.0}
ROGUES = {"targets.count": 2, "targets.arrival_rate": 1.0, "targets.entry": "unseen", "sensing.radius": 0.4,
          "task.duration": 3.0}  # fmt: skip
CRASHING = {**SHORT, "task.on_collision": "remove", "robot.radius": 0.2, "formation.start": "random"}


@pytest.fixture(scope="module")
def one_node():
    """Ray on this machine, and not the cluster that another process has there for other tests."""
    ray.init("local", num_cpus=2, object_store_memory=2**27, include_dashboard=False, log_to_driver=False)
    yield
    ray.shutdown()


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


def test_processes_of_rllib_play_other_worlds():
    firsts = set()
    for worker in (1, 2):
        env = LissajousMultiAgentEnv(EnvContext(SHORT, worker_index=worker))
        # RLlib seeds world k of a worker with the seed plus both numbers.
        firsts |= {env.reset(seed=9 + worker + k)[0]["robot_0"].tobytes() for k in range(4)}
    assert len(firsts) == 8


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
    returned = next(steps for steps in (play(env, seed, 600) for seed in range(50)) if len(steps) <= 600)
    _, _, terminateds, truncateds, _ = returned[-1]
    assert terminateds == {"robot_0": True, "robot_1": True, "__all__": True}
    assert truncateds == {"__all__": False}
    assert env.agents == []


def test_the_example_trains_and_its_policy_is_the_mean_of_the_module(one_node):
    # Oracles: weights that change and are finite; RLlib's own deterministic action.
    logging.getLogger("ray.rllib").setLevel(logging.ERROR)
    scenario = lissajous_env.scenario("failure", **{"task.duration": 3.0})
    settings = rllib_ppo.config(scenario, workers=0, worlds=2)
    algorithm = settings.training(train_batch_size_per_learner=60, minibatch_size=60, num_epochs=1).build_algo()
    try:
        module = algorithm.get_module(rllib_ppo.MODULE)
        before = {name: array.copy() for name, array in module.get_state().items()}
        algorithm.train()
        after = module.get_state()
        assert all(np.isfinite(array).all() for array in after.values())
        assert any((array != before[name]).any() for name, array in after.items())
        rows = Simulation(scenario, 2, seed=1).observation.numpy()
        outputs = module.forward_inference({Columns.OBS: torch.from_numpy(rows).flatten(0, 1)})
        chosen = module.get_inference_action_dist_cls().from_logits(outputs[Columns.ACTION_DIST_INPUTS])
        expected = chosen.to_deterministic().sample().clamp(-1, 1).reshape(2, scenario.num_robots, 1)
        assert rllib_ppo.policy_of(algorithm)(rows) == pytest.approx(expected.detach().numpy(), abs=1e-6)
        (row,) = lissajous_env.evaluate(rllib_ppo.policy_of(algorithm), scenario, seeds=[5])
        assert row["targets"] > 0
    finally:
        algorithm.stop()


def test_rogues_come_and_go():
    # Oracle: RLlib's contract checker; then an episode in which a rogue appears only once it may act.
    env = LissajousMultiAgentEnv({"scenario": "experiment", "rogues": "agents", **ROGUES})
    check_multiagent_environments(env)
    draw = np.random.default_rng(0)
    observations, _ = env.reset(seed=1)
    over, appeared = False, 0
    while not over:
        acted = set(env.agents)
        actions = {agent: draw.uniform(-1, 1, 2).astype(np.float32) for agent in acted}
        observations, rewards, terminated, truncated, _ = env.step(actions)
        assert rewards.keys() == acted == terminated.keys() - {"__all__"}
        appeared += len(observations.keys() - acted)
        over = terminated["__all__"] or truncated["__all__"]
    assert appeared > 0
    assert truncated["__all__"]
