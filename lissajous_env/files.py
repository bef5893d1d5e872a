"""Files that survive a kill at any moment: replaced as a whole, or appended line by line; and a lock on a folder."""

import contextlib
import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

if os.name == "nt":
    import msvcrt
else:
    import fcntl

_LOCK_AT = 1 << 30
"""Byte that is locked where a file is locked by ranges: far behind the text, which others may go on reading."""


def write_atomically(path: str | Path, data: str | bytes) -> None:
    """Write a file under a temporary name in its folder, flush it to the disk, then rename it into place."""
    with replacing(path) as temporary:
        temporary.write_bytes(data.encode() if isinstance(data, str) else data)


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` to write to; it takes the place of `path` if the block ends well.

    The temporary name ends in the same suffix, so that libraries which choose a format by it work.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")
    try:
        yield temporary
        # Windows flushes only what was opened for writing.
        with open(temporary, "r+b") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
        _sync_folder(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def remove_leftovers(folder: str | Path) -> None:
    """Remove the temporary files that a killed process left in a folder; only under its lock."""
    for leftover in Path(folder).glob(".*.tmp*"):
        leftover.unlink(missing_ok=True)


@contextlib.contextmanager
def locked(folder: str | Path) -> Iterator[None]:
    """Hold a folder for this process; the system frees it however the process ends.

    Raises:
        ValueError: another process holds it.
    """
    path = Path(folder) / ".lock"
    with open(path, "a+b") as file:
        if not _try_lock(file.fileno()):
            file.seek(0)
            holder = file.read(32).decode(errors="replace").strip() or "unknown"
            raise ValueError(f"{folder} is in use by another process ({holder}); wait for it or take another folder")
        file.truncate(0)
        file.write(f"{os.getpid()}\n".encode())
        file.flush()
        yield


class Journal:
    """A JSON Lines file that only grows: what `append` has returned from is on the disk.

    Opening it drops a last line that a kill left unfinished.

    Raises:
        ValueError: a line before the last is damaged; the message names file and line.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self.entries: list[dict[str, Any]] = []
        """What the file held when it was opened: entry k was on line k + 1."""
        data = self.path.read_bytes() if self.path.exists() else b""
        lines = data.split(b"\n")
        intact = 0
        for number, line in enumerate(lines, start=1):
            ends = number < len(lines)
            is_last = number == len(lines) or (number == len(lines) - 1 and not lines[-1])
            entry = _parsed(line) if ends else None
            if entry is None and not is_last:
                raise ValueError(
                    f"{self.path}, line {number} is damaged: it must hold one JSON object, got {_shortened(line)}; "
                    "delete that line to have it made again"
                )
            if entry is None:
                break
            self.entries.append(entry)
            intact += len(line) + 1
        self._file = open(self.path, "ab")  # noqa: SIM115 - closed by close()
        if intact < len(data):
            self._file.truncate(intact)
            os.fsync(self._file.fileno())
        _sync_folder(self.path.parent)

    def append(self, entries: Iterable[dict[str, Any]]) -> None:
        """Add one line for each entry, all in one write, and flush them to the disk."""
        self._file.write(b"".join(json.dumps(entry, allow_nan=False).encode() + b"\n" for entry in entries))
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _parsed(line: bytes) -> dict[str, Any] | None:
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return entry if isinstance(entry, dict) else None


def _shortened(line: bytes) -> str:
    return repr(line.decode(errors="replace")[:60])


def _try_lock(descriptor: int) -> bool:
    try:
        if os.name == "nt":
            os.lseek(descriptor, _LOCK_AT, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _sync_folder(folder: Path) -> None:
    """Flush a folder's list of names, where the system knows how to."""
    if os.name != "nt":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
