"""A folder of results in which one process writes, and JSON Lines files that only grow.

A folder replaces and removes only the files that it wrote. `.lissajous.jsonl` lists these files. Each is listed before
it is written, so the list is complete after a kill at any moment. The list is also the lock. If a file of a user has
the name of a result, an error is raised before any work is done.

Lines of a file that grows are flushed to the disk, and a line that a kill left unfinished is dropped.
"""

import contextlib
import fcntl
import json
import os
import sys
from collections.abc import Collection, Iterable
from pathlib import Path, PurePosixPath
from typing import Any

from lissajous_env.storage.files import open_plainly, parse_json, read_bytes, sync, write_atomically
from lissajous_env.wording import shown

LIST = ".lissajous.jsonl"
"""Name of the list of the files that were written."""
_HEAD = {"lissajous": 1}
"""First entry of the list."""
_BEGINS = json.dumps(_HEAD).encode()
_TEMPORARY = ".lissajous-writing"
"""Name of a file that is being written, before its suffix."""


class Journal:
    """A JSON Lines file that only grows; its lines are on the disk when `append` returns.

    It is created if it does not exist, and locked until the process ends or closes it. `entries` are those of the file
    when it was opened; then a last line that a kill left unfinished is dropped, and `torn` is its length [bytes].

    Raises:
        BlockingIOError: another process has locked the file.
        ValueError: the file is a link, or a finished line is damaged; the message names file and line.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self._descriptor = open_plainly(self.path, os.O_RDWR | os.O_APPEND | os.O_CREAT)
        with contextlib.ExitStack() as on_error:
            on_error.callback(self.close)
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.entries, self.torn = read_lines(self.path)
            self._end = os.fstat(self._descriptor).st_size - self.torn
            if self.torn:
                os.ftruncate(self._descriptor, self._end)
                os.fsync(self._descriptor)
            sync(self.path.parent)
            on_error.pop_all()

    def append(self, entries: Iterable[dict[str, Any]]) -> None:
        """Add one line for each entry, all in one write, and flush them to the disk.

        Raises:
            OSError: the lines cannot be written; then none of them is in the file.
        """
        lines = b"".join(json.dumps(entry, allow_nan=False).encode() + b"\n" for entry in entries)
        try:
            left = memoryview(lines)
            while left:
                left = left[os.write(self._descriptor, left) :]
            os.fsync(self._descriptor)
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, self._end)
            raise OSError(error.errno, error.strerror or str(error), str(self.path)) from error
        self._end += len(lines)

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)


class Folder(contextlib.ExitStack):
    """An output folder in which only this process writes; the system unlocks it however the process ends.

    Its end, or `close`, unlocks it and closes its files that grow.

    Args:
        path: The folder; it is created if it does not exist.
        writes: Names of the files and folders that will be written; those of folders end in a slash. If one of them
            exists and was not written by this package, an error is raised before anything in the folder changes.

    Raises:
        ValueError: the folder cannot be created or written to, is in use by another process, or has a file of a user, a
            link or a folder under a name that would be written.
    """

    def __init__(self, path: str | Path, writes: Collection[str] = ()):
        super().__init__()
        self.path = Path(path)
        self._written: set[str] = set()
        list_path = self.path / LIST
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            for name in writes if not os.path.lexists(list_path) else ():
                self._checked(name)
            _require_list(list_path)
            self._list = Journal(list_path)
        except BlockingIOError:
            raise ValueError(
                f"{self.path} is in use by another process; wait for it or choose another folder"
            ) from None
        except OSError as error:
            words = f"got {shown(str(self.path))}: {error.strerror}"
            raise ValueError(f"out must be a folder that can be written to, {words}") from error
        with contextlib.ExitStack() as on_error:
            on_error.callback(self._list.close)
            self._read_list()
            for name in writes:
                self._checked(name)
            for leftover in self.path.glob(f"{_TEMPORARY}*"):
                leftover.unlink()
            self.push(on_error.pop_all())

    @property
    def written(self) -> tuple[str, ...]:
        """Sorted names of the files that this process and earlier ones wrote and did not remove."""
        return tuple(sorted(self._written))

    def write(self, name: str, data: str | bytes) -> None:
        """Write a file as a whole.

        Args:
            name: Its name in the folder, or in one inside it, which is created, as in `best/checkpoint.safetensors`.
            data: Its contents.

        Raises:
            ValueError: a file of that name exists that this package did not write, or it is a link.
            OSError: the file cannot be written; its earlier version is unchanged.
        """
        path = self._claim(name)
        if not path.parent.is_dir():
            self._claim(f"{path.parent.name}/").mkdir()
            sync(self.path)
        write_atomically(path, data, self.path / f"{_TEMPORARY}{path.suffix}")

    def journal(self, name: str) -> Journal:
        """Open a file that only grows."""
        journal = Journal(self._claim(name))
        self.callback(journal.close)
        return journal

    def remove(self, name: str) -> None:
        """Remove a file that was written by this package; other files are left alone."""
        if name in self._written:
            self._checked(name).unlink(missing_ok=True)
            self._list.append([{"removed": name}])
            self._written.remove(name)

    def _claim(self, name: str) -> Path:
        """List a name before its file is written, and return its path; names of other origin raise an error."""
        path = self._checked(name)
        if name not in self._written:
            self._list.append([{"wrote": name}])
            self._written.add(name)
        return path

    def _checked(self, name: str) -> Path:
        """Return the path of a name; it and its folder must be missing, or have been written here and be no link."""
        _require_plain(name)
        if folder := name.rstrip("/").rpartition("/")[0]:
            self._checked(f"{folder}/")
        path = self.path / name
        if not os.path.lexists(path):
            return path
        if name not in self._written:
            raise ValueError(
                f"out must be a folder without a {name.rstrip('/')} that another program wrote, got {path}, which is "
                f"not listed in {LIST}; move it, or choose another --out"
            )
        if path.is_symlink() or path.is_dir() != name.endswith("/") or not (path.is_dir() or path.is_file()):
            kind = "link" if path.is_symlink() else "folder" if path.is_dir() else "file"
            raise ValueError(f"{path} must be a {'folder' if name.endswith('/') else 'file'}, got a {kind}")
        return path

    def _read_list(self) -> None:
        """Read the names of the files that were written."""
        if not self._list.entries:
            self._list.append([_HEAD])
        for number, entry in enumerate(self._list.entries[1:], start=2):
            match entry:
                case {"wrote": str(name)}:
                    self._written.add(name)
                case {"removed": str(name)}:
                    self._written.discard(name)
                case _:
                    raise ValueError(f"{self._list.path}, line {number} must contain what was written, got {entry}")
            _require_plain(name)


def read_lines(path: Path) -> tuple[list[dict[str, Any]], int]:
    """Read the entries of a file that only grows, without a lock, and the length of an unfinished last line [bytes].

    Raises:
        ValueError: the file is missing or a link, or a finished line is damaged; the message names file and line.
    """
    *lines, torn = read_bytes(path, sys.maxsize).split(b"\n")
    entries = []
    for number, line in enumerate(lines, start=1):
        place = f"{path}, line {number}"
        try:
            entry = parse_json(line, place)
            if not isinstance(entry, dict):
                raise ValueError(f"{place} is damaged: it must contain one JSON object")
        except ValueError as error:
            got = f"got {line.decode(errors='replace')[:60]!r}; delete that line to create it again"
            raise ValueError(f"{error}; {got}") from None
        entries.append(entry)
    return entries, len(torn)


def _require_list(path: Path) -> None:
    """Raise an error for a file of other origin with the name of the list."""
    if os.path.lexists(path):
        with open(open_plainly(path, os.O_RDONLY), "rb") as file:
            begin = file.read(len(_BEGINS))
        if not _BEGINS.startswith(begin):
            raise ValueError(f"{path} must be a list of the files written here, got {begin!r}; choose another --out")


def _require_plain(name: str) -> None:
    """Raise an error for a name that leads out of the folder or to its list."""
    parts = PurePosixPath(name).parts
    wrong = "\\" in name or ":" in name or name.startswith("/") or len(parts) > 2 or name.rstrip("/") != "/".join(parts)
    if not parts or wrong or any(part in (".", "..") or part.startswith(".lissajous") for part in parts):
        raise ValueError(f"name of a result must be that of a file in its folder, got {name!r}")
