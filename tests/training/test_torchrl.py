"""The TorchRL environment: the library's checker, and equality with the simulation."""

import numpy as np
import pytest
import warp as wp

torch = pytest.importorskip("torch")
pytest.importorskip("torchrl")

from torchrl.envs import check_env_specs  # noqa: E402

import lissajous_env  # noqa: E402
from lissajous_env.envs.sides import action_table, state_rows  # noqa: E402
from training.torchrl.env import SCORES, LissajousTorchEnv  # noqa: E402

SHORT = {"task.duration": 1.0}
CRASHING = {"task.on_collision": "remove", "robot.radius": 0.2, "formation.start": "random"}
KINDS = {
    "default": {},
    "points": {"scenario": "failure"},
    "discrete": {"discrete_actions": True},
    "discrete points": {"scenario": "failure", "discrete_actions": True},
    "with state": {"state": True},
    "discrete messages": {"scenario": "failure", "messages.size": 4, "discrete_actions": True},
    "removing": CRASHING,
    "all removed": {"scenario": "failure", "robot.count": 2, "formation.p": 1, "faults.schedule": (), **CRASHING},
}
EVERY_KIND = pytest.mark.parametrize("kind", KINDS)
DEVICES = ["cpu", pytest.param("cuda", marks=pytest.mark.skipif(not wp.is_cuda_available(), reason="needs CUDA"))]


def make(kind="default", num_worlds=4, **settings):
    return LissajousTorchEnv(num_worlds=num_worlds, **{"seed": 0, **SHORT, **KINDS[kind], **settings})


def by_hand(kind="default", num_worlds=4, seed=0, **settings):
    """The simulation that such an environment should hold."""
    settings = {**SHORT, **KINDS[kind], **settings}
    for name in ("discrete_actions", "state"):
        settings.pop(name, None)
    scenario = lissajous_env.scenario(settings.pop("scenario", "experiment"), **settings)
    return lissajous_env.Simulation(scenario, num_worlds, seed=seed)


def actions_of(env, steps, seed=0):
    """Actions of each step, (steps, W, N, ...)."""
    shape = (steps, *env.full_action_spec["robot", "action"].shape)
    draw = np.random.default_rng(seed)
    if env.full_action_spec["robot", "action"].dtype == torch.int64:
        return torch.from_numpy(draw.integers(0, len(action_table(env.batch.scenario)), shape))
    return torch.from_numpy(draw.uniform(-1, 1, shape).astype(np.float32))


def play(env, actions, **settings):
    """Roll out with given actions: a TensorDict (W, steps); worlds that end are reset, each on its own."""
    upcoming = iter(actions.to(env.device))

    def policy(tensordict):
        return tensordict.set(("robot", "action"), next(upcoming))

    return env.rollout(len(actions), policy, break_when_any_done=False, **settings)


@EVERY_KIND
def test_the_checker_of_torchrl(kind):
    # Oracle: the library's checker, on a fresh environment, in mid-episode and after some worlds alone were reset.
    env = make(kind)
    check_env_specs(env, break_when_any_done="both")
    data = env.rollout(7)
    mask = torch.tensor([[True], [False], [True], [False]])
    env.reset(data[:, -1]["next"].clone().set("_reset", mask))
    played = data.shape[1]  # fewer than 7 where a world lost all its robots before
    assert env.batch.simulation.clock.step.numpy().tolist() == [0, played, 0, played]
    check_env_specs(env, seed=3, break_when_any_done="both")


@pytest.mark.parametrize("discrete", [False, True])
def test_the_checker_of_torchrl_accepts_two_sides(discrete):
    few = {"targets.count": 3, "targets.arrival_rate": 0.0, "targets.entry": "unseen", "sensing.radius": 0.4}
    env = make(num_worlds=2, rogues="agents", discrete_actions=discrete, state=True, **few)
    check_env_specs(env)
    assert env.group_map.keys() == {"robot", "rogue"}


@EVERY_KIND
@pytest.mark.parametrize("device", DEVICES)
def test_a_rollout_is_the_simulation_stepped_by_hand(kind, device):
    # Oracle: `Simulation` with the same seeds and NumPy actions, bit for bit over three episodes of each world.
    env = make(kind, seed=20, device=device)
    actions = actions_of(env, 33)
    data, scenario = play(env, actions).cpu(), env.batch.scenario
    simulation = by_hand(kind, seed=20) if device == "cpu" else lissajous_env.Simulation(scenario, 4, device, 20)
    table = action_table(env.batch.scenario)
    ends = 0
    for t, batch in enumerate(actions.numpy()):
        now = data[:, t]
        assert now["robot", "observation"].numpy().tobytes() == simulation.observation.numpy().tobytes()
        assert not now["done"].any()
        if kind == "with state":
            np.testing.assert_allclose(now["state"], state_rows(simulation), atol=1e-6)
        observation, reward, terminated, truncated = simulation.step(
            table[batch] if env.full_action_spec["robot", "action"].dtype == torch.int64 else batch
        )
        after = now["next"]
        assert after["robot", "observation"].numpy().tobytes() == observation.numpy().tobytes()
        np.testing.assert_array_equal(after["robot", "reward"][..., 0], reward.numpy())
        np.testing.assert_array_equal(after["robot", "terminated"][..., 0], terminated.numpy())
        np.testing.assert_array_equal(after["robot", "truncated"][..., 0], truncated.numpy())
        np.testing.assert_array_equal(after["robot", "done"][..., 0], terminated.numpy() | truncated.numpy())
        for k, name in enumerate(simulation.reward_term_names):
            term = after["robot", "info", f"reward_{name}"][..., 0]
            np.testing.assert_array_equal(term, simulation.reward_terms.numpy()[:, :, k])
        over = simulation.over
        np.testing.assert_array_equal(after["done"][:, 0], over)
        rows = dict(zip(np.flatnonzero(over), simulation.score(over), strict=True))
        for name in SCORES:
            expected = np.array([rows[w][name] if w in rows else np.nan for w in range(4)], dtype=np.float32)
            np.testing.assert_array_equal(after["score", name][:, 0], expected)
        ends += over.sum()
        if over.any():
            simulation.reset(over)
    assert ends >= 12


def test_a_world_that_ended_waits_for_its_reset():
    # Oracle: the contract of `Simulation`: it does not move with reward 0; the episode is scored once, as it ends.
    env = make()
    last = play(env, actions_of(env, 10))[:, -1]["next"]
    assert not last["score", "detected_fraction"].isnan().any()
    later = env.step(last.clone().set(("robot", "action"), torch.ones(4, 5, 2)))["next"]
    assert later["done"].all()
    assert torch.equal(later["robot", "observation"], last["robot", "observation"])
    assert (later["robot", "reward"] == 0).all()
    assert all(later["score", name].isnan().all() for name in SCORES)


def test_refusals():
    env = make()
    with pytest.raises(ValueError, match="_reset must be a mask of worlds"):
        env.reset(env.reset().set(("robot", "_reset"), torch.ones(4, 5, 1, dtype=torch.bool)))
    with pytest.raises(ValueError, match="seed must be a whole number"):
        env.set_seed(-1)
