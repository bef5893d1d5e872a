"""Messages of rosbag2 files (MCAP) or folders, by topic."""

import contextlib
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from lissajous_env.logs.ros_types import rosbags, type_store

_ENCODING = re.compile(r"[A-Za-z][\w-]*")


class Message(NamedTuple):
    """A message as it was recorded."""

    bag: int
    """Number of its file among those of the log."""
    logged: float
    """Time of the recorder [s]."""
    kind: str
    """Its type."""
    content: Any
    """The message."""


class Bags:
    """The files of a log, open while this is entered.

    Args:
        paths: Files (.mcap) or folders of rosbag2.

    Attributes:
        kinds: Types of each topic's messages; a topic may have several.
        ignored: Number of messages that were passed over, by topic and type.

    Raises:
        MissingExtraError: rosbags, of the extra `logs`, is not installed.
        ValueError: a file is damaged or no log.
        OSError: a file cannot be read.
    """

    def __init__(self, paths: Sequence[Path]):
        self._library, self.paths = rosbags(), tuple(paths)
        self._store = type_store()  # of ROS alone: the types that a file defines are not compiled
        self._readers: list[Any] = []
        self.kinds: dict[str, set[str]] = {}
        self.ignored: Counter[tuple[str, str]] = Counter()
        self._open = contextlib.ExitStack()

    def __enter__(self) -> "Bags":
        for path in self.paths:
            if not path.exists():
                raise FileNotFoundError(2, "there is no such log", str(path))
            with _undamaged(path):
                reader = self._open.enter_context(self._library.Reader(path))
            self._readers.append(reader)
            for connection in reader.connections:
                self.kinds.setdefault(connection.topic, set()).add(connection.msgtype)
        return self

    def __exit__(self, *_: Any) -> None:
        self._open.close()

    def of(self, topic: str, kinds: Sequence[str]) -> Iterator[Message]:
        """Read the messages of a topic that are of some types, file by file in the order of their recording.

        Messages of other types are counted in `ignored`.
        """
        for bag, reader in enumerate(self._readers):
            known = []
            for connection in reader.connections:
                if connection.topic == topic and connection.msgtype in kinds:
                    known.append(connection)
                elif connection.topic == topic and connection.msgcount:
                    self.ignored[topic, connection.msgtype] += connection.msgcount
            with _undamaged(self.paths[bag]):
                for connection, logged, raw in reader.messages(known) if known else ():
                    content = self._store.deserialize_cdr(raw, connection.msgtype)
                    yield Message(bag, logged / 1e9, connection.msgtype, content)

    def holders(self, topic: str) -> list[int]:
        """Return the numbers of the files that contain a topic."""
        return [bag for bag, reader in enumerate(self._readers) if any(c.topic == topic for c in reader.connections)]


@contextlib.contextmanager
def _undamaged(path: Path) -> Iterator[None]:
    """Name the file in any error of the library, which damaged bytes make raise almost any."""
    try:
        yield
    except (OSError, GeneratorExit):
        raise
    except Exception as error:
        # The library looks up the encoding of each channel's schema.
        encoding = error.args[0] if isinstance(error, KeyError) and error.args else None
        if isinstance(encoding, str) and _ENCODING.fullmatch(encoding):
            rule = "must contain only channels whose schemas have the encoding ros2msg or ros2idl, as ROS 2 writes them"
            raise ValueError(f"{path} {rule}, got one of {encoding}: leave it out of the recording") from error
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise ValueError(f"{path} must be an undamaged rosbag2 file (.mcap) or folder, but {reason}") from error
