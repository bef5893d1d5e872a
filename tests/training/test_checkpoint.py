"""Modified checkpoints: each is rejected with file, rule and value, or is a policy that can be played."""

import copy
import hashlib
import json

import numpy as np
import pytest
from safetensors.numpy import load_file
from safetensors.numpy import save as to_safetensors
from test_network import make_team

import lissajous_env
import training
from lissajous_env import Simulation
from training.learned import checkpoint
from training.learned.card import Card

HOSTILE = (
    None, True, -1, 3, 0.5, 10**400, 1e300, -1e300, "", "x", "../x", "/etc/passwd", "a\0b", "\ud800", "sweep", [], [[]],
    ["x"] * 3, {}, {"a": 1}, 99 * [0], float("nan"), float("inf"), json.loads(90 * "[" + 90 * "]"), [{"name": "x"}],
)  # fmt: skip
"""Values that no entry should have; some fit some."""


@pytest.fixture
def folder(tmp_path):
    """A checkpoint that was trained, with a curve and a best policy."""
    card = Card.of(lissajous_env.scenario("intruders"), settings={"algorithm": "ppo", "seed": 0})
    notes = {"curve": [{"steps": 10, "seconds": 0.5}], "rivals": {"sweep": None}}
    checkpoint.save(tmp_path / "x", make_team(), card, state={"a": np.arange(3)}, notes=notes)
    return tmp_path / "x"


def text_of(folder):
    """The description in a checkpoint, read by hand: 8 bytes with the length of the header, then the header in JSON."""
    data = (folder / checkpoint.FILE).read_bytes()
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    return json.loads(header["__metadata__"][checkpoint.DESCRIPTION])


def write(folder, text, arrays=None):
    """Replace the description of a checkpoint, and perhaps its arrays."""
    path = folder / checkpoint.FILE
    arrays = load_file(path) if arrays is None else arrays
    put(path, to_safetensors(arrays, {checkpoint.DESCRIPTION: json.dumps(text)}))


def put(path, data):
    # Not emptied first: a file that is, is flushed to the disk when it is closed.
    with open(path, "r+b") as file:
        file.write(data)
        file.truncate()


def play(folder):
    """Read all of a checkpoint and take a step with it; returns its action, which must be finite and in its range."""
    checkpoint.read_state(folder)
    policy = training.load(folder)
    action = policy.act(Simulation(policy.scenario).observation.numpy())
    assert np.isfinite(action).all()
    assert (np.abs(action) <= 1).all()
    return action


def refusal(folder):
    """Return the error of reading a checkpoint; None if it is accepted."""
    try:
        checkpoint.read(folder)
    except ValueError as error:
        return str(error)
    return None


def places(value, place=()):
    """Every place of a JSON value, as the names and numbers that lead to it."""
    yield place
    for name in value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield from places(value[name], (*place, name))


def changed(text, place, value=None, removed=False):
    """Copy of a JSON value with another one at a place, or none."""
    if not place:
        return value
    text = inner = copy.copy(text)
    for name in place[:-1]:
        inner[name] = copy.copy(inner[name])
        inner = inner[name]
    if removed:
        del inner[place[-1]]
    else:
        inner[place[-1]] = value
    return text


def test_any_entry_may_be_missing_or_wrong(folder):
    assert np.isfinite(play(folder)).all(), "as it is, it is a policy"
    text, refused = text_of(folder), 0
    for place in places(text):
        variants = [changed(text, place, value) for value in HOSTILE]
        variants += [changed(text, place, removed=True)] if place else []
        for variant in variants:
            write(folder, variant)
            said = refusal(folder)
            refused += said is not None
            assert said is None or (str(folder) in said and len(said) < 500), (place, said)
    assert refused > 500


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (("card", "action_size"), 2.0, "action_size must be a whole number of at least 1, got 2.0"),
        (("card", "inputs"), "abc", "inputs must be words, each once, got 'abc'"),
        (("card", "inputs"), ["a"], r"inputs and outputs must be \(1, 2\), as its card states, got \(0, 2\)"),
        (("card", "base"), "nothing", "base must be a .* policy, one that --import adds, or none, got 'nothing'"),
        (("card", "settings"), None, "settings must be a mapping, got None"),
        (("card", "scenario_fields"), [], r"scenario_fields must be a mapping, got \[\]"),
        (("card", "activation"), "gelu", "unexpected keyword argument 'activation'"),
        (("sha256",), {}, "it lacks state"),
        (("sha256", "state"), "x", "SHA-256 of its state must be [0-9a-f]+, got 'x'"),
        (("format",), 1, "format must be 2, got 1"),
        (("rivals",), json.loads(100 * "[" + 100 * "]"), "nest at most 100 levels"),
        ((), [], "list indices must be integers"),
    ],
)
def test_what_is_wrong_is_named_with_its_rule_and_value(folder, place, value, words):
    write(folder, changed(text_of(folder), place, value))
    with pytest.raises(ValueError, match=rf"checkpoint\.safetensors must be an undamaged checkpoint, but .*{words}"):
        play(folder)


