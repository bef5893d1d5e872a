"""The library that reads and writes logs, and the message types of ROS 2, imported when they are used."""

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
