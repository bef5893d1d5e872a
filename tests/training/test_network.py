"""Networks and checkpoints: plain arrays, written such that kills and damage are detected."""

import itertools
import sys

import numpy as np
import pytest

import lissajous_env
from lissajous_env.storage.folder import LIST
from training.learned import checkpoint
from training.learned.card import Card
from training.learned.networks import RogueNetwork, TeamNetwork
from training.learned.perception import OWN, TOKEN


def make_network(sizes=(42, 8, 2), seed=0):
    draw = np.random.default_rng(seed)
    weights = {f"{k}.weight": draw.normal(size=(b, a)) for k, (a, b) in enumerate(itertools.pairwise(sizes))}
    weights |= {f"{k}.bias": draw.normal(size=size) for k, size in enumerate(sizes[1:])}
    return RogueNetwork({name: array.astype(np.float32) for name, array in weights.items()})


def make_team(actions=2, seed=0):
    """A network of a team, of random weights."""
    draw = np.random.default_rng(seed)
    sizes = {"own": (8, len(OWN)), "token": (4, len(TOKEN)), "trunk": (6, 12), "last": (6, 6), "action": (actions, 6)}
    weights = {f"{name}.weight": 0.3 * draw.normal(size=size) for name, size in sizes.items()}
    weights |= {f"{name}.bias": draw.normal(size=size[0]) for name, size in sizes.items()}
    return TeamNetwork({name: array.astype(np.float32) for name, array in weights.items()})


def ones(*shape, value=1):
    return np.full(shape, value, np.float32)


@pytest.mark.parametrize("sizes", [(5, 7, 4, 2), (1, 1), (45, 64, 64, 2)])
def test_a_network_is_the_formula(sizes):
    # Oracle: the formula in float64, one row at a time; a world has the same bits alone and in a batch.
    network = make_network(sizes)
    rows = np.random.default_rng(1).normal(size=(9, 4, sizes[0])).astype(np.float32)
    outputs = network(rows)
    assert outputs.dtype == np.float32
    for row, got in zip(rows.reshape(-1, sizes[0]), outputs.reshape(-1, sizes[-1]), strict=True):
        value, scale = row.astype(float), 1.0
        for k in range(len(sizes) - 1):
            weight, bias = network.arrays[f"{k}.weight"], network.arrays[f"{k}.bias"]
            scale = max(scale, np.abs(weight.astype(float)).sum(axis=1).max() * np.abs(value).max())
            value = weight.astype(float) @ value + bias
            value = np.maximum(value, 0) if k < len(sizes) - 2 else value
        assert got == pytest.approx(value, abs=2e-6 * scale)
    for w in range(9):
        np.testing.assert_array_equal(network(rows[w : w + 1])[0], outputs[w])
    assert (network.inputs, network.outputs) == (sizes[0], sizes[-1])


def test_the_arrays_of_a_network_are_its_own():
    weights = ones(2, 3)
    network = RogueNetwork({"0.weight": weights, "0.bias": ones(2)})
    weights[:] = 5.0
    assert (network.arrays["0.weight"] == 1).all()
    with pytest.raises(ValueError, match="read-only"):
        network.arrays["0.weight"][:] = 5.0


@pytest.mark.parametrize(
    ("weights", "biases", "words"),
    [
        ([ones(2, 3), ones(1, 4)], [ones(2), ones(1)], r"1.weight must have shape \(1, 2\)"),
        ([ones(2, 3)], [ones(3)], r"0.bias must have shape \(2,\), got \(3,\)"),
        ([ones(2, 3, value=np.nan)], [ones(2)], "0.weight must be finite"),
        ([np.ones((2, 3))], [ones(2)], "0.weight must be float32, got 'float64'"),
        ([ones(2, 3)], [ones(2, value=np.inf)], "0.bias must be finite"),
        ([ones(0, 3)], [ones(0)], r"0.weight must have shape \(outputs, inputs\), both at least 1, got \(0, 3"),
        ([ones(2, 0)], [ones(2)], "both at least 1"),
        ([ones(3)], [ones(3)], "0.weight must have shape"),
        ([np.array([["a", "b"]])], [ones(1)], "0.weight must be float32"),
        ([ones(1, 2)], [], "arrays must be 0.bias, 0.weight, got '0.weight'"),
        ([], [], "at least one"),
    ],
)
def test_layers_that_do_not_fit_are_refused(weights, biases, words):
    arrays = {f"{k}.weight": array for k, array in enumerate(weights)}
    with pytest.raises(ValueError, match=words):
        RogueNetwork(arrays | {f"{k}.bias": array for k, array in enumerate(biases)})
    with pytest.raises(ValueError, match="layers must be 0, 1 and so on, at least one, got 1"):
        RogueNetwork({"1.weight": ones(1, 2), "1.bias": ones(1)})