def put_weights(folder, arrays):
    """Replace the weights, as one who keeps the books would."""
    arrays = {f"weights.{name}": array for name, array in arrays.items()}
    write(folder, text_of(folder) | {"sha256": {"weights": digest_of(arrays)}}, arrays)


def digest_of(arrays):
    """SHA-256 of names, types, shapes and bytes, all in a row."""
    rows = [f"{name.partition('.')[2]} {array.dtype} {array.shape}".encode() + array.tobytes()
            for name, array in sorted(arrays.items())]  # fmt: skip
    return hashlib.sha256(b"".join(rows)).hexdigest()


@pytest.mark.parametrize("dtype", [np.float64, np.float16, np.int64, np.int8, bool, np.nan, np.inf, -np.inf])
def test_weights_of_other_numbers_and_those_that_are_not_finite_are_refused(folder, dtype):
    kind, words = (np.float32, "must be finite") if isinstance(dtype, float) else (dtype, "must be float32, got")
    arrays = {name: array.astype(kind) for name, array in make_team().arrays.items()}
    arrays["last.bias"][0] = dtype if isinstance(dtype, float) else 1
    put_weights(folder, arrays)
    with pytest.raises(ValueError, match=rf"checkpoint\.safetensors must be an undamaged checkpoint, but \S+ {words}"):
        checkpoint.read(folder)


@pytest.mark.parametrize("dtype", ["BF16", "F8_E4M3"])
def test_numbers_that_numpy_lacks_are_refused(folder, dtype):
    path, width = folder / checkpoint.FILE, {"BF16": 2, "F8_E4M3": 1}[dtype]
    entry = {"dtype": dtype, "shape": [3], "data_offsets": [0, 3 * width]}
    header = {"__metadata__": {checkpoint.DESCRIPTION: json.dumps(text_of(folder))}, "weights.x": entry}
    head = json.dumps(header).encode()
    put(path, len(head).to_bytes(8, "little") + head + 3 * width * b"\x01")
    with pytest.raises(ValueError, match=r"checkpoint\.safetensors must be an undamaged checkpoint, but "):
        checkpoint.read(folder)


@pytest.mark.parametrize(
    "data",
    [
        b"", b"\0" * 8, (2**63).to_bytes(8, "little"), (2**31).to_bytes(8, "little") + b"{}",
        (100_000).to_bytes(8, "little") + 100_000 * b"[", (2).to_bytes(8, "little") + b"{}",
        (4).to_bytes(8, "little") + b"null", 64 * b"\xff",
    ],
)  # fmt: skip
def test_a_file_that_is_no_checkpoint_is_refused(folder, data):
    put(folder / checkpoint.FILE, data)
    with pytest.raises(ValueError, match=r"checkpoint\.safetensors must be an undamaged checkpoint, but "):
        checkpoint.read(folder)


def test_a_checkpoint_must_be_a_plain_file_of_the_folder(folder):
    path = folder / checkpoint.FILE
    path.rename(folder.parent / "outside")
    path.symlink_to(folder.parent / "outside")
    with pytest.raises(ValueError, match=r"checkpoint\.safetensors must be a plain file, got a link"):
        checkpoint.read(folder)
    path.unlink()
    path.mkdir()
    with pytest.raises(ValueError, match=r"checkpoint must be a folder with checkpoint\.safetensors, got"):
        checkpoint.read(folder)
