"""Show a recording as an animated GIF or an MP4 film, or play it in a window."""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image

from lissajous_env.episodes.recording import Recording
from lissajous_env.plugins import of_extra
from lissajous_env.render import palette
from lissajous_env.render.renderer import Renderer, Window
from lissajous_env.storage.files import replacing
from lissajous_env.wording import require

FILMS = ".gif", ".mp4"
"""Suffixes of films."""
LONGEST = 655.35
"""Longest duration of a picture in a GIF [s]; also the limit for an MP4."""
DENSEST = 50.0
"""Limit on the pictures per second of a film [1/s]."""
FASTEST = 30.0
"""Pictures per second in a window [1/s]."""
_SHARES = (1.0, 0.85, 0.7, 0.55, 0.4, 0.25, 0.15)
"""Shares of a colour in its mixtures with the ground, of which a GIF consists."""
_QUALITY = {"crf": "18", "x264-params": "colorprim=bt709:transfer=bt709:colormatrix=bt709"}
"""Constant quality at which thin lines stay sharp; browsers show the colours by the matrix that is named."""
pyav = partial(of_extra, "av", "an .mp4", "video")
"""Function that returns the module of PyAV."""


def frames(recording: Recording, renderer: Renderer | None = None, every: int = 1) -> Iterator[np.ndarray]:
    """Yield pictures (H, W, 3) uint8 of a recording, one for each `every` moments."""
    renderer = renderer or Renderer(recording.scenario)
    for moment in range(0, len(recording), every):
        yield renderer.draw(recording.snapshot(moment))


def save_film(
    recording: Recording,
    path: str | Path,
    *,
    fps: float = 10.0,
    speed: float = 1.0,
    on_frame: Callable[[], None] = lambda: None,
) -> int:
    """Write a recording as an animated GIF that repeats, or as an MP4 film (H.264), by the suffix of the path.

    Args:
        recording: The recording.
        path: File to write, .gif or .mp4; written under a temporary name first.
        fps: Largest number of pictures per second, up to 50; moments between them are skipped.
        speed: Seconds of the episode per second of the film.
        on_frame: Called after each picture.

    Returns:
        The number of pictures.

    Raises:
        ValueError: the suffix is unknown, fps or speed are not positive, or a picture would last more than 655.35 s.
        MissingExtraError: an .mp4 without the extra `video`.
    """
    suffix = Path(path).suffix.lower()
    require(suffix in FILMS, "path", f"must end in {' or '.join(FILMS)}", str(path))
    every, seconds = paced(recording, fps, speed)
    count = len(range(0, len(recording), every))
    renderer = Renderer(recording.scenario, 1.0 if suffix == ".mp4" else 0.75)

    def drawn() -> Iterator[np.ndarray]:
        for picture in frames(recording, renderer, every):
            yield picture
            on_frame()

    with replacing(path) as temporary:
        (_write_mp4 if suffix == ".mp4" else _write_gif)(temporary, drawn(), renderer.view.size, count, seconds)
    return count


def paced(recording: Recording, fps: float, speed: float) -> tuple[int, float]:
    """Return the number of moments per picture and the duration of a picture [s]."""
    for name, value in (("fps", fps), ("speed", speed)):
        require(0 < value < math.inf, name, "must be positive", value)
    step = recording.scenario.task.step
    every = max(math.ceil(min(speed / (min(fps, DENSEST) * step), len(recording)) - 1e-9), 1)
    seconds = every * step / speed
    require(seconds <= LONGEST, "fps and speed", f"must show a picture for at most {LONGEST} s", seconds)
    return every, seconds


def _write_gif(path: Path, pictures: Iterable[np.ndarray], size: tuple[int, int], count: int, seconds: float) -> None:
    """Write `count` pictures (H, W, 3) uint8; all have the same colours, so that still parts do not flicker."""
    own = [colour for colour in vars(palette).values() if isinstance(colour, tuple)]
    mixtures = [palette.mixed(palette.GROUND, colour, share) for colour in own for share in _SHARES]
    colours = Image.new("P", (1, 1))
    colours.putpalette(np.array(mixtures, np.uint8).tobytes())
    indexed = (Image.fromarray(picture).quantize(palette=colours, dither=Image.Dither.NONE) for picture in pictures)
    # The unit of a GIF is 0.01 s, and most viewers show no picture for less than two. Times are rounded, not durations.
    durations = np.diff(10 * np.round(100 * max(seconds, 0.02) * np.arange(count + 1))).astype(int).tolist()
    next(indexed).save(path, "GIF", save_all=True, append_images=indexed, duration=durations, loop=0)


def _write_mp4(path: Path, pictures: Iterable[np.ndarray], size: tuple[int, int], count: int, seconds: float) -> None:
    """Write pictures (H, W, 3) uint8, H and W even.

    The film is H.264 with a chroma sample for four pixels (yuv420p) and its index at the front, so that browsers,
    presentations and phones play it.
    """
    av = pyav()
    with av.open(str(path), "w", format="mp4", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=1 / Fraction(seconds).limit_denominator(10_000))
        stream.width, stream.height = size
        stream.pix_fmt, stream.options = "yuv420p", _QUALITY
        for picture in pictures:
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def play(recording: Recording, *, speed: float = 1.0) -> None:
    """Play a recording in a window, whose last picture stays until it is closed.

    Raises:
        OSError: there is no display to open a window on.
    """
    require(0 < speed < math.inf, "speed", "must be positive", speed)
    renderer = Renderer(recording.scenario)
    window = Window(renderer.view.size, f"{recording.scenario.name}, {recording.score.get('policy', '')} - lissajous")
    at, drawn, before = 0.0, -1, time.perf_counter()
    while not window.closed:
        if int(at) != drawn:
            drawn = int(at)
            renderer.draw(recording.snapshot(drawn))
        window.show(renderer.picture, FASTEST)
        now = time.perf_counter()
        # A machine that is too slow plays in slow motion instead of skipping moments.
        at = min(at + min(now - before, 0.2) * speed / recording.scenario.task.step, len(recording) - 1.0)
        before = now
