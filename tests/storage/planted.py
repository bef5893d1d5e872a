"""Pickles that say so when they are opened, and what a stranger puts them in place of."""

import contextlib
import hashlib
import io
import os
import pickle
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np


class Planted:
    """Unpickled, it makes a folder."""

    def __init__(self, marker: Path):
        self.marker = str(marker)

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return os.makedirs, (self.marker,)


def payloads(marker: Path) -> dict[str, bytes]:
    """The pickle as it is, as torch and Stable-Baselines3 pack it, and as NumPy does, alone and among others."""
    planted = Planted(marker)
    plain = pickle.dumps(planted)
    archive, array, arrays = io.BytesIO(), io.BytesIO(), io.BytesIO()
    with zipfile.ZipFile(archive, "w") as packed:
        for name in ("archive/data.pkl", "archive/version", "data", "policy.pth", "pytorch_variables.pth"):
            packed.writestr(name, plain)
    objects = np.array([planted], dtype=object)
    np.save(array, objects, allow_pickle=True)
    np.savez(arrays, about=objects, position=objects)
    return {"plain": plain, "archive": archive.getvalue(), "npy": array.getvalue(), "npz": arrays.getvalue()}


def opened(marker: Path) -> bool:
    """Return whether the pickle was opened, and reset the mark."""
    there = os.path.isdir(marker)
    shutil.rmtree(marker, ignore_errors=True)
    return there


def plant(path: Path, data: bytes) -> None:
    """Put bytes in place of a file, and their SHA-256 in place of its own where a manifest has that."""
    before = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    for manifest in (folder / "manifest.json" for folder in list(path.parents)[:6]):
        with contextlib.suppress(OSError, UnicodeDecodeError):
            if before is not None and before in (text := manifest.read_text(encoding="utf-8")):
                manifest.write_text(text.replace(before, hashlib.sha256(data).hexdigest()), encoding="utf-8")
