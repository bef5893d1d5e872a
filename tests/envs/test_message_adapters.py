"""Messages of policies in every interface: the libraries' checkers, the simulation's rows, and trainings."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, seed_test
from rich.console import Console

import lissajous_env
import training
from lissajous_env.envs.actions import action_table

TALKING = {"scenario": "failure", "messages.size": 4, "task.duration": 2.0}
FORMS = pytest.mark.parametrize("discrete", [False, True])
STEPS = 12


@pytest.fixture(autouse=True)
def _warnings_of_checkers_are_errors():
    with warnings.catch_warnings():
        warnings.filterwarnings("error", module="gymnasium|pettingzoo")
        warnings.filterwarnings("ignore", ".*environment not having a spec.*")
        yield


# The libraries' own checkers.


@FORMS
def test_the_checkers_of_pettingzoo(discrete):
    settings = {**TALKING, "discrete_actions": discrete}
    parallel_api_test(lissajous_env.parallel_env(**settings), num_cycles=50)
    parallel_seed_test(lambda: lissajous_env.parallel_env(**settings), num_cycles=30)
    api_test(lissajous_env.env(**settings), num_cycles=50)
    seed_test(lambda: lissajous_env.env(**settings), num_cycles=30)


@pytest.mark.parametrize("settings", [{}, {"discrete_actions": True}, {"flat_actions": True}])
def test_the_checker_of_gymnasium(settings):
    env = lissajous_env.LissajousEnv(**TALKING, **settings)
    check_env(env, skip_render_check=True)
    made = gymnasium.make("lissajous_env:lissajous/failure-v0", **{"messages.size": 4})
    assert made.action_space.shape == (5, 5)


@FORMS
def test_the_checker_of_torchrl(discrete):
    pytest.importorskip("torchrl")
    from torchrl.envs import check_env_specs

    from training.torchrl import LissajousTorchEnv

    env = LissajousTorchEnv(num_worlds=3, seed=1, state=True, discrete_actions=discrete, **TALKING)
    check_env_specs(env)
    assert env.rollout(1)["robot", "observation"].shape == (3, 1, 5, env.simulation.layout.size)


def test_the_checker_of_rllib():
    pytest.importorskip("ray.rllib")
    from ray.rllib.utils.pre_checks.env import check_multiagent_environments

    from training.rllib import LissajousMultiAgentEnv

    env = LissajousMultiAgentEnv(TALKING)
    check_multiagent_environments(env)
    assert env.get_action_space("robot_0").shape == (5,)


# What they show.


def parallel(actions, seed):
    env = lissajous_env.parallel_env(**TALKING)
    yield env.reset(seed=seed)[0].values()
    for action in actions:
        yield env.step(dict(zip(env.agents, action, strict=True)))[0].values()


def in_turn(actions, seed):
    env = lissajous_env.env(**TALKING)
    env.reset(seed=seed)
    for action in [*actions, None]:
        yield [env.observe(agent) for agent in env.possible_agents]
        for row in action if action is not None else ():
            env.step(row)


def team(actions, seed, **settings):
    env = lissajous_env.LissajousEnv(**TALKING, **settings)
    yield env.reset(seed=seed)[0]
    for action in actions:
        yield env.step(action.reshape(env.action_space.shape))[0]


def flat(actions, seed):
    return team(actions, seed, flat_actions=True)


def vector(actions, seed, **settings):
    env = lissajous_env.vector_env(num_envs=1, **TALKING, **settings)
    yield env.reset(seed=seed)[0]
    for action in actions:
        yield env.step(action.reshape(env.action_space.shape))[0]


def robots(actions, seed):
    return vector(actions, seed, agents_as_rows=True)


def stable_baselines(actions, seed):
    pytest.importorskip("stable_baselines3")
    from training.sb3 import RobotVecEnv

    env = RobotVecEnv(seed=seed, **TALKING)
    env.reset()
    env.simulation.reset(seeds=[seed])
    yield env.simulation.observation.numpy()
    for action in actions:
        yield env.step(action)[0]


def torchrl(actions, seed):
    torch = pytest.importorskip("torch")
    pytest.importorskip("torchrl")
    from training.torchrl import LissajousTorchEnv

    env = LissajousTorchEnv(num_worlds=1, seed=seed, **TALKING)
    now = env.reset()
    for action in actions:
        yield now["robot", "observation"].numpy()
        now = env.step(now.set(("robot", "action"), torch.from_numpy(action)[None]))["next"]
    yield now["robot", "observation"].numpy()


def rllib(actions, seed):
    pytest.importorskip("ray.rllib")
    from training.rllib import LissajousMultiAgentEnv

    env = LissajousMultiAgentEnv(TALKING)
    yield env.reset(seed=seed)[0].values()
    for action in actions:
        yield env.step(dict(zip(env.agents, action, strict=True)))[0].values()


@pytest.mark.parametrize("play", [parallel, in_turn, team, flat, vector, robots, stable_baselines, torchrl, rllib])
def test_every_interface_shows_the_rows_of_the_simulation(play):
    # Oracle: `Simulation`, bit for bit; and the messages of its rows are not zeros.
    overrides = {name: value for name, value in TALKING.items() if name != "scenario"}
    simulation = lissajous_env.Simulation("failure", seed=3, **overrides)
    actions = np.random.default_rng(0).uniform(-1.2, 1.2, (STEPS, 5, 5)).astype(np.float32)
    shown = play(actions, 3)
    for action in [*actions, None]:
        rows = np.array([*next(shown)]).reshape(simulation.observation.shape)
        assert rows.tobytes() == simulation.observation.numpy().tobytes()
        if action is not None:
            simulation.step(action[None])
    assert rows.shape[-1] == 42 + 8
    assert (rows[..., 42:] != 0).all()


def test_a_message_is_checked_as_an_action_is():
    env = lissajous_env.parallel_env(**TALKING)
    env.reset(seed=1)
    action = dict.fromkeys(env.agents, np.zeros(5))
    with pytest.raises(ValueError, match=r"action of robot_2 must be finite, got \[0.0, 0.0, nan, 0.0, 0.0\]"):
        env.step(action | {"robot_2": np.array([0, 0, np.nan, 0, 0])})
    with pytest.raises(ValueError, match=r"action of robot_2 must be numbers of shape \(5,\), got"):
        env.step(action | {"robot_2": np.zeros(1)})
    rows, *_ = env.step(action | {"robot_2": np.array([0, 0.25, 7.0, 1e300, -9])})
    hears = [i for i, pair in enumerate(env.scenario.neighbours) if pair[0] == 2]
    assert rows[f"robot_{hears[0]}"][42:46].tolist() == [0.25, 1, 1, -1]


@pytest.mark.parametrize("agents_as_rows", [False, True])
def test_discrete_actions_send_what_the_table_says(agents_as_rows):
    # Oracle: the rows of the table.
    env = lissajous_env.vector_env(num_envs=2, discrete_actions=True, agents_as_rows=agents_as_rows, **TALKING)
    table = action_table(env.scenario)
    env.reset(seed=0)
    chosen = np.random.default_rng(1).integers(0, len(table), (2, 5))
    space = env.single_action_space
    assert (space.n if agents_as_rows else space.nvec[0]) == len(table) == 7 * 5
    rows = env.step(chosen.reshape(env.action_space.shape))[0].reshape(2, 5, -1)
    sent = table[chosen][..., 1:]
    np.testing.assert_array_equal(rows[..., 42:46], sent[:, env.scenario.neighbours[:, 0]])
    np.testing.assert_array_equal(rows[..., 46:50], sent[:, env.scenario.neighbours[:, 1]])


# Trainings.


SMALL = {
    "scenario": "failure", "worlds": 16, "rollout": 16, "batch_size": 320, "steps": 3840, "evaluate_every": 3840,
    "evaluation_episodes": 2, "layers": (8,), "threads": 1, "rivals": (),
    "overrides": {"messages.size": 2, "task.duration": 3.0, "targets.arrival_rate": 2.0},
}  # fmt: skip


@pytest.mark.parametrize(
    "settings",
    [
        {"base": "none", "teacher": "none"},
        {"base": "kuramoto", "residual": 0.5},
        {"base": "none", "teacher": "kuramoto", "imitation_steps": 1280},
    ],
)
def test_a_policy_with_messages_is_trained_and_speaks(settings, tmp_path):
    # Oracle: the shape of the action, weights that changed in every output, and numbers that are heard.
    pytest.importorskip("stable_baselines3")
    from training.learned import checkpoint
    from training.sb3.trainer import train
    from training.settings import TrainingSettings

    out = tmp_path / "run"
    history = train(TrainingSettings(**{**SMALL, **settings, "out": out}), Console(quiet=True))
    assert history.curve[-1]["steps"] == 3840
    network, card, _ = checkpoint.read(out)
    assert (network.outputs, card.action_size) == (3, 3)
    assert [name for name in card.inputs if "message" in name] == [
        f"neighbour_{side}_message_{m}" for side in range(2) for m in range(2)
    ]
    policy = training.load(out, num_worlds=2)
    simulation = lissajous_env.Simulation(policy.scenario, 2, seed=1)
    for _ in range(5):
        simulation.step(policy.act(simulation.observation))
    assert (simulation.observation.numpy()[..., 42:] != 0).all()
    (row,) = lissajous_env.evaluate(training.load(out), policy.scenario, seeds=range(1))
    assert np.isfinite(row["return_mean"])


def test_one_who_imitates_learns_to_be_silent(tmp_path):
    # Oracle: the teacher's zeros. A network that was not trained speaks louder by far.
    pytest.importorskip("stable_baselines3")
    from training.sb3.trainer import train
    from training.settings import TrainingSettings

    loud = {}
    for steps in (1280, 40_960):
        settings = {"base": "none", "imitation_steps": 50_000, "teacher": "kuramoto", "learning_rate": 3e-3}
        settings |= {"steps": steps, "evaluate_every": steps, "out": tmp_path / str(steps)}
        train(TrainingSettings(**SMALL | settings), Console(quiet=True))
        policy = training.load(tmp_path / str(steps), num_worlds=8)
        action = policy.act(lissajous_env.Simulation(policy.scenario, 8, seed=5).observation.numpy())
        loud[steps] = np.abs(action[..., 1:]).mean()
    assert loud[40_960] < min(0.1, 0.7 * loud[1280])


@FORMS
def test_a_model_of_stable_baselines_speaks(discrete):
    # Oracle: the model's own prediction for each row.
    stable_baselines3 = pytest.importorskip("stable_baselines3")
    from training.sb3 import ModelPolicy, RobotVecEnv

    worlds = RobotVecEnv(num_worlds=2, seed=0, **TALKING)
    if discrete:
        worlds.action_space = gymnasium.spaces.Discrete(len(action_table(worlds.scenario)))
    model = stable_baselines3.PPO("MlpPolicy", worlds, seed=1, device="cpu", n_steps=8)
    rows = worlds.reset()
    chosen, _ = model.predict(rows, deterministic=True)
    policy = ModelPolicy(model, worlds.scenario, 2)
    action = policy.act(rows.reshape(2, 5, -1)).reshape(10, -1)
    expected = action_table(worlds.scenario)[chosen] if discrete else chosen
    np.testing.assert_allclose(action, expected, atol=1e-6)
    if not discrete:
        model.learn(80)
        simulation = lissajous_env.Simulation(worlds.scenario, 2)
        simulation.step(policy.act(simulation.observation))
        assert (simulation.observation.numpy()[..., 42:] != 0).all()


@pytest.mark.filterwarnings("ignore:SyncDataCollector has been deprecated.*:DeprecationWarning")
@pytest.mark.parametrize(("algorithm", "state"), [("mappo", True), ("qmix", False)])
def test_benchmarl_trains(algorithm, state, tmp_path):
    # Oracle: parameters that change and are finite.
    torch = pytest.importorskip("torch")
    pytest.importorskip("benchmarl")
    from benchmarl_mappo import Settings, experiment

    overrides = {"messages.size": 2, "task.duration": 1.0, "state": state}
    run = experiment(Settings("failure", algorithm, 1, worlds=4, out=tmp_path, overrides=overrides))

    def parameters():
        return torch.cat([p.detach().flatten().clone() for p in run.losses["robot"].parameters() if p.requires_grad])

    before = parameters()
    run.run()
    assert torch.isfinite(parameters()).all()
    assert not torch.equal(before, parameters())
