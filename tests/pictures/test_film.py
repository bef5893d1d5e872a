"""MP4 videos: they show what was drawn, at the requested pace, in a format that browsers play."""

import base64
import os
import sys

import numpy as np
import pytest

import lissajous_env
from lissajous_env.console.cli import main
from lissajous_env.episodes.recording import Recorder, Recording
from lissajous_env.render import Renderer, film

if os.environ.get("CI"):
    import av
else:
    av = pytest.importorskip("av")

SETTINGS = {"task.duration": 1.2, "targets.arrival_rate": 5.0}


@pytest.fixture(scope="module")
def recording() -> Recording:
    simulation = lissajous_env.Simulation(lissajous_env.scenario("intruders", **SETTINGS), seed=4)
    recorder = Recorder(simulation)
    recorder.take()
    for _ in range(12):
        simulation.step(np.ones(simulation.action_shape, np.float32))
        recorder.take()
    return recorder.recording("straight")


@pytest.mark.parametrize(
    ("settings", "pictures", "seconds"),
    [({}, 13, 0.1), ({"speed": 4.0}, 4, 0.1), ({"fps": 5}, 7, 0.2), ({"speed": 0.5}, 13, 0.2), ({"fps": 3}, 4, 0.4)],
)
def test_a_film_shows_every_moment_that_it_has_time_for(recording, tmp_path, settings, pictures, seconds):
    path, ticks = tmp_path / "a.mp4", []
    assert film.save_film(recording, path, size=(360, 240), on_frame=lambda: ticks.append(1), **settings) == pictures
    assert len(ticks) == pictures
    with av.open(str(path)) as opened:
        stream = opened.streams.video[0]
        times = [frame.time for frame in opened.decode(video=0)]
        np.testing.assert_allclose(times, seconds * np.arange(pictures), atol=1e-4)
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
    assert [file.name for file in tmp_path.iterdir()] == ["a.mp4"]


def test_a_film_shows_what_was_drawn(recording, tmp_path):
    # Oracle: the pictures themselves; a decoded film loses colour where it changes from pixel to pixel, and no more.
    film.save_film(recording, tmp_path / "a.mp4")
    drawn = list(film.frames(recording, Renderer(recording.scenario)))
    with av.open(str(tmp_path / "a.mp4")) as opened:
        shown = [frame.to_ndarray(format="rgb24") for frame in opened.decode(video=0)]
    assert len(shown) == len(drawn)
    for picture, decoded in zip(drawn, shown, strict=True):
        away = np.abs(decoded.astype(int) - picture).max(axis=-1)
        assert away.mean() < 5
        assert np.percentile(away, 98) < 40


@pytest.mark.parametrize("size", [(361, 241), (360, 241), (160, 160)])
def test_sides_of_a_film_are_even(recording, tmp_path, size):
    film.save_film(recording, tmp_path / "a.mp4", size=size)
    with av.open(str(tmp_path / "a.mp4")) as opened:
        frame = next(opened.decode(video=0))
        assert (frame.width, frame.height) == tuple(length + length % 2 for length in size)


def test_a_browser_can_begin_before_it_has_the_whole_film(recording, tmp_path):
    # Format: the index ("moov") stands before the pictures ("mdat").
    film.save_film(recording, tmp_path / "a.mp4", size=(240, 160))
    data = (tmp_path / "a.mp4").read_bytes()
    assert 0 < data.index(b"moov") < data.index(b"mdat")


@pytest.mark.parametrize("settings", [{"fps": 0}, {"speed": -1}, {"speed": float("nan")}, {"speed": 1e-9}])
def test_a_pace_that_makes_no_sense_is_refused(recording, tmp_path, settings):
    with pytest.raises(ValueError, match=r"must be positive|at most 655\.35 s"):
        film.save_film(recording, tmp_path / "a.mp4", **settings)
    assert not list(tmp_path.iterdir())


def test_without_its_library_the_extra_is_named_before_anything_is_played(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(SystemExit) as ended:
        main(["run", "failure", "kuramoto", "--out", "a.mp4"])
    assert ended.value.code == 2
    assert 'pip install "lissajous-env[video]"' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_the_command_writes_a_film(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(["run", "intruders", "still", "--set", "task.duration=0.5", "--out", "a.mp4"])
    assert not ended.value.code
    assert "wrote a.mp4" in capsys.readouterr().out
    with av.open(str(tmp_path / "a.mp4")) as opened:
        assert sum(1 for _ in opened.decode(video=0)) == 6


def test_a_browser_plays_a_film_in_its_colours(recording, tmp_path, browser):
    # Oracle: Chromium's own decoder and colours; compared with the last picture where it is even, off all edges.
    film.save_film(recording, tmp_path / "a.mp4", size=(480, 320))
    data = base64.b64encode((tmp_path / "a.mp4").read_bytes()).decode()
    (tmp_path / "page.html").write_text(f'<video src="data:video/mp4;base64,{data}" muted></video><canvas></canvas>')
    browser.get((tmp_path / "page.html").as_uri())
    duration, width, height, seen = browser.execute_async_script(
        "const done = arguments[0], video = document.querySelector('video'), canvas = document.querySelector('canvas');"
        "video.onended = () => { [canvas.width, canvas.height] = [video.videoWidth, video.videoHeight];"
        "const context = canvas.getContext('2d'); context.drawImage(video, 0, 0);"
        "done([video.duration, canvas.width, canvas.height,"
        " Array.from(context.getImageData(0, 0, canvas.width, canvas.height).data)]); }; video.play();"
    )
    assert (width, height) == (480, 320)
    assert duration == pytest.approx(1.3, abs=0.01)
    picture = Renderer(recording.scenario, (480, 320)).draw(recording.snapshot(12)).astype(int)
    shown = np.array(seen).reshape(320, 480, 4)[..., :3]
    even = np.ones((320, 480), bool)
    for axis in (0, 1):
        for by in range(-4, 5):
            even &= (np.roll(picture, by, axis) == picture).all(-1)
    assert even.mean() > 0.3
    away = np.abs(shown - picture)[even]
    assert away.mean() < 1.5
    assert np.percentile(away, 99.9) < 8
