"""The TorchRL environment of a space: the library's checker, padding, and equality with the simulations."""

import warnings

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("torchrl")

from gymnasium.error import ResetNeeded  # noqa: E402
from tensordict import TensorDict  # noqa: E402
from torchrl.collectors import Collector  # noqa: E402
from torchrl.envs import check_env_specs  # noqa: E402

from lissajous_env import ScenarioSpace, Simulation, scenario  # noqa: E402
from lissajous_env.envs.true_state import padded_rows  # noqa: E402
from lissajous_env.parameters.assumptions import AssumptionWarning  # noqa: E402
from training.torchrl import SampledTorchEnv  # noqa: E402

DRAW = {
    "curve": {"choices": [{"a": 1, "b": 2}, {"a": 3, "b": 2}], "half_height": {"low": 0.8, "high": 1.0}},
    "targets": {"count": {"low": 1, "high": 9}},
    "task": {"duration": {"choices": [0.5, 1.0]}, "contamination": None},
}
SMALL = ScenarioSpace("small", scenario("evaders"), DRAW)


@pytest.fixture(autouse=True)
def _no_warning_about_assumptions():
    with warnings.catch_warnings():
        warnings.simplefilter("error", AssumptionWarning)
        yield


def make(num_groups=4, group_size=2, seed=5, **settings):
    return SampledTorchEnv(SMALL, num_groups, group_size, seed=seed, **settings)


def zeros(env):
    return torch.zeros(env.full_action_spec["robot", "action"].shape)


def play(env, steps):
    """Roll out with given actions: a TensorDict (W, steps); worlds that end are reset, each on its own."""
    shape = env.full_action_spec["robot", "action"].shape
    given = iter(torch.from_numpy(np.random.default_rng(0).uniform(-1, 1, (steps, *shape)).astype(np.float32)))
    return env.rollout(steps, lambda td: td.set(("robot", "action"), next(given)), break_when_any_done=False)


@pytest.mark.parametrize("settings", [{}, {"discrete_actions": True}, {"state": True}], ids=str)
def test_the_checker_of_torchrl_passes(settings):
    # Oracle: TorchRL's contract checker.
    env = make(**settings)
    check_env_specs(env, seed=3)
    assert env.batch_size == (8,)
    assert env.observation_spec["robot", "observation"].shape == (8, 5, 42)


