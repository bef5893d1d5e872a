"""Run nodes until they are requested to end."""

import faulthandler
import fcntl
import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from baselines.ros import library as ros
from lissajous_env.console.terminal import CommandError

GRACE = 3.0
"""Time in which ROS 2 must end [s]."""


@dataclass
class RosProcess:
    """ROS 2 in this process."""

    nodes: list[Any] = field(default_factory=list)
    """Nodes, which are destroyed when ROS 2 ends."""
    signals: list[int] = field(default_factory=list)
    """Signals that have arrived."""

    def check(self) -> None:
        """Interrupt the process if it was requested to.

        The error of a handler that runs within compiled code that calls Python would become another one on its way
        through this code. So signals are only noted, and handled here.

        Raises:
            KeyboardInterrupt: after Ctrl-C or SIGTERM.
        """
        if self.signals:
            raise KeyboardInterrupt

    def spin(self) -> None:
        """Run the nodes in this thread until SIGTERM, or Ctrl-C, which raises; they then publish commands of rest."""
        executor = ros.make_executor()
        for node in self.nodes:
            executor.add_node(node)
        try:
            while signal.SIGTERM not in self.signals:
                executor.spin_once(timeout_sec=0.1)
                if signal.SIGINT in self.signals:
                    raise KeyboardInterrupt
        finally:
            for node in self.nodes:
                node.rest()
            executor.shutdown()

    def note(self, number: int, _frame: Any) -> None:
        """Note a signal; the second one interrupts the process at once."""
        self.signals.append(number)
        if len(self.signals) > 1:
            raise KeyboardInterrupt


@contextmanager
def started() -> Iterator[RosProcess]:
    """Start ROS 2 for a block of code, which calls `RosProcess.check` where a signal may interrupt it."""
    process = RosProcess()
    handlers = {number: signal.signal(number, process.note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        ros.start_ros()
        process.check()
        yield process
    finally:
        process.signals.clear()
        with _ended_in_time():
            for node in process.nodes:
                node.destroy_node()
            ros.rclpy.try_shutdown()
        for number, handler in handlers.items():
            signal.signal(number, handler)


@contextmanager
def _ended_in_time() -> Iterator[None]:
    """End the process with code 1 if a block of code takes too long.

    Fast DDS waits for itself for ever where a participant ends while it discovers that another one has ended. The code
    blocks the interpreter's lock meanwhile, so no thread of Python can end the process.
    """
    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(GRACE, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


@contextmanager
def alone() -> Iterator[None]:
    """Refuse to run a world beside another one of this user in the same domain, whose nodes would have the same names.

    Raises:
        CommandError: there is another one.
    """
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    with open(Path(tempfile.gettempdir(), f"lissajous-ros-{os.getuid()}-{domain}.lock"), "a") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise CommandError(f"ROS_DOMAIN_ID must be one in which no other world runs, got {domain}") from error
        yield
