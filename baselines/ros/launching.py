"""Processes of a simulated world and its robots, started and ended together."""

import contextlib
import ctypes
import fcntl
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from baselines.ros import library as ros
from baselines.ros.running import started
from lissajous_env.console.terminal import CommandError

_PDEATHSIG = 1
"""Option of prctl: the signal that a process receives when its parent dies."""
_GRACE = 5.0
"""Time in which a process must end [s]."""


class Team:
    """The processes of a world and its robots.

    Args:
        count: Number of robots.
        world: Arguments of `lissajous ros world`.
        robots: Arguments of `lissajous ros robot`, without the index.
    """

    def __init__(self, count: int, world: list[str], robots: list[str]):
        self._commands = {f"robot_{k}": ["robot", "--robot", str(k), *robots] for k in range(count)}
        self._commands["world"] = ["world", *world]
        self.processes: dict[str, subprocess.Popen] = {}

    def run(self, tell: Callable[[str], None]) -> None:
        """Run until the world has ended, and end the robots.

        Args:
            tell: Called with a line for each change of a robot's state.

        Raises:
            CommandError: another team is running, a process ended before the world did, or the world failed.
        """
        # The node ends first, as long as it discovers no robot's end.
        with alone(), contextlib.closing(self), started() as here:
            node = ros.Node("launch")
            here.nodes.append(node)
            states: dict[str, str] = {}
            node.create_subscription(ros.DiagnosticArray, "/diagnostics", lambda m: self._note(m, states, tell), 10)
            executor = ros.make_executor()
            executor.add_node(node)
            try:
                for name, command in self._commands.items():
                    self.processes[name] = _process(command)
                while self.processes["world"].poll() is None and not here.ended:
                    executor.spin_once(timeout_sec=0.1)
                    here.check()
                    self._check()
                code = self.processes["world"].poll()
                if code:
                    raise CommandError(f"the world has ended with code {code}; the robots were stopped")
            finally:
                executor.shutdown()

    def close(self) -> None:
        """End all processes: first by SIGTERM, after which robots command rest, then by SIGKILL."""
        running = [each for each in self.processes.values() if each.poll() is None]
        for process in running:
            process.send_signal(signal.SIGTERM)
        limit = time.monotonic() + _GRACE
        for process in running:
            try:
                process.wait(max(limit - time.monotonic(), 0.01))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _check(self) -> None:
        for name, process in self.processes.items():
            code = process.poll()
            if name != "world" and code is not None:
                how = f"was ended by signal {-code}" if code < 0 else f"has ended with code {code}"
                raise CommandError(f"{name} {how}; all others were stopped")

    @staticmethod
    def _note(message: Any, states: dict[str, str], tell: Callable[[str], None]) -> None:
        for status in message.status:
            kind = re.sub(r"\d[\d.]*", "", status.message)  # a reason whose number changes is the same reason
            if status.name.startswith("lissajous: ") and states.get(status.hardware_id) != kind:
                states[status.hardware_id] = kind
                tell(f"{status.hardware_id}: {status.message}")


@contextlib.contextmanager
def alone() -> Iterator[None]:
    """Refuse to run beside another team of this user in the same domain, whose nodes would have the same names."""
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    path = Path(tempfile.gettempdir(), f"lissajous-ros-{os.getuid()}-{domain}.lock")
    with open(path, "a") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            rule = "must be one in which no other `lissajous ros launch` is running"
            raise CommandError(f"ROS_DOMAIN_ID {rule}, got {domain}") from error
        yield


def _process(command: list[str]) -> subprocess.Popen:
    """Start a command of ROS 2 that ends with this process, and does not receive its Ctrl-C."""
    libc, parent = ctypes.CDLL(None, use_errno=True), os.getpid()

    def follow_parent() -> None:
        libc.prctl(_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:  # it has died before
            os._exit(1)

    program = [sys.executable, "-m", "lissajous_env", "ros", *command]
    return subprocess.Popen(program, start_new_session=True, preexec_fn=follow_parent)
