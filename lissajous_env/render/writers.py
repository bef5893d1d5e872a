"""Writers of films, picture by picture: animated GIFs, and MP4 films by PyAV of the extra `video`."""

import struct
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from PIL import GifImagePlugin, Image

from lissajous_env.extras import missing
from lissajous_env.render import palette

_SAME = 255
"""Colour that lets the picture before show through."""

_QUALITY = {"crf": "18", "x264-params": "colorprim=bt709:transfer=bt709:colormatrix=bt709"}
"""Constant quality at which thin lines stay sharp; browsers show the colours by the matrix that is named."""


class GifWriter:
    """Writes pictures (H, W, 3) uint8 of one size to an animated GIF; `close` ends it.

    Pillow's own writer stores all pictures in memory.

    Args:
        file: File to write.
        samples: Some of the pictures: the colours of all are chosen from them, so that still parts do not flicker.
        duration: Duration of each picture, in hundredths of a second.
    """

    def __init__(self, file: BinaryIO, samples: list[np.ndarray], duration: int):
        self._file, self._duration = file, duration
        self._colours = _chosen_colours(samples)
        self._before: np.ndarray | None = None
        height, width, _ = samples[0].shape
        table = bytes(self._colours.getpalette() or b"").ljust(3 * 256, b"\0")
        file.write(b"GIF89a" + struct.pack("<HHBBB", width, height, 0b1111_0111, 0, 0) + table)
        file.write(b"\x21\xff\x0bNETSCAPE2.0\x03\x01" + struct.pack("<HB", 0, 0))  # repeats endlessly

    def add(self, picture: np.ndarray) -> None:
        """Write the smallest rectangle of a picture that contains all changes."""
        indexed = np.array(Image.fromarray(picture).quantize(palette=self._colours, dither=Image.Dither.NONE))
        top, left, bottom, right = 0, 0, *indexed.shape
        shown = indexed
        if self._before is not None:
            same = indexed == self._before
            changed = np.argwhere(~same)
            (top, left), (bottom, right) = (changed.min(0), changed.max(0) + 1) if len(changed) else ((0, 0), (1, 1))
            shown = np.where(same, _SAME, indexed)[top:bottom, left:right].astype(np.uint8)
        self._before = indexed
        image = Image.frombytes("P", (shown.shape[1], shown.shape[0]), np.ascontiguousarray(shown).tobytes())
        how = {"duration": 10 * self._duration, "transparency": _SAME, "disposal": 1, "include_color_table": False}
        for block in GifImagePlugin.getdata(image, (int(left), int(top)), **how):
            self._file.write(block)

    def close(self) -> None:
        """Write the end of the GIF; the file stays open."""
        self._file.write(b";")


def _chosen_colours(samples: list[np.ndarray]) -> Image.Image:
    """Choose 255 colours; index 255 is transparent."""
    own = [colour for colour in vars(palette).values() if isinstance(colour, tuple)]
    # Dots have too few pixels to get a colour by frequency.
    shares = (1.0, 0.8, 0.6, 0.45, 0.3, 0.15)
    swatches = np.array([palette.mixed(palette.GROUND, colour, share) for colour in own for share in shares], np.uint8)
    _, width, _ = samples[0].shape
    strip = np.resize(np.repeat(swatches, 600, axis=0), (600 * len(swatches) // width + 1, width, 3))
    return Image.fromarray(np.concatenate([*samples, strip])).quantize(255, method=Image.Quantize.MEDIANCUT)


def pyav() -> Any:
    """Return the module of PyAV.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import av
    except ImportError as error:
        raise missing("an .mp4", "video", error) from error
    return av


class Mp4Writer:
    """Writes pictures (H, W, 3) uint8 of one size, H and W even, to a file; `close` ends it.

    The film is H.264 with a chroma sample for four pixels (yuv420p) and its index at the front, so that browsers,
    presentations and phones play it.

    Args:
        path: File to write.
        size: Width and height [px].
        seconds: Duration of each picture [s].
    """

    def __init__(self, path: Path, size: tuple[int, int], seconds: float):
        self._av = pyav()
        self._container = self._av.open(str(path), "w", format="mp4", options={"movflags": "faststart"})
        self._stream = self._container.add_stream("libx264", rate=1 / Fraction(seconds).limit_denominator(10_000))
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        self._stream.options = _QUALITY

    def add(self, picture: np.ndarray) -> None:
        """Write one picture."""
        frame = self._av.VideoFrame.from_ndarray(picture, format="rgb24")
        frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG")
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        """Write the end of the film, and close the file."""
        self._container.mux(self._stream.encode(None))
        self._container.close()
