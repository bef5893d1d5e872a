"""The library that reads and writes logs, and the message types of ROS 2, imported when they are used."""

import contextlib
from collections.abc import Iterator
from typing import Any

from lissajous_env.extras import missing


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


def type_store() -> Any:
    """Return the message types of ROS 2 Humble, which later distributions have too."""
    rosbags()
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


@contextlib.contextmanager
def any_encoding() -> Iterator[None]:
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
