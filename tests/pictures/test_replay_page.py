"""Replay pages without a browser: contents, escaping of untrusted text, and creation."""

import base64
import dataclasses
import hashlib
import html
import json
import re
import zlib
from pathlib import Path

import numpy as np
import pytest
from browser import hostile, played
from command_line import called

import baselines
import lissajous_env
from lissajous_env.episodes.recording import ARRAYS, Recorder
from lissajous_env.replay import Replay
from lissajous_env.replay.contents import contents, counts, quantised
from lissajous_env.world.state import NEVER

SHORT = {"task.duration": 6.0, "task.contamination": (45, 20), "targets.arrival_rate": 2.0}
HOSTILE = "</script><img src=x onerror=alert(1)><!-- <script>alert(2)</script> &lt; \u2028 \ud800 '\""


@pytest.fixture(scope="module")
def recording():
    return played(**SHORT)


def unpacked(packed):
    """Return the array that a page unpacks; oracle: the format that contents.py describes, read in reverse."""
    size = packed["bits"] // 8
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed["data"])), np.uint8).reshape(size, -1)
    whole = sum(plane.astype(np.uint64) << np.uint64(8 * k) for k, plane in enumerate(planes))
    series = np.cumsum(whole.reshape(packed["shape"]), axis=-1, dtype=np.uint64) % 2 ** packed["bits"]
    return np.moveaxis(packed["low"] + packed["scale"] * series.astype(float), -1, 0)


def data_of(text):
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)[1])


@pytest.mark.parametrize("shape", [(50,), (50, 3), (50, 2, 4), (1, 3), (50, 0)])
def test_numbers_come_back_to_what_is_stated(shape):
    draw = np.random.default_rng(0)
    numbers = draw.normal(0, 3, shape)
    span = np.ptp(numbers) if numbers.size else 1.0
    np.testing.assert_allclose(unpacked(quantised(numbers)), numbers, atol=span / 65_535 * 0.51)
    for most in (200, 60_000, 10**6):
        whole = draw.integers(-3, most + 4, shape)
        limited = np.where((whole < 0) | (whole > most), most + 1, whole)
        np.testing.assert_array_equal(unpacked(counts(whole, most)), limited)


def test_a_recording_knows_where_a_rogue_can_be_unseen():
    # Oracle: the age of which the score is made, and its mean over the cells, in every step.
    simulation = lissajous_env.Simulation(lissajous_env.scenario("evaders", **SHORT), seed=3)
    recorder = Recorder(simulation)
    recorder.take()
    ages, means = [0], [0.0]
    for _ in range(40):
        simulation.step(np.full(simulation.action_shape, 0.3, np.float32))
        recorder.take()
        ages.append(int(simulation.contamination.age.numpy()[0]))
        means.append(float(simulation.contamination.mean_age.numpy()[0]))
    since = recorder.recording().introduced_at
    age = np.where(since == int(NEVER), 0, np.arange(41)[:, None, None] - since)
    np.testing.assert_array_equal(age.max(axis=(1, 2)), ages)
    np.testing.assert_allclose(age.mean(axis=(1, 2)), means, rtol=1e-5)
    assert max(ages) > 10


def test_a_recording_holds_what_each_robot_saw_and_did():
    # Oracle: the same episode, played by hand.
    scenario = lissajous_env.scenario("rough", **{"task.duration": 2.0})
    recording = played("rough", seed=5, **{"task.duration": 2.0})
    simulation = lissajous_env.Simulation(scenario, seed=5)
    policy = baselines.make("kuramoto-mpcc", scenario)
    policy.reset()
    assert not recording.action[0].any()
    for f in range(20):
        np.testing.assert_array_equal(recording.observation[f], simulation.observation.numpy()[0])
        np.testing.assert_array_equal(recording.heard_at[f], simulation.links.heard_at.numpy()[0])
        action = policy.act(simulation.observation)
        np.testing.assert_array_equal(recording.action[f + 1], np.clip(action.numpy()[0], -1, 1))
        simulation.step(action)
        np.testing.assert_array_equal(recording.reward_terms[f + 1], simulation.reward_terms.numpy()[0])
    assert recording.observation_names == simulation.layout.names
    assert (np.diff(recording.heard_at, axis=0) == 0).any()  # messages were lost


def test_a_page_holds_the_recording(recording):
    (entry,) = data_of(Replay(recording).html())["episodes"]
    assert (entry["policy"], entry["seed"]) == ("kuramoto-mpcc", 1)
    x = unpacked(entry["robots"]["x"])
    np.testing.assert_allclose(x, recording.position[..., 0], atol=np.ptp(x) / 65_535)
    observation = np.stack([unpacked(column) for column in entry["robots"]["observation"]], axis=-1)
    np.testing.assert_allclose(observation, recording.observation, atol=8 / 65_535)
    np.testing.assert_allclose(unpacked(entry["robots"]["action"][0])[:-1], recording.action[1:, :, 0], atol=2 / 65_535)
    assert entry["robots"]["names"] == list(recording.observation_names)
    pictures, stride = unpacked(entry["ground"]["unseen"]["cells"]), entry["ground"]["unseen"]["stride"]
    assert stride == 2
    since = recording.introduced_at[::stride]
    np.testing.assert_array_equal(pictures, np.where(since == int(NEVER), len(recording) + 1, since))
    detections = np.array(entry["targets"]["found"])
    assert np.count_nonzero(detections >= 0) == np.count_nonzero(recording.found_at < len(recording))


