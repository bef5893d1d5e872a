"""Films and windows: they show what was drawn, at the requested pace, in a format that browsers play."""

import base64
import os
import sys

import numpy as np
import pygame
import pytest
from PIL import Image

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


@pytest.mark.parametrize(("suffix", "settings", "pictures", "seconds"), [
    ("mp4", {"speed": 4.0}, 4, 0.1), ("gif", {"fps": 5}, 7, 0.2), ("gif", {"fps": 30, "speed": 3.0}, 13, 1 / 30),
])  # fmt: skip
def test_a_film_shows_what_was_drawn_in_every_moment_that_it_has_time_for(
    recording, tmp_path, suffix, settings, pictures, seconds
):
    # Oracle: the pictures themselves; a film loses colour where it changes from pixel to pixel, a GIF has few colours.
    path, ticks = tmp_path / f"a.{suffix}", []
    assert film.save_film(recording, path, on_frame=lambda: ticks.append(1), **settings) == pictures == len(ticks)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    every = -(-12 // (pictures - 1))
    drawn = list(film.frames(recording, Renderer(recording.scenario, 1.0 if suffix == "mp4" else 0.75), every))
    if suffix == "mp4":
        with av.open(str(path)) as opened:
            frames, codec = list(opened.decode(video=0)), opened.streams.video[0].codec_context
            assert (codec.name, codec.pix_fmt) == ("h264", "yuv420p")
        np.testing.assert_allclose([frame.time for frame in frames], seconds * np.arange(pictures), atol=1e-4)
        shown = [frame.to_ndarray(format="rgb24") for frame in frames]
        # A browser can begin before it has the whole film: the index ("moov") stands before the pictures ("mdat").
        assert 0 < path.read_bytes().index(b"moov") < path.read_bytes().index(b"mdat")
    else:
        with Image.open(path) as gif:
            assert (gif.n_frames, gif.info["loop"]) == (pictures, 0)
            shown = [np.asarray(gif.convert("RGB")) for k in range(pictures) if gif.seek(k) is None]
            times = [gif.info["duration"] for k in range(pictures) if gif.seek(k) is None]
            assert np.cumsum(times) == pytest.approx(1000 * seconds * np.arange(1, pictures + 1), abs=5)
    for picture, decoded in zip(drawn, shown, strict=True):
        away = np.abs(decoded.astype(int) - picture).max(axis=-1)
        assert away.mean() < 6
        assert np.percentile(away, 98) < 40


@pytest.mark.parametrize("settings", [{"fps": 0}, {"speed": float("nan")}, {"speed": 1e-9}])
def test_a_pace_that_makes_no_sense_is_refused(recording, tmp_path, settings):
    with pytest.raises(ValueError, match=r"must be positive|at most 655\.35 s"):
        film.save_film(recording, tmp_path / "a.mp4", **settings)
    assert not list(tmp_path.iterdir())


def test_a_window_plays_to_the_end_and_stays_until_it_is_closed(recording, monkeypatch):
    drawn, show = [], film.Window.show
    monkeypatch.setattr(Renderer, "draw", lambda self, seen: drawn.append(seen.step))

    def showing(self, picture, fps):
        if drawn[-1] == len(recording) - 1:
            pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_ESCAPE))
        show(self, picture, 1000)

    monkeypatch.setattr(film.Window, "show", showing)
    film.play(recording, speed=30.0)
    assert drawn[0] == 0
    assert drawn == sorted(set(drawn))
    assert not pygame.display.get_init()


def test_without_its_library_the_extra_is_named_before_anything_is_played(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(SystemExit) as ended:
        main(["run", "failure", "kuramoto", "--out", "a.mp4"])
    assert ended.value.code == 2
    assert 'pip install "lissajous-env[video]"' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_browser_plays_a_film_in_its_colours(recording, tmp_path, browser):
    # Oracle: Chromium's own decoder and colours; compared with the last picture where it is even, off all edges.
    film.save_film(recording, tmp_path / "a.mp4", speed=3.0)
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
    assert duration == pytest.approx(0.5, abs=0.01)
    picture = list(film.frames(recording, every=3))[-1].astype(int)
    assert picture.shape == (height, width, 3)
    shown = np.array(seen).reshape(height, width, 4)[..., :3]
    even = np.ones((height, width), bool)
    for axis in (0, 1):
        for by in range(-4, 5):
            even &= (np.roll(picture, by, axis) == picture).all(-1)
    assert even.mean() > 0.3
    away = np.abs(shown - picture)[even]
    assert away.mean() < 1.5
    assert np.percentile(away, 99.9) < 8
