"""Read arrays from untrusted .npz files: headers are checked before memory is allocated."""

import io
import json
import math
import zipfile
from typing import Any

import numpy as np

MOST_BYTES = 2**30
"""Limit on the total size of the arrays of a file [bytes]."""

_MOST_WORDS = 2**24
"""Limit on the size of its text [bytes]."""

_DENSEST = 1100
"""Limit on the bytes that a byte of an archive unpacks to; those of Deflate are at most 1032."""

_LONGEST_HEADER = 2**14
"""Limit on the size of a header [bytes]."""

_HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}


def read_arrays(stored: zipfile.ZipFile, dtypes: dict[str, np.dtype]) -> dict[str, np.ndarray]:
    """Read arrays by their names; nothing is unpickled.

    Raises:
        KeyError: an array is missing.
        ValueError: an array has a wrong type or a false header, or together they exceed a gibibyte.
    """
    left, arrays = MOST_BYTES, {}
    for name, dtype in dtypes.items():
        claimed, size = _claims(stored, name)
        if claimed != dtype:
            raise ValueError(f"its {name} must be {dtype}, got {claimed}")
        left -= size
        if left < 0:
            raise ValueError(f"its arrays must contain at most {MOST_BYTES:,} bytes together")
        arrays[name] = _read(stored, name)
    return arrays


def read_json(stored: zipfile.ZipFile, name: str) -> Any:
    """Parse a text that is stored as an array, as JSON.

    Raises:
        KeyError: the text is missing.
        ValueError: the array is no text, no JSON, or too long.
    """
    claimed, size = _claims(stored, name)
    if claimed.kind != "U" or size > _MOST_WORDS:
        raise ValueError(f"its {name} must be a text of at most {_MOST_WORDS:,} bytes")
    try:
        return json.loads(str(_read(stored, name)))
    except RecursionError:
        raise ValueError(f"its {name} is nested too deeply") from None


def _member(stored: zipfile.ZipFile, name: str) -> zipfile.ZipInfo:
    try:
        return stored.getinfo(f"{name}.npy")
    except KeyError:
        raise KeyError(name) from None


def _claims(stored: zipfile.ZipFile, name: str) -> tuple[np.dtype, int]:
    """Return the type and size [bytes] of an array after checking its header against the archive."""
    member = _member(stored, name)
    with stored.open(member) as packed:
        # A header states its own length, which may be gigabytes that a few bytes unpack to.
        file = io.BytesIO(packed.read(_LONGEST_HEADER))
        version = np.lib.format.read_magic(file)
        if version not in _HEADERS:
            raise ValueError(f"its {name} is of an unknown format {version}")
        shape, _, dtype = _HEADERS[version](file)
        size = math.prod(shape) * dtype.itemsize
        is_true = file.tell() + size == member.file_size <= _DENSEST * (member.compress_size + 1)
        if min(shape, default=0) < 0 or dtype.hasobject or not is_true:
            raise ValueError(f"its {name} has another size than its header states")
    return dtype, size


def _read(stored: zipfile.ZipFile, name: str) -> np.ndarray:
    with stored.open(_member(stored, name)) as file:
        array = np.lib.format.read_array(file, allow_pickle=False)
        file.read(1)  # reading to the end verifies the checksum
        return array
