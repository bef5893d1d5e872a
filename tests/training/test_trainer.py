"""Training of teams: it begins from a rule, learns, keeps to its limit of collisions, and resumes from any state."""

import dataclasses
import io
import itertools

import learned
import numpy as np
import pytest
from rich.console import Console

import baselines
import lissajous_env
import training
from lissajous_env.world.observation import layout
from training.learned import checkpoint
from training.learned.perception import OWN, TOKEN, Perception, actions_of, axes_of, base_action, perceive

pytest.importorskip("torch")

import torch

from training.settings import TrainingSettings
from training.trainer import TeamModule, Training, train
from training.validation import limit_of, rating_of
from training.worlds import TRUTH, Worlds, true_view

QUIET, NOTHING = Console(quiet=True), {"sensing.robots_seen": 0, "sensing.targets_seen": 0}
SMALL = {
    "worlds": 8, "rollout": 8, "minibatch": 128, "hidden": 16, "features": 8, "episodes": 2, "steps": 640,
    "evaluate_every": 320, "threads": 1, "overrides": {"task.duration": 16.0},
}  # fmt: skip


def small(tmp_path, **changes):
    return TrainingSettings(**SMALL | {"out": tmp_path / "run"} | changes)


def arrays_of(folder):
    return np.concatenate([array.ravel() for _, array in sorted(checkpoint.read(folder)[0].arrays.items())])


@pytest.mark.parametrize(("changes", "base"), [
    ({}, "greedy-herd"),
    ({"scenario": "intercept", "heads": 0, "overrides": {"task.duration": 9.0, "messages.size": 1}}, "divided-pursuit"),
    ({"scenario": "hotspots"}, "index-learned"),
    ({"scenario": "experiment", "overrides": {"task.duration": 2.0, "messages.size": 1}}, "arc-mpcc"),
    ({"scenario": "evaders", "overrides": {"task.duration": 2.0, "robot.kind": "differential"}}, "partition-repair"),
    ({"scenario": "failure", "overrides": NOTHING | {"task.duration": 2.0}}, "kuramoto"),
    ({"scenario": "watch-v1", "groups": 2, "episodes": 16}, "greedy-herd"),
    ({"base": "none", "critic": "own"}, "greedy-herd"),
], ids=lambda value: value.get("scenario", "watch") if isinstance(value, dict) else value)  # fmt: skip
def test_a_training_leaves_a_policy_that_is_played(tmp_path, changes, base):
    history = train(small(tmp_path, **changes), Console(file=(said := io.StringIO())))
    assert ("only the critic learns" in said.getvalue()) is ("base" not in changes), "in 25 rollouts of a rule"
    assert ("does not read the entries" in said.getvalue()) is ("messages.size" in changes.get("overrides", {}))
    assert history["rival"] == base
    assert history["curve"][0]["steps"] == 0
    assert history["curve"][-1]["steps"] >= 640
    limit = limit_of(None, history["rivals"])
    assert rating_of(history["best"], limit) >= rating_of(history["curve"][0], limit), "the rule is the first candidate"
    policy = training.load(tmp_path / "run" / "best", num_worlds=2)
    rows = lissajous_env.evaluate(policy, policy.scenario, seeds=[1, 2])
    assert all(np.isfinite(row["return_mean"]) for row in rows)
    assert train(small(tmp_path, **changes, steps=1200), QUIET)["curve"][-1]["steps"] >= 1200, "it goes on"


@pytest.mark.parametrize("rule", [None, "partition-repair"])
def test_a_training_without_a_rule_that_can_play_is_compared_with_its_beginning(tmp_path, monkeypatch, rule):
    monkeypatch.setattr(TrainingSettings, "rival", rule)
    too_low = {"curve.half_height": 0.4, "robot.radius": 0.03, "targets.arrival_rate": 9.0, "task.duration": 4.0}
    changes = {"scenario": "intruders", "base": "none", "learning_rate": 0.01, "overrides": too_low}
    first, *others = train(small(tmp_path, **changes), QUIET)["curve"]  # of detection times, lower is better
    assert [point["worth"] for point in others] == [pytest.approx(first["score"] / point["score"]) for point in others]
    assert others[-1]["worth"] != 1


