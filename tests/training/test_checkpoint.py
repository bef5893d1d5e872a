"""Modified checkpoints: each is rejected with file, rule and value, or is a policy that can be played."""

import copy
import hashlib
import json

import numpy as np
import pytest
from safetensors.numpy import save as to_safetensors
from test_network import make_team

import lissajous_env
import training
from lissajous_env import Simulation
from training.learned import checkpoint
from training.learned.card import Card

SCORES = {"detection_time": 1.0, "collisions": 0.0, "return": -1.0, "detected_fraction": None}
POINT = {"steps": 10, "seconds": 0.5} | SCORES
HOSTILE = (
    None, True, -1, 3, 0.5, 10**400, 1e300, -1e300, "", "x", "../x", "/etc/passwd", "a\0b", "\ud800", "sweep", [], [[]],
    ["x"] * 3, {}, {"a": 1}, 99 * [0], float("nan"), float("inf"), json.loads(90 * "[" + 90 * "]"), [{"name": "x"}],
)  # fmt: skip
"""Values that no entry should have; some fit some."""


@pytest.fixture
def folder(tmp_path):
    """A checkpoint that was trained, with a curve and a best policy."""
    network = make_team()
    settings = {"algorithm": "ppo", "seed": 0}
    card = Card.of(lissajous_env.scenario("intruders"), settings=settings)
    notes = {"counters": {"steps": 10, "seconds": 0.5}, "curve": [POINT], "rivals": {"sweep": SCORES}, "best": POINT}
    checkpoint.save(tmp_path / "x", network, card, state={"a": np.arange(3)}, notes=notes)
    return tmp_path / "x"


def write(folder, text):
    # Not emptied first: a file that is, is flushed to the disk when it is closed.
    with open(folder / checkpoint.FILE, "r+") as file:
        file.write(json.dumps(text))
        file.truncate()


def play(folder):
    """Read all of a checkpoint and take a step with it; returns its action, which must be finite and in its range."""
    _, _, text = checkpoint.read(folder)
    if "state" in text["files"]:
        checkpoint.read_state(folder, text)
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


def test_the_checkpoint_plays_as_it_is(folder):
    assert np.isfinite(play(folder)).all()


def test_any_entry_may_be_missing_or_wrong(folder):
    text = json.loads((folder / checkpoint.FILE).read_text())
    # A few of the many inputs stand for all.
    everywhere = [place for place in places(text) if not (place[:2] == ("policy", "inputs") and place[2:] > (2,))]
    refused = 0
    for place in everywhere:
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
        (("policy", "action_size"), 2.0, "action_size must be a whole number of at least 1, got 2.0"),
        (("policy", "inputs"), "abc", "inputs must be words, each once, got 'abc'"),
        (("policy", "base"), "nothing", "base must be a registered classical policy, or none, got 'nothing'"),
        (("policy", "activation"), "gelu", "activation must be relu, got 'gelu'"),
        (("settings",), None, "settings must be an object, got None"),
        (("files",), {}, "files must name weights, and no others but state, got {}"),
        (("files", "weights", "name"), "../weights", r"name of weights must be weights-HASH.safetensors, got '\.\./"),
        (("files", "weights", "sha256"), "x", "SHA-256 of weights must be 64 hexadecimal digits, got 'x'"),
        (("scenario",), None, "scenario must be an object, got None"),
        (("format",), True, "format must be 1, got True"),
        (("rivals",), json.loads(100 * "[" + 100 * "]"), "nest at most 100 levels"),
        ((), [], r"it must be an object, got \[\]"),
    ],
)
def test_what_is_wrong_is_named_with_its_rule_and_value(folder, place, value, words):
    write(folder, changed(json.loads((folder / checkpoint.FILE).read_text()), place, value))
    with pytest.raises(ValueError, match=rf"checkpoint\.json (is |must be an un)damaged.*{words}"):
        play(folder)


def put_weights(folder, data):
    """Replace the weights, as one who keeps the books would."""
    text = json.loads((folder / checkpoint.FILE).read_text())
    digest = hashlib.sha256(data).hexdigest()
    entry = {"name": f"weights-{digest[:12]}.safetensors", "sha256": digest}
    (folder / entry["name"]).write_bytes(data)
    write(folder, text | {"files": {"weights": entry}})


@pytest.mark.parametrize("dtype", ["BF16", "F8_E4M3", "F64", "F16", "I64", "I8", "BOOL"])
def test_weights_of_other_numbers_are_refused(folder, dtype):
    arrays = make_team().to_arrays()
    width = {"BF16": 2, "F8_E4M3": 1, "F64": 8, "F16": 2, "I64": 8, "I8": 1, "BOOL": 1}[dtype]
    header, data = {}, b""
    for name, array in arrays.items():
        end = len(data) + width * array.size
        header[name] = {"dtype": dtype, "shape": list(array.shape), "data_offsets": [len(data), end]}
        data = data.ljust(end, b"\x01")
    head = json.dumps(header).encode()
    put_weights(folder, len(head).to_bytes(8, "little") + head + data)
    with pytest.raises(ValueError, match=r"weights-\w+\.\w+ (.*, but dtype of .* must be float32|is damaged: NumPy)"):
        checkpoint.read(folder)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_weights_that_are_not_finite_are_refused(folder, value):
    arrays = {name: array.copy() for name, array in make_team().to_arrays().items()}
    arrays["team.last.bias"][0] = value
    put_weights(folder, to_safetensors(arrays))
    with pytest.raises(ValueError, match=r"weights-\w+\.\w+ must be .*, but last.bias must be finite"):
        checkpoint.read(folder)


@pytest.mark.parametrize(
    "data",
    [
        b"", b"\0" * 8, (2**63).to_bytes(8, "little"), (2**31).to_bytes(8, "little") + b"{}",
        (100_000).to_bytes(8, "little") + 100_000 * b"[", (2).to_bytes(8, "little") + b"{}",
        (4).to_bytes(8, "little") + b"null", 64 * b"\xff",
    ],
)  # fmt: skip
def test_a_file_of_weights_that_is_none_is_refused(folder, data):
    put_weights(folder, data)
    with pytest.raises(ValueError, match=r"weights-\w+\.\w+ (is damaged: |must be an undamaged checkpoint, but)"):
        checkpoint.read(folder)


def test_weights_must_be_a_plain_file_of_the_folder(folder):
    (weights,) = folder.glob("weights-*")
    weights.rename(folder.parent / "outside")
    weights.symlink_to(folder.parent / "outside")
    with pytest.raises(ValueError, match=rf"{weights.name} must be a plain file, got a link"):
        checkpoint.read(folder)
    weights.unlink()
    weights.mkdir()
    with pytest.raises(ValueError, match=rf"{weights.name} must be a plain file"):
        checkpoint.read(folder)
