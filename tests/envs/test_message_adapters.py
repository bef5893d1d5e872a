"""Messages of policies: refused ones, discrete ones, and trainings in which robots speak."""

import gymnasium
import numpy as np
import pytest
from rich.console import Console

import lissajous_env
import training
from lissajous_env.envs.actions import action_table

TALKING = {"scenario": "failure", "messages.size": 4, "task.duration": 2.0}
FORMS = pytest.mark.parametrize("discrete", [False, True])


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
