"""Messages of ROS 2: those of rosbag2 files (MCAP) by topic, and fields that are filled alike in any library's."""

import contextlib
import functools
import math
from collections import Counter
from collections.abc import Container, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lissajous_env.plugins import of_extra
from lissajous_env.storage.files import undamaged
from lissajous_env.wording import few_of

Place = tuple[float, float, float, float]
"""x, y, z [m] and heading [rad]."""
rosbags = functools.partial(of_extra, "rosbags.rosbag2", "a log (.mcap)", "logs")
"""Function that returns the module that reads and writes logs."""

_LOG = "rosbag2 file (.mcap) or folder"


class Bags(contextlib.ExitStack):
    """The files of a log, open until this is left.

    Args:
        paths: Files (.mcap) or folders of rosbag2.

    Attributes:
        kinds: Types of each topic's messages; a topic may have several. A type of another encoding than that of ROS 2
            has it in its name.
        remarks: Number of messages of which something is to be said, by remark and topic.

    Raises:
        MissingExtraError: rosbags, of the extra `logs`, is not installed.
        ValueError: a file is damaged or no log.
        OSError: a file cannot be read.
    """

    def __init__(self, paths: Sequence[Path]):
        super().__init__()
        self.paths = tuple(paths)
        self._store = type_store()  # of ROS alone: the types that a file defines are not compiled
        self.kinds: dict[str, set[str]] = {}
        self.remarks: Counter[tuple[str, str]] = Counter()
        self._readers = [(bag, reader) for bag, path in enumerate(paths) for reader in self._opened(path)]
        for connection in (connection for _, reader in self._readers for connection in reader.connections):
            kind = _kind_of(connection)
            self.kinds.setdefault(connection.topic, set()).add(kind)
            if kind != connection.msgtype and connection.msgcount:
                self.ignore(connection.topic, f"type {kind} is not understood", connection.msgcount)

    def _opened(self, path: Path) -> list[Any]:
        """Return the readers of a file, or of those of a folder: its list of topics may have types that are refused."""
        if not path.exists():
            raise FileNotFoundError(2, "there is no such log", str(path))
        files = sorted(path.glob("*.mcap")) if path.is_dir() else []
        with undamaged(path, _LOG), _any_encoding():
            return [self.enter_context(rosbags().Reader(file)) for file in files or [path]]

    def ignore(self, topic: str, reason: str, count: int = 1) -> None:
        """Remark that messages of a topic are ignored."""
        self.remarks[f"are ignored: {reason}", topic] += count

    def notes(self) -> list[str]:
        """Return the remarks, one for all topics of which the same is said."""
        remarks: dict[str, Counter[str]] = {}
        for (remark, topic), count in sorted(self.remarks.items()):
            remarks.setdefault(remark, Counter())[topic] += count
        return [f"{topics.total()} messages of {few_of(topics)} {remark}" for remark, topics in remarks.items()]

    def of(self, topic: str, kinds: Container[str]) -> Iterator[tuple[int, float, Any]]:
        """Read the messages of a topic that are of some types, file by file in the order of their recording.

        Messages of other types, and those that are cut off or damaged, are counted in `remarks`.

        Yields:
            The number of the file, the time of the recorder [s], and the message.
        """
        for bag, reader in self._readers:
            channels = [c for c in reader.connections if c.topic == topic and _kind_of(c) == c.msgtype and c.msgcount]
            for connection in channels:
                if connection.msgtype not in kinds:
                    self.ignore(topic, f"type {connection.msgtype} is not understood there", connection.msgcount)
            known = [connection for connection in channels if connection.msgtype in kinds]
            with undamaged(self.paths[bag], _LOG):
                for connection, logged, raw in reader.messages(known) if known else ():
                    try:
                        content = self._store.deserialize_cdr(raw, connection.msgtype)
                    except Exception:  # damaged bytes make the library raise almost any
                        self.ignore(topic, f"they are cut off or damaged messages of type {connection.msgtype}")
                    else:
                        yield bag, logged / 1e9, content

    def holders(self, topic: str) -> list[int]:
        """Return the numbers of the files that contain a topic."""
        return sorted({bag for bag, reader in self._readers if any(c.topic == topic for c in reader.connections)})


def _kind_of(connection: Any) -> str:
    """Return the type of a channel's messages, with their encoding if it is not that of ROS 2."""
    encoding = connection.ext.serialization_format
    return connection.msgtype if encoding == "cdr" else f"{connection.msgtype} in the encoding {encoding}"


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


def set_stamp(header: Any, time: float, frame: str) -> None:
    """Write a time [s] and a frame into a header."""
    header.stamp.sec, header.stamp.nanosec = divmod(round(time * 1e9), 10**9)
    header.frame_id = frame


def seconds(stamp: Any) -> float:
    """Return a time stamp in seconds."""
    return (stamp.sec * 10**9 + stamp.nanosec) / 1e9


def set_pose(pose: Any, place: Place) -> None:
    """Write a place into a pose."""
    pose.position.x, pose.position.y, pose.position.z, heading = place
    pose.orientation.z, pose.orientation.w = math.sin(heading / 2), math.cos(heading / 2)


def set_odometry(message: Any, time: float, frames: tuple[str, str], place: Place, speed: float) -> None:
    """Write the place and the speed [m/s] of a robot into a nav_msgs/Odometry.

    The frames are those of the place and of the robot.
    """
    set_stamp(message.header, time, frames[0])
    message.child_frame_id = frames[1]
    set_pose(message.pose.pose, place)
    message.twist.twist.linear.x = speed
