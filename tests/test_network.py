"""Networks and checkpoints: plain arrays, written so that a kill or a damaged file is noticed."""

import itertools
import json

import numpy as np
import pytest

import lissajous_env
from lissajous_env.folder import Folder
from training import checkpoint
from training.checkpoint import Card
from training.network import Network


def make_network(sizes=(42, 8, 2), activation="relu", seed=0):
    draw = np.random.default_rng(seed)
    weights = tuple(draw.normal(size=(b, a)).astype(np.float32) for a, b in itertools.pairwise(sizes))
    return Network(weights, tuple(draw.normal(size=len(w)).astype(np.float32) for w in weights), activation)


@pytest.mark.parametrize("activation", ["relu", "tanh"])
def test_a_network_is_the_formula(activation):
    # Oracle: the formula in float64, one row at a time.
    network = make_network((5, 7, 4, 2), activation)
    squash = {"relu": lambda v: np.where(v > 0, v, 0), "tanh": np.tanh}[activation]
    rows = np.random.default_rng(1).normal(size=(9, 5)).astype(np.float32)
    for row, got in zip(rows, network(rows), strict=True):
        value = row.astype(float)
        for k, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
            value = weight.astype(float) @ value + bias
            value = squash(value) if k < 2 else value
        assert got == pytest.approx(value, rel=1e-5, abs=1e-5)
    assert (network.inputs, network.hidden, network.outputs) == (5, (7, 4), 2)


def test_a_network_leaves_its_input_as_it_was():
    network, rows = make_network((3, 2)), np.ones((4, 3), dtype=np.float32)
    network(rows)
    assert (rows == 1).all()


@pytest.mark.parametrize("activation", ["relu", "tanh"])
def test_torch_and_numpy_agree(activation):
    torch = pytest.importorskip("torch")
    network = make_network((42, 64, 64, 2), activation)
    rows = np.random.default_rng(2).uniform(-1, 1, (1000, 42)).astype(np.float32)
    by_torch = network.to_torch("cpu")(torch.from_numpy(rows)).numpy()
    scale = np.abs(by_torch).max()
    assert np.abs(network(rows) - by_torch).max() < 1e-6 * scale


@pytest.mark.parametrize(
    ("weights", "biases", "words"),
    [
        ([np.ones((2, 3)), np.ones((1, 4))], [np.ones(2), np.ones(1)], "layer must take the 2 outputs"),
        ([np.ones((2, 3))], [np.ones(3)], "bias must have shape"),
        ([np.full((2, 3), np.nan)], [np.ones(2)], "must be finite"),
        ([], [], "at least one"),
    ],
)
def test_layers_that_do_not_fit_are_refused(weights, biases, words):
    with pytest.raises(ValueError, match=words):
        Network(tuple(weights), tuple(biases), "relu")


def test_a_checkpoint_gives_back_what_was_saved(tmp_path):
    network, card = make_network(), Card.of(lissajous_env.scenario("intruders"), settings={"seed": 3})
    state = {"a": np.arange(5), "b.c": np.zeros((2, 3), dtype=np.float32), "flags": np.array([True, False])}
    checkpoint.save(tmp_path / "x", network, card, state=state, notes={"counters": {"steps": 7}})
    read, again, text = checkpoint.read(tmp_path / "x")
    assert again == card
    assert text["counters"] == {"steps": 7}
    assert text["versions"]["lissajous-env"]
    for ours, theirs in zip((*network.weights, *network.biases), (*read.weights, *read.biases), strict=True):
        assert (ours == theirs).all()
        assert theirs.dtype == np.float32
    kept = checkpoint.read_state(tmp_path / "x", text)
    assert {name: array.tolist() for name, array in kept.items()} == {k: v.tolist() for k, v in state.items()}


