"""Files that survive a kill at any moment, never overwrite a file of a user, and are read strictly.

A file is replaced as a whole. A link is replaced too and never followed. `lissajous_env.storage.folder` is for files
that belong together, or only grow.
"""

import contextlib
import errno
import json
import math
import os
import secrets
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lissajous_env.wording import shown

_DEEPEST = 100
_WITHOUT_LINKS = os.O_NOFOLLOW | os.O_NONBLOCK
"""Flags of `os.open` with which it does not follow a link or wait for a pipe."""


def parse_json(text: bytes | str, source: str | Path) -> Any:
    """Read JSON strictly, so that all of its numbers are finite and it can be written again.

    Args:
        text: The JSON, in UTF-8.
        source: The place where it was found, for the message.

    Raises:
        ValueError: the text is not JSON, contains NaN, infinity or a number that is too large for a float, or nests
            more than 100 objects and lists.
    """
    try:
        text = text.decode() if isinstance(text, bytes) else text
        value = json.loads(text, parse_constant=_number, parse_float=_number, parse_int=_whole)
        if _depth(value) > _DEEPEST:
            raise RecursionError
    except RecursionError:
        raise ValueError(f"{source} is damaged: it must nest at most {_DEEPEST} levels, got more") from None
    except ValueError as error:
        raise ValueError(f"{source} is damaged: {error}") from None
    return value


def read_bytes(path: str | Path, largest: int) -> bytes:
    """Read a file that is not a link.

    Raises:
        ValueError: the file is missing, not a plain file, or larger than `largest` [bytes]; the message names it.
    """
    path = Path(path)
    try:
        descriptor = open_plainly(path, os.O_RDONLY)
    except FileNotFoundError:
        raise ValueError(f"{path} is missing") from None
    except OSError as error:
        raise ValueError(f"{path} must be a file that can be read: {error.strerror}") from None
    with open(descriptor, "rb") as file:
        size = os.fstat(descriptor).st_size
        if size > largest:
            raise ValueError(f"{path} must be at most {largest:,} bytes, got {size:,}")
        return file.read()


@contextlib.contextmanager
def undamaged(path: str | Path, kind: str) -> Iterator[None]:
    """Name a file of a kind in any error of a block that reads it: damaged bytes make libraries raise almost any.

    Raises:
        ValueError: an error that is none of the file system, with its reason.
    """
    try:
        yield
    except Exception as error:
        if isinstance(error, OSError) and error.filename is not None:
            raise
        reason = str(error).partition("\n")[0] or type(error).__name__
        if isinstance(error, KeyError):
            reason = f"it lacks {str(error.args[0]).removesuffix(' is not a file in the archive')}"
        raise ValueError(f"{path} must be an undamaged {kind}, but {reason}") from error


def open_plainly(path: Path, flags: int) -> int:
    """Open a plain file that is not a link to another one, and return its descriptor.

    Raises:
        ValueError: the path is a symbolic link, a folder or a pipe, or `flags` open it for writing and the file has a
            second name.
        OSError: the file cannot be opened.
    """
    wrong = f"{path} must be a plain file, got a"
    if "\0" in str(path):
        raise ValueError(f"{wrong} name with a null character")
    try:
        descriptor = os.open(path, flags | _WITHOUT_LINKS, 0o666)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EISDIR, errno.ENXIO):
            raise ValueError(f"{wrong} link, folder or pipe") from None
        raise
    about = os.fstat(descriptor)
    written = flags & (os.O_WRONLY | os.O_RDWR)
    if not stat.S_ISREG(about.st_mode) or (written and about.st_nlink > 1):
        os.close(descriptor)
        raise ValueError(f"{wrong} {'hard link' if stat.S_ISREG(about.st_mode) else 'folder or pipe'}")
    return descriptor


def check_writable_file(path: str | Path) -> None:
    """Raise an error for a file that cannot be written, before any work is done for it.

    Raises:
        ValueError: the path is a folder, its parent folder is missing, or that folder cannot be written to.
    """
    path = Path(path)
    try:
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            os.lstat(path)  # unlike a missing name, one that is too long raises
        if path.is_dir():
            raise ValueError(f"out must be a file, got the folder {path}")
        if not path.absolute().parent.is_dir():
            raise ValueError(f"out must be in an existing folder, got {path}")
        # Permissions are not enough: the folder may be on a full or read-only disk.
        tempfile.TemporaryFile(dir=path.absolute().parent).close()
    except OSError as error:
        words = f"got {shown(str(path))}: {error.strerror}"
        raise ValueError(f"out must be in a folder that can be written to, {words}") from None


def write_atomically(path: str | Path, data: str | bytes, temporary: Path | None = None) -> None:
    """Write a file under a temporary name in its folder, flush it to the disk, then rename it into place."""
    with replacing(path, temporary) as file:
        file.write_bytes(data.encode() if isinstance(data, str) else data)


@contextlib.contextmanager
def replacing(path: str | Path, temporary: Path | None = None) -> Iterator[Path]:
    """Yield a temporary path on the disk of `path`; the file replaces `path` if the block raises no error.

    The temporary file is new and empty, so no other file is overwritten. By default its name is in the folder of `path`
    and has the same suffix, so that libraries that choose a format by the suffix work.

    Raises:
        OSError: the file cannot be written; the message names `path`.
    """
    path = Path(path)
    temporary = temporary or _temporary(path)
    try:
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        try:
            yield temporary
            sync(temporary)
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        sync(path.parent)
    except OSError as error:
        if error.filename in (None, temporary, str(temporary)):
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
        raise


def sync(path: Path) -> None:
    """Flush a file, or the names in a folder, to the disk; an error names it."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        os.close(descriptor)


def _temporary(path: Path) -> Path:
    return path.with_name(f".lissajous-{secrets.token_hex(8)}{path.suffix}")


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"it must contain only finite numbers, got {text[:20]}")
    return value


def _whole(text: str) -> int:
    _number(text)
    return int(text)


def _depth(value: Any) -> int:
    """Return the number of levels of nested objects and lists."""
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else None
    return 0 if inside is None else 1 + max(map(_depth, inside), default=0)