def test_a_minute_of_five_robots_and_fifty_targets_is_small():
    recording = played(**{"targets.count": 25, "targets.arrival_rate": 0.45, "task.duration": 60.0})
    assert len(recording.motion) >= 50
    assert len(Replay(recording).html().encode()) < 2e6


def test_long_episodes_and_fine_grids_are_thinned(recording):
    overrides = SHORT | {"task.duration": 620.0, "task.grid": (150, 130)}
    fixed = ("motion", "appears_at", "found_at", "found_early", "contact", "sensed_at")
    moments = np.arange(6_101) % len(recording)
    arrays = {name: getattr(recording, name)[moments] for name in ARRAYS if name not in fixed}
    arrays["sensed_at"] = np.broadcast_to(np.int32(0), (6_101, 130, 150))
    long = dataclasses.replace(recording, scenario=lissajous_env.scenario("evaders", **overrides).resolve(), **arrays)
    episode = contents(long)
    assert (episode["every"], episode["moments"]) == (2, 3051)
    rows, columns, _ = episode["ground"]["sensed"]["cells"]["shape"]
    assert rows <= 128
    assert columns <= 128
    np.testing.assert_allclose(unpacked(episode["robots"]["x"]), long.position[::2, :, 0], atol=1e-3)


def test_commands_write_pages(tmp_path, monkeypatch, capsys):
    # Story: an episode is played to a page, to a recording, and that beside another policy to a page of two.
    monkeypatch.chdir(tmp_path)
    short = ("--seed", 3, "--set", "task.duration=1")
    assert called(capsys, "run", "failure", "kuramoto", "--out", "a.html", *short)[0] == 0
    assert called(capsys, "replay", "failure", "kuramoto", "--out", "b.html", *short)[0] == 0
    assert Path("a.html").read_text() == Path("b.html").read_text()
    assert called(capsys, "run", "failure", "kuramoto", "--out", "c.npz", *short)[0] == 0
    assert called(capsys, "replay", "c.npz", "--out", "c.html")[0] == 0
    assert Path("a.html").read_text() == Path("c.html").read_text()
    assert called(capsys, "replay", "c.npz", "--against", "open-loop", "--out", "d.html")[0] == 0
    one, other = data_of(Path("d.html").read_text())["episodes"]
    assert (one["policy"], other["policy"], one["seed"], other["seed"]) == ("kuramoto", "open-loop", 3, 3)
    assert one == data_of(Path("a.html").read_text())["episodes"][0]
    assert other["targets"]["x"] == one["targets"]["x"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["failure", "kuramoto", "--against", "still", "--out", "a.gif"], "out must end in .html beside --against"),
        (["failure", "knot", "kuramoto", "--out", "a.html"], "exactly one scenario must be given, got failure, knot"),
        (["nowhere.npz", "--out", "a.html"], "there is no file nowhere.npz"),
        (["--out", "a.html"], "got nothing"),
    ],
)
def test_what_cannot_be_shown_is_said(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("lissajous_env.episodes.recording.record", lambda *_: pytest.fail("played before"))
    code, _, said = called(capsys, "replay", *arguments)
    assert code == 2
    assert words in said
    assert not list(tmp_path.iterdir())


def test_nothing_of_a_recording_becomes_markup(recording):
    text = Replay(hostile(recording, HOSTILE)).html()
    markup = re.sub(r'<script type="application/json" id="data">.*?</script>', "", text, flags=re.DOTALL)
    assert HOSTILE not in text
    assert markup.count(html.escape(HOSTILE.replace("\ud800", "?"))) == 2  # scenario and policy in the title
    assert "<img" not in text
    assert data_of(text)["episodes"][0]["scenario"]["name"] == HOSTILE
    assert data_of(text)["episodes"][0]["score"]["return_mean"] is None


def test_a_page_runs_its_own_scripts_alone_and_asks_no_address(recording):
    # Oracle: the hashes of Content Security Policy Level 3, computed over what stands between the tags.
    text = Replay(recording, recording).html()
    policy = html.unescape(re.search(r'http-equiv="Content-Security-Policy" content="(.*?)"', text)[1])
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == rules["connect-src"] == rules["base-uri"] == "'none'"
    blocks = {
        "script": re.findall(r'<script(?: type="module")?>(.*?)</script>', text, re.DOTALL),
        "style": re.findall("<style>(.*?)</style>", text, re.DOTALL),
    }
    for kind, parts in blocks.items():
        hashes = [f"'sha256-{base64.b64encode(hashlib.sha256(part.encode()).digest()).decode()}'" for part in parts]
        assert rules[f"{kind}-src"].split() == hashes
    assert len(blocks["script"]) == 1
    assert not re.search(
        r'(?:src|href)="?(?:https?:)?//|@import|url\(', re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    )


def test_a_notebook_shows_in_a_frame_the_page_that_is_saved(recording, tmp_path):
    replay = Replay(recording)
    replay.save(tmp_path / "a.html")
    assert [file.name for file in tmp_path.iterdir()] == ["a.html"]
    frame = replay._repr_html_()
    assert html.unescape(re.search(r'srcdoc="(.*?)"', frame, re.DOTALL)[1]) == (tmp_path / "a.html").read_text()
    assert 'sandbox="allow-scripts"' in frame