def test_a_training_draws_from_the_split_train_and_is_validated_on_the_first_of_validation(tmp_path):
    settings, space = small(tmp_path, scenario="watch-v1", groups=4), lissajous_env.scenario_space("watch-v1")
    validated = [scenario.name for scenario in settings.make_validation_scenarios()]
    assert validated == [scenario.name for scenario in itertools.islice(space.scenarios("validation"), 16)]
    worlds = Worlds(settings, 8, 0)
    played = {simulation.scenario.name for simulation in worlds.batch.simulations}
    assert {space.split_of(int(name.rpartition("-")[2])) for name in played} == {"train"}
    worlds.begin(np.arange(8) % 2 == 0)  # half of each group alone, as after the loss of all robots
    for _ in range(worlds.steps):
        worlds.begin(worlds.step(np.zeros((worlds.count, 2))).over)
    assert not played & {simulation.scenario.name for simulation in worlds.batch.simulations}, "groups end together"
    # A grid that the reward uses is there, as without a space.
    fields = {"task.reward_idleness": -0.1, "task.grid": (10, 8)}
    rewarded = dataclasses.replace(settings, overrides=fields).make_validation_scenarios()
    assert {scenario.task.grid for scenario in rewarded} == {(10, 8)}


def test_ppo_learns_a_problem_of_one_step(tmp_path):
    # One point on the curve without a target: its reward is minus the square of its action, so it does best not to act.
    overrides = {
        "robot.count": 1, "targets.count": 0, "targets.arrival_rate": 0.0, "faults.schedule": (),
        "task.reward_effort": -1.0, "task.duration": 2.0,
    }  # fmt: skip
    settings = small(
        tmp_path, scenario="failure", worlds=64, rollout=20, minibatch=320, gamma=0.0, noise=0.6,
        noise_end=0.3, correlation=0.0, learning_rate=1e-2, steps=60_000, overrides=overrides,
    )  # fmt: skip
    state = Training(settings)
    state.actor.corrects = False
    state.numbers["rollouts"] = 100.0
    with torch.no_grad():
        state.actor.action.bias.fill_(0.8)
    for _ in range(30):
        state.update(state.collect())
    rows = [torch.from_numpy(part) for part in state.worlds.perception()]
    assert state.actor(rows).abs().max() < 0.15


def test_advantages_are_sums_of_rewards_that_end_with_the_episode(tmp_path):
    # Oracle: by hand. Rewards of 1, gamma 0.5, lambda 1, values of 0: 1.75, 1.5, 1 until the end of an episode.
    state = Training(small(tmp_path, gamma=0.5, gae_lambda=1.0))
    step = state.worlds.step(np.zeros((state.worlds.count, 2)))
    one = np.ones(state.worlds.count)
    steps = [(one, step._replace(over=np.full(8, k == 2), ended=0 * one)) for k in range(4)]
    advantages = state._advantages(steps, np.zeros((5, state.worlds.count), np.float32))
    assert advantages[:, 0].tolist() == pytest.approx([1.75, 1.5, 1.0, 1.0])
    removed = [(one, step._replace(over=np.zeros(8, bool), ended=one * (k == 1))) for k, (_, step) in enumerate(steps)]
    values = np.full((5, state.worlds.count), 4.0, np.float32)
    advantages = state._advantages(removed, values)
    wanted = [1 + 0.5 * 4 - 4 + 0.5 * (1 - 4), 1 - 4, 1 + 1 / 2 + 1 - 4, 1 + 2 - 4]
    assert advantages[:, 0].tolist() == pytest.approx(wanted)