def test_a_new_checkpoint_takes_the_place_of_the_old_one(tmp_path):
    card = Card.of(lissajous_env.scenario("intruders"))
    for seed in range(3):
        checkpoint.save(tmp_path, make_network(seed=seed), card, state={"seed": np.array(seed)})
    assert len(list(tmp_path.iterdir())) == 4
    network, _, text = checkpoint.read(tmp_path)
    assert (network.weights[0] == make_network(seed=2).weights[0]).all()
    assert checkpoint.read_state(tmp_path, text)["seed"] == 2


def test_a_kill_between_the_files_leaves_the_checkpoint_before(tmp_path, monkeypatch):
    # Oracle: the commit point is the JSON file. Everything before it may have been written, and nothing is lost.
    card = Card.of(lissajous_env.scenario("intruders"))
    checkpoint.save(tmp_path, make_network(seed=0), card, state={"seed": np.array(0)})

    write = Folder.write

    def killed(folder, name, data):
        if name == checkpoint.FILE:
            raise KeyboardInterrupt
        write(folder, name, data)

    monkeypatch.setattr(Folder, "write", killed)
    with pytest.raises(KeyboardInterrupt):
        checkpoint.save(tmp_path, make_network(seed=1), card, state={"seed": np.array(1)})
    network, _, text = checkpoint.read(tmp_path)
    assert (network.weights[0] == make_network(seed=0).weights[0]).all()
    assert checkpoint.read_state(tmp_path, text)["seed"] == 0


def test_damage_is_named(tmp_path):
    checkpoint.save(tmp_path, make_network(), Card.of(lissajous_env.scenario("intruders")))
    (weights,) = tmp_path.glob("weights-*")
    whole = weights.read_bytes()
    weights.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    with pytest.raises(ValueError, match=rf"{weights.name} is damaged: its SHA-256 must be [0-9a-f]+, got"):
        checkpoint.read(tmp_path)
    weights.unlink()
    with pytest.raises(ValueError, match=f"{weights.name} is missing"):
        checkpoint.read(tmp_path)
    weights.write_bytes(whole)
    path = tmp_path / checkpoint.FILE
    text = path.read_text()
    for broken in (
        text[: len(text) // 2],
        text.replace('"format": 1', '"format": 2'),
        "{}",
        text.replace("inputs", "i"),
    ):
        path.write_text(broken)
        with pytest.raises(ValueError, match=checkpoint.FILE):
            checkpoint.read(tmp_path)
    with pytest.raises(ValueError, match="must be a folder that holds"):
        checkpoint.read(tmp_path / "nowhere")


def test_a_checkpoint_names_no_file_outside_its_folder(tmp_path):
    checkpoint.save(tmp_path / "x", make_network(), Card.of(lissajous_env.scenario("intruders")))
    path = tmp_path / "x" / checkpoint.FILE
    text = json.loads(path.read_text())
    (tmp_path / "outside").write_bytes((tmp_path / "x" / text["files"]["weights"]["name"]).read_bytes())
    text["files"]["weights"]["name"] = "../outside"
    path.write_text(json.dumps(text))
    with pytest.raises(ValueError, match=r"name of weights must be weights-HASH.safetensors, got '\.\./outside'"):
        checkpoint.read(tmp_path / "x")


def test_a_layout_that_does_not_fit_is_refused_in_words():
    card = Card.of(lissajous_env.scenario("intruders"))
    narrow = lissajous_env.scenario("intruders", **{"sensing.targets_seen": 3})
    with pytest.raises(ValueError, match=r"lists 2 robots and 3 targets and lacks target_3_present, target_3_x"):
        card.columns(narrow)
    with pytest.raises(ValueError, match=r"must drive robots of kind car, got failure, whose robots are of kind curve"):
        card.columns(lissajous_env.scenario("failure"))
    wide = lissajous_env.scenario("intruders", **{"sensing.robots_seen": 4})
    names = lissajous_env.Simulation(wide).layout.names
    assert [names[k] for k in card.columns(wide)] == list(card.inputs), "entries are found by name, wherever they stand"
