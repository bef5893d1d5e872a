"""JSON Lines files that only grow; lines are flushed to the disk, and a line that a kill left unfinished is dropped."""

import contextlib
import fcntl
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from lissajous_env.storage.files import open_plainly, parse_json, sync, write_all


class Journal:
    """A JSON Lines file that only grows; its lines are on the disk when `append` returns.

    When the file is opened, a last line that a kill left unfinished is dropped.

    Args:
        path: The file; it is created if it does not exist.
        exclusive: True to lock the file before it is read, until the process ends or closes it.

    Raises:
        BlockingIOError: another process has locked the file.
        ValueError: the file is a link, or a line before the last is damaged; the message names file and line.
    """

    def __init__(self, path: str | Path, exclusive: bool = False):
        self.path = Path(path)
        self.entries: list[dict[str, Any]] = []
        """Entries of the file when it was opened; entry k was on line k + 1."""
        self._end = 0
        self._descriptor = open_plainly(self.path, os.O_RDWR | os.O_APPEND | os.O_CREAT)
        try:
            if exclusive:
                fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._read()
            sync(self.path.parent)
        except BaseException:
            self.close()
            raise

    def _read(self) -> None:
        """Read the entries, and drop an unfinished last line."""
        with open(self._descriptor, "rb", closefd=False) as file:
            file.seek(0)
            data = file.read()
        self.entries, self._end = _intact(data, self.path)
        if self._end < len(data):
            os.ftruncate(self._descriptor, self._end)
            os.fsync(self._descriptor)

    def append(self, entries: Iterable[dict[str, Any]]) -> None:
        """Add one line for each entry, all in one write, and flush them to the disk.

        Raises:
            OSError: the lines cannot be written; then none of them is in the file.
        """
        lines = b"".join(json.dumps(entry, allow_nan=False).encode() + b"\n" for entry in entries)
        try:
            write_all(self._descriptor, lines)
            os.fsync(self._descriptor)
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self._end)
            raise OSError(error.errno, error.strerror or str(error), str(self.path)) from error
        self._end += len(lines)

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)

    def __enter__(self) -> "Journal":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _intact(data: bytes, path: Path) -> tuple[list[dict[str, Any]], int]:
    """Return the entries of JSON Lines, and the position of the end of the last complete line [bytes]."""
    entries: list[dict[str, Any]] = []
    *lines, torn = data.split(b"\n")
    end = 0
    for number, line in enumerate(lines, start=1):
        try:
            entry = parse_json(line, f"{path}, line {number}")
            if not isinstance(entry, dict):
                raise ValueError(f"{path}, line {number} is damaged: it must contain one JSON object")
        except ValueError as error:
            if number == len(lines) and not torn and not _is_json(line):
                break
            what = f"got {line.decode(errors='replace')[:60]!r}; delete that line to create it again"
            raise ValueError(f"{error}; {what}") from None
        entries.append(entry)
        end += len(line) + 1
    return entries, end


def _is_json(line: bytes) -> bool:
    """Return whether a line is complete JSON of any kind; a line that a kill cut off is not."""
    try:
        json.loads(line)
    except RecursionError:
        return True
    except ValueError:
        return False
    return True
