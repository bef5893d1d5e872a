"""A world and its robots over ROS 2, each as a process of its own, launched and ended together."""

import contextlib
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason='ROS 2 is not installed: pip install ".[ros]"')
from command_line import called
from ros_team import PATIENCE, process, use_domain, wait_until

from baselines.ros import launching
from baselines.ros.launching import alone
from lissajous_env.console.terminal import CommandError


@pytest.fixture(autouse=True)
def _domain():
    use_domain()


SCRIPT = 'test "$0$2" = "{ends}" && {how}; exec sleep 100'
"""A process of a team that ends if it is the named one, and sleeps otherwise; its arguments follow."""


@pytest.fixture
def started(monkeypatch):
    """The processes that a team starts."""
    processes, start = [], launching._process

    def remember(command):
        processes.append(start(command))
        return processes[-1]

    monkeypatch.setattr(launching, "_process", remember)
    return processes


@pytest.mark.parametrize(
    ("ends", "how", "words"),
    [
        ("robot1", "kill -9 $$", "robot_1 was ended by signal 9; all others were stopped"),
        ("robot0", "exit 0", "robot_0 has ended with code 0; all others were stopped"),
        ("world", "exit 3", "world has ended with code 3; all others were stopped"),
        ("world", "exit 0", None),
    ],
)
def test_all_processes_end_with_one(ends, how, words, started, monkeypatch):
    monkeypatch.setattr(launching, "PROGRAM", ["sh", "-c", SCRIPT.format(ends=ends, how=how)])
    with pytest.raises(CommandError, match=words) if words else contextlib.nullcontext():
        launching.run_team(2, [], [])
    assert len(started) == 3
    assert all(process.poll() is not None for process in started)


@pytest.mark.usefixtures("ctrl_c")
def test_all_processes_end_at_ctrl_c(started, monkeypatch):
    monkeypatch.setattr(
        launching, "PROGRAM", ["sh", "-c", SCRIPT.format(ends="world", how="{ sleep 0.5; kill -INT $PPID; }")]
    )
    with pytest.raises(KeyboardInterrupt):
        launching.run_team(2, [], [])
    assert [process.returncode for process in started] == [-signal.SIGTERM] * 3


def is_alive(pid):
    try:
        return ") Z " not in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False


@pytest.mark.long
def test_all_processes_end_when_the_launch_is_killed(tmp_path):
    pair = "--set", "robot.count=2", "formation.p=1", "formation.ring=(0,1)", "faults.schedule=()"
    with open(tmp_path / "log", "w+", encoding="utf-8") as log:
        launched = process("launch", *pair, stdout=log, stderr=log, cwd=tmp_path)
        try:
            wait_until(lambda: (tmp_path / "log").read_text().count(": drives") == 2)
            children = Path(f"/proc/{launched.pid}/task/{launched.pid}/children").read_text().split()
        finally:
            launched.kill()
            launched.wait()
    assert len(children) == 3
    wait_until(lambda: not any(map(is_alive, children)))


def test_a_second_team_in_the_same_domain_is_refused():
    # Story: somebody launches a team while another one drives; both would obey each other's messages.
    rule = "ROS_DOMAIN_ID must be one in which no other `lissajous ros launch` is running, got "
    with alone(), pytest.raises(CommandError, match=rule), alone():
        pass
    with alone():
        pass  # after the first


WAITS_FOR_ITSELF = """
import ctypes
from baselines.ros import running

class Stuck:
    def destroy_node(self):
        ctypes.PyDLL(None).pause()  # with the lock of the interpreter

running.GRACE = 0.3
with running.started() as process:
    process.nodes.append(Stuck())
    print("done", flush=True)
"""


def test_a_process_ends_although_ros_does_not():
    # Fast DDS can wait for itself for ever when several participants end at once; a robot's process was found so.
    done = subprocess.run([sys.executable, "-c", WAITS_FOR_ITSELF], stdout=subprocess.PIPE, text=True, timeout=PATIENCE)
    assert (done.returncode, done.stdout) == (1, "done\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("world", "--scenario", "failure"), "scenario must be of robots of kind car or differential, got curve"),
        (("launch", "--policy", "nobody"), "got 'nobody'"),
    ],
)
def test_bad_input_is_one_line(arguments, words, capsys):
    code, _, error = called(capsys, "ros", *arguments)
    assert (code, error[:7], len(error.splitlines())) == (2, "error: ", 1)
    assert words in error
