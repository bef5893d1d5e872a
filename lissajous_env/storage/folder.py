"""A folder of results: held by one process, and nothing in it is replaced or removed but what was written there by us.

`.lissajous.jsonl` lists the files that were written, each before it is; so after a kill at any moment it is known what
is ours. It is the lock as well. A file of a user that has the name of a result is refused before any work is done.
"""

import contextlib
import fcntl
import os
import secrets
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath

from lissajous_env.storage.files import moved_into_place, open_plainly, sync, write_into
from lissajous_env.storage.journal import Journal
from lissajous_env.wording import shown

LIST = ".lissajous.jsonl"
"""Name of the list of what was written."""
_BEGINS = b'{"lissajous": '
_LONGEST_NAME = 64
"""Letters that a name in a folder may have, and those of a folder in it."""


class Folder:
    """An out-folder in which this process alone writes; the system frees it however the process ends.

    Args:
        path: The folder; made if it is not there.
        writes: Names of what will be written, those of folders with a slash at their end. Where one of them is there
            and was not written by us, the folder is refused before anything in it is touched.

    Raises:
        ValueError: it cannot be made or written to, is in use by another process, or holds a file of a user, a link or
            a folder under a name that would be written.
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
            self._check_list(list_path)
            self._list = _LockedJournal(list_path, self.path)
        except OSError as error:
            raise ValueError(
                f"out must be a folder that can be written to, got {shown(str(path))}: {error.strerror}"
            ) from error
        try:
            self._token = self._read_list()
            self._check(writes)
            self._remove_leftovers()
            self._check_room_for_names()
            self._list.append([{"process": os.getpid()}])
        except BaseException:
            self._list.close()
            raise

    @property
    def written(self) -> tuple[str, ...]:
        """Names of what was written and not removed, by this process and those before it; in order."""
        return tuple(sorted(self._written))

    def write(self, name: str, data: str | bytes) -> None:
        """Write a file as a whole.

        Args:
            name: Its name in the folder, or in one that `make_folder` made, as in `best/checkpoint.json`.
            data: What it holds.

        Raises:
            ValueError: there is a file of that name which was not written here, or a link.
            OSError: it cannot be written; then the file before it is still there.
        """
        with self.replacing(name) as temporary:
            write_into(temporary, data)

    @contextlib.contextmanager
    def replacing(self, name: str) -> Iterator[Path]:
        """Yield a temporary path to write to; it takes the place of the file if the block ends well."""
        path = self._claim(name)
        # A name that begins with the folder's own word is nobody else's, should it be left over.
        temporary = self.path / f".lissajous-{self._token}{path.suffix}"
        with moved_into_place(temporary, path):
            yield temporary

    def journal(self, name: str) -> Journal:
        """Open a file that only grows."""
        return Journal(self._claim(name))

    def make_folder(self, name: str) -> Path:
        """Make a folder in this one, if it was not made before."""
        path = self._claim(name + "/")
        if not path.is_dir():
            path.mkdir()
            sync(self.path)
        return path

    def remove(self, name: str) -> None:
        """Remove a file that was written here."""
        if name in self._written:
            self._path(name).unlink(missing_ok=True)
            self._list.append([{"removed": name}])
            self._written.remove(name)

    def close(self) -> None:
        """Let go of the folder."""
        self._list.close()

    def __enter__(self) -> "Folder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _claim(self, name: str) -> Path:
        """Put a name on the list before it is written, unless it is somebody else's."""
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
                    f"out must be a folder without a {name.rstrip('/')} of another origin, got {path}, which is not "
                    f"listed in {LIST}; move it, or take another --out"
                )
            if path.is_symlink() or path.is_dir() != name.endswith("/") or not (path.is_dir() or path.is_file()):
                kind = "link" if path.is_symlink() else "folder" if path.is_dir() else "file"
                raise ValueError(f"{path} must be a {'folder' if name.endswith('/') else 'file'}, got a {kind}")

    def _check_room_for_names(self) -> None:
        """Refuse a folder in which nothing can be made, before any work is done for it."""
        tried = self.path / f".lissajous-{self._token}{'-' * _LONGEST_NAME}"
        try:
            os.close(os.open(tried, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
            tried.unlink()
        except OSError as error:
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> ValueError:
        words = f"got {shown(str(self.path))}: {error.strerror}"
        return ValueError(f"out must be a folder that can be written to, {words}")

    def _path(self, name: str) -> Path:
        """Return the path of a name, and require that its folder was made here and is no link."""
        _require_plain(name)
        folder, _, _ = name.rstrip("/").rpartition("/")
        if folder:
            if folder + "/" not in self._written:
                raise ValueError(f"{self.path / folder} must be a folder that was made here, to write {name}")
            self._check([folder + "/"])
        return self.path / name

    def _check_list(self, path: Path) -> None:
        """Refuse a file of another that is called as the list is, before a byte of it is touched."""
        if os.path.lexists(path):
            with open(open_plainly(path, os.O_RDONLY), "rb") as file:
                begin = file.read(len(_BEGINS))
            if not _BEGINS.startswith(begin):
                raise ValueError(f"{path} must be a list of what was written here, got {begin!r}; take another --out")

    def _read_list(self) -> str:
        """Read what was written, and return the folder's own word, which is drawn and listed where there is none."""
        if not self._list.entries:
            token = secrets.token_hex(8)
            self._list.append([{"lissajous": 1, "token": token}])
            return token
        head, *entries = self._list.entries
        token = head.get("token")
        if head.get("lissajous") != 1 or not (isinstance(token, str) and len(token) == 16 and token.isalnum()):
            raise ValueError(
                f"{self._list.path}, line 1 is damaged: it must be of format 1 and hold a token, got {head}"
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
                    raise ValueError(f"{self._list.path}, line {number} must say what was written, got {entry}")
            _require_plain(name)
        return token

    def _remove_leftovers(self) -> None:
        for leftover in self.path.glob(f".lissajous-{self._token}*"):
            if not leftover.is_dir() or leftover.is_symlink():
                leftover.unlink(missing_ok=True)


class _LockedJournal(Journal):
    """A journal that is locked before it is read: what another process is just writing is no torn line."""

    def __init__(self, path: Path, folder: Path):
        self._folder = folder
        super().__init__(path)

    def read(self) -> None:
        if not _try_lock(self._descriptor):
            holder = f"another process ({_holder(self.path)})"
            raise ValueError(f"{self._folder} is in use by {holder}; wait for it or take another folder")
        super().read()


def _require_plain(name: str) -> None:
    """Refuse a name that leads out of the folder or to its list."""
    parts = PurePosixPath(name).parts
    wrong = "\\" in name or ":" in name or name.startswith("/") or len(parts) > 2 or name.rstrip("/") != "/".join(parts)
    if not parts or wrong or any(part in (".", "..") or part.startswith(".lissajous") for part in parts):
        raise ValueError(f"name of a result must be that of a file in its folder, got {name!r}")


def _holder(path: Path) -> str:
    """Process that holds a folder, as its list says."""
    processes = [line for line in path.read_bytes().splitlines() if line.startswith(b'{"process": ')]
    return processes[-1].decode()[12:-1] if processes else "unknown"


def _try_lock(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