def test_the_actor_stops_where_it_has_moved_too_far(tmp_path):
    settings = small(tmp_path, learning_rate=0.05, epochs=8)
    moved = {}
    for divergence in (1e-6, 1e6):
        state = Training(dataclasses.replace(settings, divergence=divergence))
        state.numbers["rollouts"] = 100.0
        before = torch.nn.utils.parameters_to_vector(state.actor.parameters()).detach()
        state.update(state.collect())
        after = torch.nn.utils.parameters_to_vector(state.actor.parameters())
        moved[divergence] = (after - before).abs().max().item()
    # The first step of Adam is the learning rate at most, and the only one.
    assert 0 < moved[1e-6] < 1.001 * settings.learning_rate < moved[1e6]


def test_corrections_begin_at_zero_and_without_an_advantage_become_smaller(tmp_path, monkeypatch):
    monkeypatch.setattr("training.trainer._BOUND", 0.0)
    state = Training(small(tmp_path))
    assert not state.actor.action.weight.any()
    state.numbers["rollouts"] = 100.0
    with torch.no_grad():
        state.actor.action.bias.fill_(0.3)
    rollout = state.collect()
    state.update(rollout._replace(advantages=torch.zeros_like(rollout.advantages)))
    assert (state.actor.action.bias < 0.3).all()


def test_a_training_without_a_base_learns_at_once_from_robots_in_their_worlds_alone(tmp_path):
    # Law: numbers of rows without such a robot change neither the weights nor the diagnostics.
    results = []
    for number in (0.0, 1e3):
        state = Training(small(tmp_path, base="none"))
        before = state.actor.action.weight.detach().clone()
        rollout = state.collect()
        assert not rollout.perception[0][..., -2:].any(), "there is no wish"
        rollout.acted[:, ::3] = 0
        rollout.advantages[:, ::3] = rollout.returns[:, ::3] = number
        results.append((state.update(rollout), state.critic.action.weight.tolist(), state.actor.action.weight.tolist()))
        assert (state.actor.action.weight != before).any()
    assert results[0] == results[1]


def test_a_critic_of_its_own_reads_what_the_robot_perceives(tmp_path):
    # The truth of the critic is the true state, which has more tokens than a robot perceives from what it sees.
    own, central = (Training(small(tmp_path, critic=critic)).collect() for critic in ("own", "central"))
    assert all(torch.equal(*pair) for pair in zip(own.critic_inputs, own.perception[1:], strict=True))
    assert central.critic_inputs[1].sum() > own.critic_inputs[1].sum()


def test_collisions_cost_more_where_there_are_too_many(tmp_path):
    settings = small(tmp_path)
    costs = {}
    for limit in (0.0, 1e5):
        state = Training(settings)
        state.numbers["collided"] = 3.0
        state.update(state.collect(), limit)
        costs[limit] = state.numbers["penalty"]
    assert costs[1e5] < settings.penalty < costs[0.0]
    assert limit_of(None, [{"score": 1.0, "collisions": 2.0, "worth": 1.0}]) == pytest.approx(1.6)
    careful, careless = ({"worth": 1.1, "collisions": hits} for hits in (0.5, 2.0))
    assert rating_of(careful, 0.5) == 1.1
    assert rating_of(careless, 0.5) < rating_of({"worth": 0.9, "collisions": 0.1}, 0.5)


def test_trainings_that_differ_only_in_their_seeds_are_a_row_of_the_ablations(tmp_path, monkeypatch):
    # Oracle: a network whose critic alone has learned plays its rule.
    monkeypatch.setattr(learned, "SEEDS", range(10_000, 10_002))
    folders = [tmp_path / name for name in ("a", "b", "c")]
    for seed, (folder, base) in enumerate(zip(folders, (None, None, "none"), strict=True)):
        train(small(tmp_path, out=folder, seed=seed, steps=1, base=base), QUIET)
    table = learned.on_ablations([str(folder) for folder in folders])
    rows = [dict(zip(table["columns"], row, strict=True)) for row in table["rows"]]
    assert [row["trainings"] for row in rows] == ["2", "1"]
    assert ["--base none" in row["options"] for row in rows] == [False, True]
    assert float(rows[0]["over `greedy-herd`"].split()[0]) == pytest.approx(1, abs=0.05)
    assert all(row["options"].endswith("--set task.duration=16.0`") for row in rows)
    monkeypatch.setattr(learned, "CURVES", tmp_path / "curves.jsonl")
    learned.on_curves([str(folder) for folder in folders[:2]], stores=True)
    assert [row[3] for row in learned.on_curves([str(folders[2])], stores=False)["rows"]] == ["2", "1"]


