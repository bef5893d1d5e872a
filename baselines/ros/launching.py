"""Processes of a simulated world and its robots, started and ended together."""

import contextlib
import ctypes
import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from lissajous_env.console.terminal import CommandError

PROGRAM = [sys.executable, "-m", "lissajous_env", "ros"]
"""Program of the processes, before their arguments."""
_PDEATHSIG = 1
"""Option of prctl: the signal that a process receives when its parent dies."""
_GRACE = 5.0
"""Time in which a process must end [s]."""


def run_team(count: int, world: list[str], robots: list[str]) -> None:
    """Run a world and its robots, each as a process, until the world has ended, and end the robots.

    Args:
        count: Number of robots.
        world: Arguments of `lissajous ros world`.
        robots: Arguments of `lissajous ros robot`, without the index.

    Raises:
        CommandError: another team is running, a process ended before the world did, or the world failed.
    """
    commands = {f"robot_{k}": ["robot", "--robot", str(k), *robots] for k in range(count)} | {
        "world": ["world", *world]
    }
    processes: dict[str, subprocess.Popen] = {}
    with alone():
        try:
            for name, command in commands.items():
                processes[name] = _process(command)
            while not (ended := [name for name, process in processes.items() if process.poll() is not None]):
                time.sleep(0.05)
            name = "world" if "world" in ended else ended[0]
            code = processes[name].returncode
            if name != "world" or code:
                how = f"was ended by signal {-code}" if code < 0 else f"has ended with code {code}"
                raise CommandError(f"{name} {how}; all others were stopped")
        finally:
            _end(processes.values())


def _end(processes: Iterable[subprocess.Popen]) -> None:
    """End processes: first by SIGTERM, after which robots command rest, then by SIGKILL."""
    running = [process for process in processes if process.poll() is None]
    for process in running:
        process.send_signal(signal.SIGTERM)
    limit = time.monotonic() + _GRACE
    for process in running:
        try:
            process.wait(max(limit - time.monotonic(), 0.01))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


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

    return subprocess.Popen([*PROGRAM, *command], start_new_session=True, preexec_fn=follow_parent)
