"""Run nodes until they are requested to end."""

import faulthandler
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from baselines.ros import library as ros

_GRACE = 3.0
"""Time in which ROS 2 must end [s]."""


@dataclass
class RosProcess:
    """ROS 2 in this process."""

    nodes: list[Any] = field(default_factory=list)
    """Nodes, which are destroyed when ROS 2 ends."""
    ended: bool = False
    """True after SIGTERM."""

    def spin(self) -> None:
        """Run the nodes in this thread until SIGTERM or Ctrl-C; each then publishes the command of rest."""
        executor = ros.make_executor()
        for node in self.nodes:
            executor.add_node(node)
        try:
            while not self.ended:
                with signals_deferred():
                    executor.spin_once(timeout_sec=0.1)
        finally:
            for node in self.nodes:
                node.rest()
            executor.shutdown()

    def note_end(self, *_: Any) -> None:
        """Record SIGTERM."""
        self.ended = True


@contextmanager
def started(interrupts: bool = False) -> Iterator[RosProcess]:
    """Start ROS 2 for a block of code; SIGTERM is noted, or interrupts the block like Ctrl-C."""
    process = RosProcess()
    before = signal.signal(signal.SIGTERM, signal.default_int_handler if interrupts else process.note_end)
    ros.start_ros()
    try:
        yield process
    finally:
        with _ended_in_time():
            for node in process.nodes:
                node.destroy_node()
            ros.rclpy.try_shutdown()
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _ended_in_time() -> Iterator[None]:
    """End the process with code 1 if a block of code takes too long.

    Fast DDS waits for itself for ever where a participant ends while it discovers that another one has ended. The code
    blocks the interpreter's lock meanwhile, so no thread of Python can end the process.
    """
    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(_GRACE, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


@contextmanager
def signals_deferred() -> Iterator[None]:
    """Handle Ctrl-C and SIGTERM at the end of a block of compiled code that calls Python.

    The error of a handler that runs within the block would become another one on its way through the compiled code.
    """
    arrived: list[tuple[int, Any]] = []
    is_main = threading.current_thread() is threading.main_thread()
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)} if is_main else {}
    handlers = {number: handler for number, handler in before.items() if callable(handler)}
    for number in handlers:
        signal.signal(number, lambda *given: arrived.append(given))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    for number, frame in arrived[:1]:
        handlers[signal.Signals(number)](number, frame)
