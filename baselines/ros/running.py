"""Run a node until it is told to end."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from baselines.ros import library as ros


@contextmanager
def started(interrupts: bool = False) -> Iterator[Callable[[], bool]]:
    """Start ROS 2 for a block of code; SIGTERM is noted, or interrupts the block like Ctrl-C.

    Returns:
        A function that returns True after SIGTERM.
    """
    ended = threading.Event()
    before = signal.signal(signal.SIGTERM, signal.default_int_handler if interrupts else lambda *_: ended.set())
    ros.start_ros()
    try:
        yield ended.is_set
    finally:
        ros.rclpy.try_shutdown()
        signal.signal(signal.SIGTERM, before)


def spin(nodes: list[Any], ends: Callable[[], bool]) -> None:
    """Run nodes in this thread until a function returns True or Ctrl-C, then let each end.

    A robot's node publishes the command of rest before it ends.
    """
    executor = ros.make_executor()
    for node in nodes:
        executor.add_node(node)
    try:
        while not ends():
            executor.spin_once(timeout_sec=0.1)
    finally:
        for node in nodes:
            node.rest()
        executor.shutdown()
        for node in nodes:
            node.destroy_node()