def test_each_group_is_a_simulation_of_its_scenario_padded_to_the_largest_team():
    env = make(state=True)
    data = play(env, 4)
    assert len({each.digest() for each in env.scenarios}) == 4
    assert {each.num_robots for each in env.scenarios} == {3, 5}
    for group, made in enumerate(env.scenarios):
        rows, n = slice(2 * group, 2 * group + 2), made.num_robots
        alone = Simulation(made, 2, seed=int(env.groups[group].simulation.score()[0]["seed"]))
        for step in range(4):
            now = data[rows, step]
            assert (now["robot", "observation"][:, :n].numpy() == alone.observation.numpy()).all()
            expected = padded_rows(alone, 5, (data["state"].shape[-1] - 41) // 3)
            np.testing.assert_allclose(now["state"].numpy(), expected, atol=1e-6)
            alone.step(np.ascontiguousarray(now["robot", "action"][:, :n].numpy()))
            after = now["next"]
            assert (after["robot", "reward"][:, :n, 0].numpy() == alone.reward.numpy()).all()
            assert (after["robot", "mask"][:, :, 0].sum(1) == n).all()
            assert not after["robot", "observation"][:, n:].any()
            assert not after["robot", "reward"][:, n:].any()
            assert after["robot", "done"][:, n:].all()
            assert after["robot", "truncated"][:, :n, 0].numpy().tolist() == alone.truncated.numpy().tolist()


def test_a_group_that_is_over_goes_on_with_its_next_scenario():
    env = make()
    env.reset()
    before = env.scenarios
    data = play(env, 12)  # which begins anew, with the second scenario of each group
    assert data["next", "done"].any(dim=1).all()
    assert not any(a == b for a, b in zip(before, env.scenarios, strict=True))
    ended = data["next", "done"][..., 0]
    assert torch.isfinite(data["next", "score", "collisions"][..., 0]).equal(ended)
    # The masks change with the teams, between episodes alone.
    mask, begins = data["robot", "mask"][..., 0], torch.cat([ended[:, :1] & False, ended[:, :-1]], 1)
    changed = (mask[:, 1:] != mask[:, :-1]).any(-1)
    assert not (changed & ~begins[:, 1:]).any()


def test_a_seed_repeats_scenarios_and_episodes_and_groups_do_not_depend_on_the_others():
    env = make(seed=1)
    first = play(env, 15)
    env.set_seed(1)
    again = play(env, 15)
    for key in (("robot", "observation"), ("robot", "mask"), ("next", "robot", "reward"), ("next", "done")):
        assert torch.equal(again[key], first[key])
    few = make(num_groups=2, seed=1)
    few.reset()
    many = make(seed=1)
    many.reset()
    assert few.scenarios == many.scenarios[:2]
    env.set_seed(2)
    env.reset()
    assert env.scenarios != many.scenarios


def test_worlds_that_are_reset_alone_keep_their_scenario():
    env = make()
    data = env.reset()
    before, groups = env.scenarios, env.groups[:]
    data["robot", "action"] = zeros(env) + 1
    after = env.step(data)["next"]
    mask = torch.tensor([True, True, True, False, False, False, False, False])[:, None]
    again = env.reset(after.clone().set("_reset", mask))
    assert env.scenarios[0] != before[0]
    assert env.scenarios[1:] == before[1:]
    assert env.groups[1:] == groups[1:]
    assert (again["robot", "observation"][3:] == after["robot", "observation"][3:]).all()
    assert (again["robot", "observation"][2] != after["robot", "observation"][2]).any()


def test_a_collector_meets_many_scenarios():
    env = make(num_groups=3)
    collector = Collector(env, None, frames_per_batch=6 * 10, total_frames=6 * 60)
    met = set()
    for data in collector:
        assert data.shape == (6, 10)
        assert torch.isfinite(data["next", "robot", "reward"]).all()
        met |= {each.digest() for each in env.scenarios}
    collector.shutdown()
    assert len(met) >= 9


def test_the_shipped_space_and_its_split():
    env = SampledTorchEnv("monitoring-v1:test", 2, 1, seed=0, **{"task.contamination": None})
    env.reset()
    seeds = [int(each.name.rpartition("-")[2]) for each in env.scenarios]
    assert [env._sampler.space.split_of(seed) for seed in seeds] == ["test", "test"]
    assert env.render(world=1).dtype == np.uint8


@pytest.mark.parametrize(
    ("arguments", "settings", "words"),
    [
        (("monitoring-v1:exam",), {}, "split must be one of train, validation, test"),
        (("evaders",), {}, "space must be a space of scenarios, as SPACE or SPACE:SPLIT, got 'evaders'"),
        ((SMALL, 0), {}, "num_groups must be a whole number of at least 1, got 0"),
        ((SMALL,), {"targets.rogues": "agents"}, "targets.rogues must be None or a scripted rogue"),
    ],
)
def test_invalid_arguments_are_refused(arguments, settings, words):
    with pytest.raises(ValueError, match=words):
        SampledTorchEnv(*arguments, **settings)


def test_an_action_that_is_not_finite_is_refused_with_its_group():
    env = make()
    data = env.reset()
    data["robot", "action"] = zeros(env)
    data["robot", "action"][3, 1, 0] = torch.nan
    with pytest.raises(ValueError, match=r"action of robot_1 in world 1 must be finite, .*, in group 1 of small-\d+"):
        env.step(data)


def test_a_step_or_picture_before_the_first_reset_is_refused():
    env = make()
    with pytest.raises(ResetNeeded, match="render needs an episode: call reset first"):
        env.render()
    given = TensorDict({"robot": {"action": zeros(env)}}, batch_size=(8,))
    with pytest.raises(ResetNeeded, match="step needs a running episode: call reset first"):
        env._step(given)
