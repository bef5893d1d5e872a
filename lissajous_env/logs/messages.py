"""Messages of rosbag2 files (MCAP) or folders, by topic."""

import contextlib
import functools
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lissajous_env.plugins import missing


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
        kinds: Types of each topic's messages; a topic may have several. A type of another encoding than that of ROS 2
            has it in its name.
        ignored: Number of messages that were passed over, by topic and reason.

    Raises:
        MissingExtraError: rosbags, of the extra `logs`, is not installed.
        ValueError: a file is damaged or no log.
        OSError: a file cannot be read.
    """

    def __init__(self, paths: Sequence[Path]):
        self._library, self.paths = rosbags(), tuple(paths)
        self._store = type_store()  # of ROS alone: the types that a file defines are not compiled
        self._readers: list[list[Any]] = []
        self.kinds: dict[str, set[str]] = {}
        self.ignored: Counter[tuple[str, str]] = Counter()
        self._open = contextlib.ExitStack()

    def __enter__(self) -> "Bags":
        for path in self.paths:
            if not path.exists():
                raise FileNotFoundError(2, "there is no such log", str(path))
            with _undamaged(path), _any_encoding():
                self._readers.append(self._opened(path))
            for connection in self._connections(-1):
                kind = _kind_of(connection)
                self.kinds.setdefault(connection.topic, set()).add(kind)
                if kind != connection.msgtype and connection.msgcount:
                    self.ignored[connection.topic, f"type {kind} is not understood"] += connection.msgcount
        return self

    def __exit__(self, *_: Any) -> None:
        self._open.close()

    def _opened(self, path: Path) -> list[Any]:
        """Return the readers of a file, or of those of a folder: its list of topics may have types that are refused."""
        files = sorted(path.glob("*.mcap")) if path.is_dir() else []
        return [self._open.enter_context(self._library.Reader(file)) for file in files or [path]]

    def _connections(self, bag: int) -> list[Any]:
        return [connection for reader in self._readers[bag] for connection in reader.connections]

    def of(self, topic: str, kinds: Sequence[str]) -> Iterator[Message]:
        """Read the messages of a topic that are of some types, file by file in the order of their recording.

        Messages of other types, and those that are cut off or damaged, are counted in `ignored`.
        """
        for bag, readers in enumerate(self._readers):
            for connection in self._connections(bag):
                unknown = connection.msgtype not in kinds and _kind_of(connection) == connection.msgtype
                if connection.topic == topic and connection.msgcount and unknown:
                    self.ignored[topic, f"type {connection.msgtype} is not understood there"] += connection.msgcount
            for reader in readers:
                known = [c for c in reader.connections if c.topic == topic and _kind_of(c) in kinds]
                with _undamaged(self.paths[bag]):
                    for connection, logged, raw in reader.messages(known) if known else ():
                        kind = connection.msgtype
                        try:
                            content = self._store.deserialize_cdr(raw, kind)
                        except Exception:  # damaged bytes make the library raise almost any
                            self.ignored[topic, f"they are cut off or damaged messages of type {kind}"] += 1
                        else:
                            yield Message(bag, logged / 1e9, kind, content)

    def holders(self, topic: str) -> list[int]:
        """Return the numbers of the files that contain a topic."""
        return [bag for bag in range(len(self.paths)) if any(c.topic == topic for c in self._connections(bag))]


def _kind_of(connection: Any) -> str:
    """Return the type of a channel's messages, with their encoding if it is not that of ROS 2."""
    encoding = connection.ext.serialization_format
    return connection.msgtype if encoding == "cdr" else f"{connection.msgtype} in the encoding {encoding}"


@contextlib.contextmanager
def _undamaged(path: Path) -> Iterator[None]:
    """Name the file in any error of the library, which damaged bytes make raise almost any."""
    try:
        yield
    except (OSError, GeneratorExit):
        raise
    except Exception as error:
        reason = str(error).partition("\n")[0] or type(error).__name__
        raise ValueError(f"{path} must be an undamaged rosbag2 file (.mcap) or folder, but {reason}") from error


def rosbags() -> Any:
    """Return the module of rosbags that reads and writes logs.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        from rosbags import rosbag2
    except ImportError as error:
        raise missing("a log (.mcap)", "logs", error) from error
    return rosbag2


@functools.cache
def type_store() -> Any:
    """Return the message types of ROS 2 Humble, which later distributions have too."""
    rosbags()
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def blank(kind: str) -> Any:
    """Return a message of a type whose fields are zeros and empty, as those of ROS are at first."""
    _, fields = type_store().fielddefs[kind]
    return type_store().types[kind](**{name: _zero(*field) for name, field in fields})


def _zero(node: Any, about: Any) -> Any:
    """Return the first value of a field, by its kind and what it is about: a type, or a type and a size."""
    if node.name == "NAME":
        return blank(about)
    if node.name == "BASE":
        return {"string": "", "bool": False}.get(about[0], 0)
    (entry, of_entry), size = about
    return np.zeros(size, of_entry[0]) if entry.name == "BASE" and of_entry[0] != "string" else []


@contextlib.contextmanager
def _any_encoding() -> Iterator[None]:
    """Let the library open files in which some channels have another encoding than those of ROS 2.

    It would refuse the whole file because of the schema of such a channel. No schema is needed here.
    """
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
    from rosbags.rosbag2 import storage_mcap as storage

    before = storage.read_string, storage.get_msgdef
    storage.read_string = lambda bio: storage.read_bytes(bio).decode(errors="replace")
    storage.get_msgdef = lambda _schema: MessageDefinition(MessageDefinitionFormat.NONE, "")
    try:
        yield
    finally:
        storage.read_string, storage.get_msgdef = before
