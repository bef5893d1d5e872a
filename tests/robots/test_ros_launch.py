"""A world and its robots over ROS 2, each as a process of its own, launched and ended together."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason='ROS 2 is not installed: pip install ".[ros]"')
from command_line import called
from ros_team import PATIENCE, process, use_domain, wait_until

from baselines.ros.launching import alone
from lissajous_env.console.terminal import CommandError


@pytest.fixture(autouse=True)
def _domain():
    use_domain()


PAIR = "--set", "robot.count=2", "formation.p=1", "formation.ring=(0,1)", "faults.schedule=()"


def state_of(pid):
    """State, parent and command of a process, as Linux has them; an ended one has state Z."""
    try:
        _, _, rest = Path(f"/proc/{pid}/stat").read_text().rpartition(")")
        command = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return "Z", 0, ""
    state, parent, *_ = rest.split()
    return state, int(parent), command


def children_of(pid):
    """Commands of the processes that a process has started and that are alive."""
    everyone = {int(path.name): state_of(path.name) for path in Path("/proc").glob("[0-9]*")}
    return {
        child: command for child, (state, parent, command) in everyone.items() if parent == pid and " ros " in command
    }


def is_alive(pid):
    return state_of(pid)[0] != "Z"


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("ends", ["robot", "interrupt", pytest.param("kill", marks=pytest.mark.long)])
def test_all_processes_end_with_one_or_with_the_launch(ends, tmp_path):
    with open(tmp_path / "said", "w+", encoding="utf-8") as said:
        launched = process("launch", *PAIR, stdout=said, stderr=said, cwd=tmp_path)
        try:
            wait_until(lambda: text(said).count(": drives") == 2)
            children = children_of(launched.pid)
            assert len(children) == 3
            robot = next(pid for pid, command in children.items() if "--robot 1" in command)
            if ends == "robot":
                os.kill(robot, signal.SIGKILL)
            else:
                launched.send_signal(signal.SIGINT if ends == "interrupt" else signal.SIGKILL)
            code = launched.wait(PATIENCE)
            wait_until(lambda: not any(is_alive(pid) for pid in children))
        finally:
            launched.kill()
            launched.wait()
        assert code == {"robot": 1, "interrupt": 130, "kill": -signal.SIGKILL}[ends]
        if ends == "robot":
            assert "error: robot_1 was ended by signal 9; all others were stopped" in text(said)


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


def text(file):
    file.seek(0)
    return file.read()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("robot", "--robot", "9"), "robot must be a whole number from 0 to 4, got 9"),
        (("world", "--scenario", "failure"), "scenario must be of robots of kind car or differential, got curve"),
        (("launch", "--policy", "nobody"), "got 'nobody'"),
    ],
)
def test_bad_input_is_one_line(arguments, words, capsys):
    code, _, error = called(capsys, "ros", *arguments)
    assert (code, error[:7], len(error.splitlines())) == (2, "error: ", 1)
    assert words in error
