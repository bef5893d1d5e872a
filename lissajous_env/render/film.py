"""Show a recording as an animated GIF or an MP4 film, or play it in a window."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pygame

from lissajous_env.episodes.recording import Recording
from lissajous_env.render.canvas import View
from lissajous_env.render.renderer import Renderer
from lissajous_env.render.window import Window
from lissajous_env.render.writers import GifWriter, Mp4Writer
from lissajous_env.storage.files import replacing
from lissajous_env.wording import shown

FILMS = ".gif", ".mp4"
"""Suffixes of films."""

LONGEST = 655.35
"""Longest duration of a picture in a GIF [s]; also used for films."""

DENSEST = 50.0
"""Limit on the pictures per second of a GIF or a film [1/s]."""

FASTEST = 30.0
"""Pictures per second in a window [1/s]."""


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
    size: Sequence[int] | None = None,
    on_frame: Callable[[], None] | None = None,
) -> int:
    """Write a recording as an animated GIF that repeats, or as an MP4 film (H.264), by the suffix of the path.

    Args:
        recording: The recording.
        path: File to write, .gif or .mp4; written under a temporary name first.
        fps: Largest number of pictures per second, up to 50; moments between them are skipped.
        speed: Seconds of the episode per second of the film.
        size: Width and height [px], made even for a film; by default that of `Renderer`, or 3/4 of it for a GIF.
        on_frame: Called after each picture.

    Returns:
        The number of pictures.

    Raises:
        ValueError: the suffix is unknown, fps or speed are not positive, or a picture would last more than 655.35 s.
        MissingExtraError: a film without the extra `video`.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FILMS:
        raise ValueError(f"path must end in {' or '.join(FILMS)}, got {path}")
    every, seconds = _paced(recording, fps, speed)
    wide, high = View.of(recording.scenario, size).size
    if suffix == ".mp4":
        wide, high = wide + wide % 2, high + high % 2
    elif size is None:
        wide, high = wide * 3 // 4, high * 3 // 4
    renderer = Renderer(recording.scenario, (wide, high))
    moments = range(0, len(recording), every)
    with replacing(path) as temporary, open(temporary, "wb") as file:
        if suffix == ".mp4":
            writer = Mp4Writer(temporary, (wide, high), seconds)
        else:
            spread = sorted(set(np.linspace(0, len(moments) - 1, 5).round().astype(int).tolist()))
            samples = [renderer.draw(recording.snapshot(moments[k])) for k in spread]
            # The unit of a GIF is 0.01 s, and most viewers cannot show pictures shorter than two units.
            writer = GifWriter(file, samples, max(round(100 * seconds), 2))
        for picture in frames(recording, renderer, every):
            writer.add(picture)
            if on_frame is not None:
                on_frame()
        writer.close()
    return len(moments)


def _paced(recording: Recording, fps: float, speed: float) -> tuple[int, float]:
    """Return the number of moments per picture and the duration of a picture [s]."""
    _require_positive(fps=fps, speed=speed)
    step = recording.scenario.task.step
    every = max(math.ceil(min(speed / (min(fps, DENSEST) * step), len(recording)) - 1e-9), 1)
    seconds = every * step / speed
    if seconds > LONGEST:
        raise ValueError(
            f"fps and speed must show a picture for at most {LONGEST} s, got fps {fps:g} and speed {speed:g}: "
            f"{seconds:.3g} s"
        )
    return every, seconds


def play(recording: Recording, *, speed: float = 1.0, size: Sequence[int] | None = None) -> None:
    """Show a recording in a window until it is closed: space pauses, left and right step, escape quits.

    Raises:
        OSError: there is no display to open a window on.
    """
    _require_positive(speed=speed)
    step = recording.scenario.task.step
    renderer = Renderer(recording.scenario, size)
    window = Window(renderer.view.size, f"{recording.scenario.name}, {recording.score.get('policy', '')} - lissajous")
    if not window.can_be_seen:
        window.close()
        raise OSError("no window can be opened: there is no display; write an .html, .mp4, .gif or .png instead")
    at, last, paused, drawn = 0.0, len(recording) - 1, False, -1
    before = time.perf_counter()
    while not window.closed:
        moment = int(at)
        if moment != drawn:
            renderer.draw(recording.snapshot(moment))
            drawn = moment
        for key in window.show(renderer.picture, FASTEST):
            if key == pygame.K_ESCAPE:
                window.close()
            elif key == pygame.K_SPACE:
                # At the end, playing restarts.
                at, paused = (0.0, False) if moment == last else (at, not paused)
            elif key in (pygame.K_LEFT, pygame.K_RIGHT):
                moment = min(max(moment + (1 if key == pygame.K_RIGHT else -1), 0), last)
                at, paused = float(moment), True
        now = time.perf_counter()
        if not paused:
            # A machine that is too slow plays in slow motion instead of skipping moments.
            at = min(at + min(now - before, 0.2) * speed / step, float(last))
        before = now


def _require_positive(**values: float) -> None:
    for name, value in values.items():
        if not 0 < value < math.inf:
            raise ValueError(f"{name} must be positive, got {shown(value)}")