@pytest.mark.parametrize("wrong", ["trunk", "memory.input"], ids=["missing", "unknown"])
def test_a_layer_of_a_team_that_is_missing_or_unknown_is_refused(wrong):
    names = {"own", "token", "trunk", "last", "action"} ^ {wrong}
    with pytest.raises(ValueError, match=r"layers must be action, last, own, token, trunk, and perhaps query, got '"):
        TeamNetwork({f"{name}.weight": ones(2, 2) for name in names})


def test_a_checkpoint_gives_back_what_was_saved_last(tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "torch", raising=False)  # which, without training, may not be installed
    network, card = make_team(), Card.of(lissajous_env.scenario("intruders"), settings={"seed": 3})
    state = {"a": np.arange(5), "b.c": np.zeros((2, 3), dtype=np.float32), "flags": np.array([True, False])}
    checkpoint.save(tmp_path / "x", make_team(seed=1), card, state={"a": np.arange(2)})
    checkpoint.save(tmp_path / "x", network, card, state=state, notes={"counters": {"steps": 7}})
    assert sorted(path.name for path in (tmp_path / "x").iterdir()) == [LIST, checkpoint.FILE]
    read, again, description = checkpoint.read(tmp_path / "x")
    assert again == card
    assert description["counters"] == {"steps": 7}
    assert {"lissajous-env", "torch"} & set(description["versions"]) == {"lissajous-env"}
    for name, saved in network.arrays.items():
        loaded = read.arrays[name]
        assert (saved == loaded).all()
        assert loaded.dtype == np.float32
    arrays = checkpoint.read_state(tmp_path / "x")
    assert {name: array.tolist() for name, array in arrays.items()} == {k: v.tolist() for k, v in state.items()}


def test_damage_is_named(tmp_path):
    checkpoint.save(tmp_path, make_team(), Card.of(lissajous_env.scenario("intruders")))
    path = tmp_path / checkpoint.FILE
    whole = path.read_bytes()
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    with pytest.raises(ValueError, match=rf"{path.name} must be .*, but SHA-256 of its weights must be [0-9a-f]+, got"):
        checkpoint.read(tmp_path)
    path.write_bytes(whole[:-99])
    with pytest.raises(ValueError, match=f"{path.name} must be an undamaged checkpoint, but"):
        checkpoint.read(tmp_path)
    path.write_bytes(whole)
    with pytest.raises(ValueError, match=f"{path.name} must be an undamaged checkpoint, but it lacks state"):
        checkpoint.read_state(tmp_path)
    with pytest.raises(ValueError, match="must be a folder with"):
        checkpoint.read(tmp_path / "nowhere")


def test_a_policy_is_for_robots_of_its_kind():
    card = Card.of(lissajous_env.scenario("intruders"))
    card.check(lissajous_env.scenario("intruders", **{"sensing.targets_seen": 3, "messages.size": 2}))
    with pytest.raises(ValueError, match=r"must drive robots of kind car, got failure, with robots of kind curve"):
        card.check(lissajous_env.scenario("failure"))
    talking = lissajous_env.scenario("intruders", **{"messages.size": 2})
    with pytest.raises(ValueError, match="action_size must be 2 for intruders, got 4"):
        Card.of(talking).check(lissajous_env.scenario("intruders"))