@pytest.mark.parametrize("changes", [{}, {"base": "none", "critic": "own"}], ids=["base", "none"])
def test_a_training_that_was_interrupted_ends_with_the_same_weights(tmp_path, monkeypatch, changes):
    settings = small(tmp_path, **changes)
    train(settings, QUIET)
    cut = dataclasses.replace(settings, out=tmp_path / "cut")
    calls, update = [], Training.update

    def interrupted(state: Training, *arguments):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return update(state, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(Training, "update", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train(cut, QUIET)
    seen: list = []
    history = train(cut, QUIET, seen.append)
    assert (arrays_of(tmp_path / "cut") == arrays_of(tmp_path / "run")).all()
    states = [checkpoint.read_state(run) for run in (tmp_path / "cut", tmp_path / "run")]
    assert all((array == states[1][name]).all() for name, array in states[0].items())
    assert [point["steps"] for point in seen] == [point["steps"] for point in history["curve"]][2:]
    # A finished training is left alone.
    assert train(cut, QUIET, seen.append) == history
    with pytest.raises(ValueError, match=r"out must be an empty folder or .* gamma = 0.985 there, 0.5 here"):
        train(dataclasses.replace(cut, gamma=0.5), QUIET)


def test_the_network_without_torch_is_that_of_the_training(tmp_path):
    # Oracle: the same module in float32.
    for heads in (3, 0):
        module = TeamModule(small(tmp_path), len(TOKEN), 2, heads)
        draw = np.random.default_rng(0)
        own, tokens = draw.normal(size=(2, 3, len(OWN))), draw.normal(size=(2, 3, 5, len(TOKEN)))
        present = (draw.random((2, 3, 5)) < 0.6).astype(np.float32)
        present[0, 0] = 0
        seen = Perception(own.astype(np.float32), tokens.astype(np.float32) * present[..., None], present)
        rows = [torch.from_numpy(part) for part in seen]
        with torch.no_grad(), torch.autocast("cpu", enabled=False):
            wanted = TeamModule.forward.__wrapped__(module, rows)
            module.corrects = True
            added = TeamModule.forward.__wrapped__(module, rows)
        assert module.network()(seen) == pytest.approx(wanted.numpy(), abs=1e-5)
        assert (added - wanted).numpy() == pytest.approx(seen.own[..., -2:], abs=1e-5)


@pytest.mark.parametrize(("count", "read"), [(10, 10), (200, 16)])
def test_what_the_critic_reads_is_the_true_state(tmp_path, count, read):
    # Oracle: positions of robots and targets, of which a critic reads 16.
    worlds = Worlds(small(tmp_path, overrides={"targets.count": count}), 2, 0)
    for _ in range(3):
        worlds.step(np.full((worlds.count, 2), 0.5))
    simulation = worlds.batch.simulation
    simulation.robots.position.assign(simulation.robots.position.numpy() * [0.05, 0.05, 1])
    tokens, present, own, near = true_view(simulation)
    robots, targets = simulation.robots.position.numpy()[..., :2], simulation.targets.position.numpy()
    far = np.linalg.norm(targets[:, None] - robots[:, :, None], axis=-1) / 4.0
    assert tokens[:, :, :read, 4] == pytest.approx((far / (1 + far))[..., :read], abs=1e-5)
    seen = far < 1
    assert (own == (seen & (seen.sum(axis=1, keepdims=True) == 1)).sum(axis=2)).all()
    assert (present.sum(axis=-1) == read + 4).all()
    gap = np.linalg.norm(robots[:, None] - robots[:, :, None], axis=-1) / 0.8 - 1 + 9 * np.eye(5)
    assert near == pytest.approx((1 - gap).clip(0, 1).sum(axis=-1), abs=1e-3)
    assert near.max() > 0
    observers = tokens[..., :read, TRUTH.index("observers")][seen[..., :read]]
    assert observers.sum() == sum(min(n - 1, 2) * n for n in seen[..., :read].sum(axis=1).ravel() if n)


@pytest.mark.parametrize(("changes", "words"), [
    ({"collisions": -1.0}, "training.collisions must be from 0"),
    ({"rollout": 1}, "training.rollout must be a whole number from 2"),
    ({"base": "sweep"}, "sweep"),
    ({"base": "index"}, r"base must be none or a policy .* \(--base\), got index: targets.arrival_rate must be"),
    ({"scenario": "watch-v1", "groups": 3}, r"training.worlds must be a multiple of groups \(3\), got 8"),
    ({"scenario": "watch-v1:test"}, "scenario must be the name of a space without a split"),
])  # fmt: skip
def test_bad_settings_are_refused_with_name_rule_and_value(tmp_path, changes, words):
    with pytest.raises(ValueError, match=words):
        train(small(tmp_path, **changes))
    assert not list(tmp_path.iterdir())


def test_cars_rest_where_a_network_wishes_a_slow_velocity():
    scenario = lissajous_env.scenario("watch").resolve()
    alone = np.zeros((1, 3, len(layout(scenario).names)), np.float32)
    wish = np.array([[[0.2, -0.1], [0.26, 0.0], [0.6, -0.8]]], np.float32)
    assert actions_of(wish, alone, scenario) == pytest.approx(wish * np.array([[0], [1], [1]]))


@pytest.mark.parametrize("axis", ["x", "y"])
def test_mirror_images_of_a_team_are_perceived_alike(axis):
    simulation = lissajous_env.Simulation(lissajous_env.scenario("watch", **{"sensing.cells_seen": (2, 2)}), 4)
    simulation.reset(seeds=np.arange(4))
    base = baselines.make("greedy-cover", simulation.scenario, 4)
    for _ in range(30):
        simulation.step(base.act(simulation.observation))
    row, scenario = simulation.observation.numpy(), simulation.scenario
    mirrored = {axis, {"x": "cos", "y": "sin"}[axis] + "_heading"}, (f"_{axis}", f"_{axis}_velocity")
    names = layout(scenario).names
    image = row * np.array([-1 if name in mirrored[0] or name.endswith(mirrored[1]) else 1 for name in names])
    image[..., [name.startswith("cell_") for name in names]] = 0.5  # which no network reads
    wish, signs = base_action(base, row), np.where(np.array(["x", "y"]) == axis, -1, 1)
    one, other = perceive(row, scenario, wish), perceive(image.astype(np.float32), scenario, wish * signs)
    assert (axes_of(image, scenario) == signs * axes_of(row, scenario)).all()
    assert all(np.abs(a - b).max() < 1e-5 for a, b in zip(one, other, strict=True))
    assert one.tokens[..., TOKEN.index("track")].sum() > 50


def test_a_base_begins_anew_with_its_world(tmp_path):
    # Oracle: a base that is made for the new episode, in the world that begins it; the other world goes on.
    worlds = Worlds(small(tmp_path), 2, 0)
    for _ in range(3):
        worlds.step(np.zeros((worlds.count, 2)))
        worlds.begin(np.zeros(2, bool))
    assert worlds._bases[0].patrol._steps.tolist() == [4, 4]
    worlds.step(np.zeros((worlds.count, 2)))
    worlds.begin(np.array([True, False]))
    assert worlds._bases[0].patrol._steps.tolist() == [1, 5]
    scenario, observation = worlds.batch.scenario, worlds.batch.simulation.observation.numpy()
    wish = base_action(baselines.make("greedy-herd", scenario, 2), observation) * axes_of(observation, scenario)
    assert (worlds.perception()[0][:5, -2:] == wish[0]).all()
