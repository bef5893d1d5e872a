"""What an RLlib training goes on from: numbered folders, each whole or not there, the newest good one counts.

RLlib writes many files, some of them pickles. They are read back by the training that wrote them alone, and only where
every file is as `manifest.json` says; what is published of a policy is the project's own `training.checkpoint`.
"""

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from lissajous_env.files import write_atomically

MANIFEST = "manifest.json"
_KEPT = 3
"""Folders that are kept."""


def save(folder: Path, write: Callable[[Path], None], notes: Mapping[str, Any]) -> Path:
    """Add a checkpoint, and remove the oldest of more than three; a kill at any moment loses this one at most.

    Args:
        folder: Where the numbered folders are; made if it is not there.
        write: Writes the files of the checkpoint into an empty folder that it is given.
        notes: What `newest` returns, as JSON holds it.

    Returns:
        The folder of the checkpoint.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for leftover in folder.glob(".*.tmp"):
        shutil.rmtree(leftover)
    there = _numbered(folder)
    name = f"{int(there[-1].name) + 1 if there else 1:06d}"
    temporary = folder / f".{name}.tmp"
    temporary.mkdir()
    write(temporary)
    digests = _digests(temporary)
    for path in [*(temporary / name for name in digests), *(each for each in temporary.rglob("*") if each.is_dir())]:
        _flush(path)
    write_atomically(temporary / MANIFEST, json.dumps({"files": digests, "notes": dict(notes)}, indent=1) + "\n")
    os.replace(temporary, folder / name)
    _flush(folder)
    for old in there[: 1 - _KEPT]:
        shutil.rmtree(old)
    return folder / name


def newest(folder: Path, warn: Callable[[str], None]) -> tuple[Path, dict[str, Any]] | None:
    """Return the newest good checkpoint and its notes, or None where there is none.

    A damaged one is passed over, and `warn` is told which.

    Raises:
        ValueError: there are some, and all are damaged.
    """
    there = _numbered(folder)
    for path in reversed(there):
        try:
            manifest = json.loads((path / MANIFEST).read_text(encoding="utf-8"))
            if manifest["files"] == _digests(path):
                return path, manifest["notes"]
        except (OSError, ValueError, KeyError, TypeError):
            pass
        warn(f"{path} is damaged, going on from the checkpoint before it")
    if there:
        raise ValueError(f"{folder} must hold a checkpoint that is not damaged; take another --out, or delete it")
    return None


def _numbered(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*") if path.name.isdigit()) if folder.is_dir() else []


def _digests(folder: Path) -> dict[str, str]:
    """SHA-256 of each file of a checkpoint, by its path in the folder."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != MANIFEST)
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def _flush(path: Path) -> None:
    """Flush a file or a folder's list of names to the disk, where the system knows how to."""
    if os.name != "nt":
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
