"""A folder of results in which one process writes, and which replaces and removes only the files that it wrote.

`.lissajous.jsonl` lists these files. Each is listed before it is written, so the list is complete after a kill at any
moment. The list is also the lock. If a file of a user has the name of a result, an error is raised before any work is
done.
"""

import contextlib
import os
import secrets
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath

from lissajous_env.storage.files import open_plainly, replacing, sync, write_atomically
from lissajous_env.storage.journal import Journal
from lissajous_env.wording import shown

LIST = ".lissajous.jsonl"
"""Name of the list of the files that were written."""
_BEGINS = b'{"lissajous": '


class Folder:
    """An output folder in which only this process writes; the system unlocks it however the process ends.

    Args:
        path: The folder; it is created if it does not exist.
        writes: Names of the files and folders that will be written; those of folders end in a slash. If one of them
            exists and was not written by this package, an error is raised before anything in the folder changes.

    Raises:
        ValueError: the folder cannot be created or written to, is in use by another process, or has a file of a user, a
            link or a folder under a name that would be written.
    """

    def __init__(self, path: str | Path, writes: Iterable[str] = ()):
        self.path = Path(path)
        writes = tuple(writes)
        self._written: set[str] = set()
        list_path = self.path / LIST
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            if not os.path.lexists(list_path):
                self._check(writes)
            self._list = self._locked_list(list_path)
        except OSError as error:
            words = f"got {shown(str(self.path))}: {error.strerror}"
            raise ValueError(f"out must be a folder that can be written to, {words}") from error
        try:
            self._token = self._read_list()
            self._check(writes)
            self._remove_leftovers()
            self._list.append([{"process": os.getpid()}])
        except BaseException:
            self._list.close()
            raise

    @property
    def written(self) -> tuple[str, ...]:
        """Sorted names of the files that this process and earlier ones wrote and did not remove."""
        return tuple(sorted(self._written))

    def write(self, name: str, data: str | bytes) -> None:
        """Write a file as a whole.

        Args:
            name: Its name in the folder, or in one that `make_folder` made, as in `best/checkpoint.json`.
            data: Its contents.

        Raises:
            ValueError: a file of that name exists that this package did not write, or it is a link.
            OSError: the file cannot be written; its earlier version is unchanged.
        """
        path = self._claim(name)
        write_atomically(path, data, self._temporary(path))

    @contextlib.contextmanager
    def replacing(self, name: str) -> Iterator[Path]:
        """Yield a temporary path to write to; it replaces the file if the block raises no error."""
        path = self._claim(name)
        with replacing(path, self._temporary(path)) as temporary:
            yield temporary

    def journal(self, name: str) -> Journal:
        """Open a file that only grows."""
        return Journal(self._claim(name))

    def make_folder(self, name: str) -> Path:
        """Create a folder in this one if it does not exist, and return its path."""
        path = self._claim(name + "/")
        if not path.is_dir():
            path.mkdir()
            sync(self.path)
        return path

    def remove(self, name: str) -> None:
        """Remove a file that was written by this package; other files are left alone."""
        if name in self._written:
            self._path(name).unlink(missing_ok=True)
            self._list.append([{"removed": name}])
            self._written.remove(name)

    def close(self) -> None:
        """Unlock the folder."""
        self._list.close()

    def __enter__(self) -> "Folder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _claim(self, name: str) -> Path:
        """List a name before its file is written, and return its path; names of other origin raise an error."""
        self._check([name])
        if name not in self._written:
            self._list.append([{"wrote": name}])
            self._written.add(name)
        return self._path(name)

    def _check(self, names: Iterable[str]) -> None:
        for name in names:
            path = self._path(name)
            if not os.path.lexists(path):
                continue
            if name not in self._written:
                raise ValueError(
                    f"out must be a folder without a {name.rstrip('/')} that another program wrote, got {path}, "
                    f"which is not listed in {LIST}; move it, or choose another --out"
                )
            if path.is_symlink() or path.is_dir() != name.endswith("/") or not (path.is_dir() or path.is_file()):
                kind = "link" if path.is_symlink() else "folder" if path.is_dir() else "file"
                raise ValueError(f"{path} must be a {'folder' if name.endswith('/') else 'file'}, got a {kind}")

    def _temporary(self, path: Path) -> Path:
        """Return a temporary path for a file; the token shows that one that is left over belongs to this folder."""
        return self.path / f".lissajous-{self._token}{path.suffix}"

    def _path(self, name: str) -> Path:
        """Return the path of a name, and require that its folder was made here and is no link."""
        _require_plain(name)
        folder, _, _ = name.rstrip("/").rpartition("/")
        if folder:
            if folder + "/" not in self._written:
                raise ValueError(f"{self.path / folder} must be a folder that was made here, to write {name}")
            self._check([folder + "/"])
        return self.path / name

    def _locked_list(self, path: Path) -> Journal:
        """Open and lock the list; a file of other origin with its name is refused before it is changed."""
        if os.path.lexists(path):
            with open(open_plainly(path, os.O_RDONLY), "rb") as file:
                begin = file.read(len(_BEGINS))
            if not _BEGINS.startswith(begin):
                raise ValueError(
                    f"{path} must be a list of the files written here, got {begin!r}; choose another --out"
                )
        try:
            return Journal(path, exclusive=True)
        except BlockingIOError:
            user = f"another process ({_user_of(path)})"
            raise ValueError(f"{self.path} is in use by {user}; wait for it or choose another folder") from None

    def _read_list(self) -> str:
        """Read the names of the files that were written, and return the folder's token, which a new folder draws."""
        if not self._list.entries:
            token = secrets.token_hex(8)
            self._list.append([{"lissajous": 1, "token": token}])
            return token
        head, *entries = self._list.entries
        token = head.get("token")
        if head.get("lissajous") != 1 or not (isinstance(token, str) and len(token) == 16 and token.isalnum()):
            raise ValueError(
                f"{self._list.path}, line 1 is damaged: it must be of format 1 and contain a token, got {head}"
            )
        for number, entry in enumerate(entries, start=2):
            match entry:
                case {"wrote": str(name)}:
                    self._written.add(name)
                case {"removed": str(name)}:
                    self._written.discard(name)
                case {"process": int()}:
                    continue
                case _:
                    raise ValueError(f"{self._list.path}, line {number} must contain what was written, got {entry}")
            _require_plain(name)
        return token

    def _remove_leftovers(self) -> None:
        for leftover in self.path.glob(f".lissajous-{self._token}*"):
            if not leftover.is_dir() or leftover.is_symlink():
                leftover.unlink(missing_ok=True)


def _require_plain(name: str) -> None:
    """Raise an error for a name that leads out of the folder or to its list."""
    parts = PurePosixPath(name).parts
    wrong = "\\" in name or ":" in name or name.startswith("/") or len(parts) > 2 or name.rstrip("/") != "/".join(parts)
    if not parts or wrong or any(part in (".", "..") or part.startswith(".lissajous") for part in parts):
        raise ValueError(f"name of a result must be that of a file in its folder, got {name!r}")


def _user_of(path: Path) -> str:
    """Return the number of the process that uses a folder, from its list."""
    processes = [line for line in path.read_bytes().splitlines() if line.startswith(b'{"process": ')]
    return processes[-1].decode()[12:-1] if processes else "unknown"
