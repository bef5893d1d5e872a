"""Malicious recording files: each is rejected by name, with little memory."""

import io
import json
import resource
import zipfile

import numpy as np
import pytest

import lissajous_env
from lissajous_env.episodes import recording as recordings
from lissajous_env.render import film
from tests.storage.planted import opened, payloads


@pytest.fixture(scope="module")
def recording() -> recordings.Recording:
    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", **{"task.duration": 1.2}), seed=4)
    recorder = recordings.Recorder(simulation)
    recorder.take()
    for _ in range(12):
        simulation.step(np.zeros(simulation.action_shape, np.float32))
        recorder.take()
    return recorder.recording("straight")


def rewritten(recording, path, about=lambda about: about, **members) -> None:
    """Save a recording with other words about it, and with members of the archive replaced by raw bytes."""
    recording.save(path)
    with zipfile.ZipFile(path) as file:
        raw = {name: file.read(name) for name in file.namelist()}
    words = io.BytesIO()
    text = json.loads(str(np.load(io.BytesIO(raw["about.npy"]))))
    np.save(words, np.array(changed if isinstance(changed := about(text), str) else json.dumps(changed)))
    raw |= {"about.npy": words.getvalue()} | {f"{name}.npy": data for name, data in members.items()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in raw.items():
            file.writestr(name, data)


def header(shape, dtype="<f4", rest=b"") -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": dtype, "fortran_order": False, "shape": shape})
    return file.getvalue() + rest


def part(name, **fields):
    """Change fields of one part of what a recording says of its scenario."""

    def change(about):
        about["scenario"][name] |= fields
        return about

    return change


def refused(path) -> str:
    """Return the reason for which a file is refused: only a ValueError with its name, in one line, with little
    memory."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ValueError, match=r"bad\.npz must be an undamaged recording") as caught:
        recordings.load(path)
    assert "\n" not in str(caught.value)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200 * 1024
    return str(caught.value)


@pytest.mark.parametrize("data", [
    header((10**10,)),
    header((-1, 5, 3)),
    header((13, 5, 3), "|O", b"cos\nsystem\n."),
    header((40_000_000, 5, 3), rest=b"\0" * 1000),
    b"\x93NUMPY\x03\x00\xff\xff\xff\xff",
    b"\x93NUMPY\x01\x00\xff\xff" + b"(" * 65535,
])  # fmt: skip
def test_arrays_that_claim_too_much_are_refused_by_name(recording, tmp_path, data):
    rewritten(recording, tmp_path / "bad.npz", position=data)
    assert refused(tmp_path / "bad.npz")


def test_a_pickle_in_the_place_of_an_array_is_not_opened(recording, tmp_path):
    marker = tmp_path / "opened"
    rewritten(recording, tmp_path / "bad.npz", position=payloads(marker)["npy"])
    assert refused(tmp_path / "bad.npz")
    assert not opened(marker)


def test_a_small_file_that_would_unpack_to_much_is_refused(recording, tmp_path, monkeypatch):
    # Zeros, packed to a thousandth, in the place of the cells.
    monkeypatch.setattr(recordings, "MOST_BYTES", 10**8)
    path = tmp_path / "bad.npz"
    recording.save(path)
    with zipfile.ZipFile(path) as file:
        raw = {name: file.read(name) for name in file.namelist() if name != "sensed_at.npy"}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
        for name, data in raw.items():
            file.writestr(name, data)
        with file.open("sensed_at.npy", "w", force_zip64=True) as member:
            member.write(header((13, 16, 360_000), "<i4"))
            for _ in range(13 * 4):
                member.write(bytes(16 * 360_000))
    assert "at most" in refused(path)


@pytest.mark.parametrize("about", [
    lambda about: "[" * 100_000,
    lambda about: "",
    lambda about: [about],
    lambda about: about | {"score": None},
    lambda about: about | {"score": about["score"] | {"policy": [[]]}},
    lambda about: about | {"scenario": about["scenario"] | {"name": 10**400}},
    lambda about: about | {"scenario": about["scenario"] | {"color": "red"}},
    part("curve", a=10**9 + 1),
    part("task", duration=10**400),
    part("curve", radius=1),
    part("robot", count=6),
    part("task", grid=[10**9, 1]),
])  # fmt: skip
def test_words_that_do_not_hold_are_refused_by_name(recording, tmp_path, about):
    rewritten(recording, tmp_path / "bad.npz", about)
    try:
        loaded = recordings.load(tmp_path / "bad.npz")
    except ValueError:
        refused(tmp_path / "bad.npz")
    else:  # of a curve with so many lobes only the picture has to hold
        assert loaded.scenario.curve.a == 10**9 + 1
        assert next(film.frames(loaded)).std() > 5
