"""MP4 films, encoded picture by picture by PyAV of the extra `video`."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from lissajous_env.extras import missing

_QUALITY = {"crf": "18", "x264-params": "colorprim=bt709:transfer=bt709:colormatrix=bt709"}
"""Constant quality at which thin lines stay sharp; browsers show the colours by the matrix that is named."""


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
