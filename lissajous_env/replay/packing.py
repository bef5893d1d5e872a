"""Encode arrays as text for a page: quantised, differenced in time, compressed by zlib, in base64.

A page decodes `value = low + scale * q`, where `q` is an unsigned integer of 8, 16 or 32 bits. Each series (the last
axis) is stored as differences between moments modulo 2^bits, with the lower bytes of all numbers first.
"""

import base64
import zlib
from typing import Any

import numpy as np

LEVELS = 65_535
"""Number of steps between the smallest and the largest number of a quantised array."""
FARTHEST = 1e12
"""Limit on the numbers of a page; larger ones are clipped."""


def quantised(values: np.ndarray) -> dict[str, Any]:
    """Encode numbers (F, ...), time first, to 1/65,535 of their range; decoded they are (..., F)."""
    values = np.clip(np.asarray(values, dtype=np.float64), -FARTHEST, FARTHEST)
    low = float(values.min()) if values.size else 0.0
    scale = (float(values.max()) - low) / LEVELS if values.size else 0.0
    whole = np.rint((values - low) / (scale or 1.0)).astype(np.uint16)
    return _packed(whole, low, scale)


def angles(values: np.ndarray) -> dict[str, Any]:
    """Encode angles (F, ...) [rad] to 1/65,536 of a turn; decoded they are (..., F), in [0, 2 pi)."""
    turns = np.asarray(values, dtype=np.float64) / (2 * np.pi)
    return _packed(
        (np.rint(turns % 1.0 * 65_536).astype(np.uint32) & 0xFFFF).astype(np.uint16), 0.0, 2 * np.pi / 65_536
    )


def counts(values: np.ndarray, most: int) -> dict[str, Any]:
    """Encode whole numbers (F, ...); numbers below 0 or above `most` become `most` + 1."""
    values = np.asarray(values, dtype=np.int64)
    values = np.where((values < 0) | (values > most), most + 1, values)
    dtype = next(candidate for candidate in (np.uint8, np.uint16, np.uint32) if most + 1 <= np.iinfo(candidate).max)
    return _packed(values.astype(dtype), 0.0, 1.0) | {"none": most + 1}


def _packed(whole: np.ndarray, low: float, scale: float) -> dict[str, Any]:
    series = np.ascontiguousarray(np.moveaxis(whole, 0, -1))
    changes = np.diff(series, axis=-1, prepend=series.dtype.type(0))
    size = series.dtype.itemsize
    planes = np.ascontiguousarray(changes).astype(series.dtype.newbyteorder("<")).view(np.uint8).reshape(-1, size).T
    text = base64.b64encode(zlib.compress(planes.tobytes(), 6)).decode()
    return {"shape": list(series.shape), "bits": 8 * size, "low": low, "scale": scale, "data": text}
