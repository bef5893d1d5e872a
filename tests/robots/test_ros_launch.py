"""A world and its robots over ROS 2, each as a process of its own, launched and ended together."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason='ROS 2 is not installed: pip install ".[ros]"')
from ros_team import process

import baselines
import lissajous_env
from lissajous_env.episodes.recording import record


@pytest.fixture(autouse=True)
def _domain(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


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


def test_six_processes_play_the_simulation_bit_for_bit(tmp_path):
    # Oracle: the simulation without ROS, of the same seed.
    out = tmp_path / "played.npz"
    given = ("launch", "--scenario", "experiment", "--duration", 2, "--seed", 4, "--lockstep", "--out", out)
    done = process(*given, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    output, error = done.communicate(timeout=100)
    assert done.returncode == 0, error
    assert "spacing_factor" in output
    made = lissajous_env.scenario("experiment", **{"task.duration": 2.0})
    wanted = record(baselines.make("kuramoto-mpcc", made), made, seed=4)
    played = np.load(out)
    for name in ("position", "heading", "speed", "phase", "observation", "action", "heard_at", "reward_terms"):
        np.testing.assert_array_equal(played[name], getattr(wanted, name), err_msg=name)


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("ends", ["robot", "interrupt", pytest.param("kill", marks=pytest.mark.long)])
def test_all_processes_end_with_one_or_with_the_launch(ends, tmp_path):
    with open(tmp_path / "said", "w+", encoding="utf-8") as said:
        launched = process("launch", *PAIR, stdout=said, stderr=said, cwd=tmp_path)
        try:
            wait_until(lambda: text(said).count(": drives") == 2, 60)
            children = children_of(launched.pid)
            assert len(children) == 3
            robot = next(pid for pid, command in children.items() if "--robot 1" in command)
            if ends == "robot":
                os.kill(robot, signal.SIGKILL)
            else:
                launched.send_signal(signal.SIGINT if ends == "interrupt" else signal.SIGKILL)
            code = launched.wait(20)
            wait_until(lambda: not any(is_alive(pid) for pid in children), 10)
        finally:
            launched.kill()
            launched.wait()
        assert not [pid for pid in children if is_alive(pid)]
        assert code == {"robot": 1, "interrupt": 130, "kill": -signal.SIGKILL}[ends]
        if ends == "robot":
            assert "error: robot_1 was ended by signal 9; all others were stopped" in text(said)


def test_a_second_team_in_the_same_domain_is_refused():
    # Story: somebody launches a team while another one drives; both would obey each other's messages.
    first = process("launch", *PAIR, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    try:
        assert first.stderr.readline()  # the first of its robots has a state
        second = process("launch", *PAIR, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        _, error = second.communicate(timeout=60)
    finally:
        first.kill()
        first.communicate()
    assert second.returncode == 1
    assert "ROS_DOMAIN_ID must be one in which no other `lissajous ros launch` is running, got " in error


WAITS_FOR_ITSELF = """
import ctypes
from baselines.ros.running import started

class Stuck:
    def destroy_node(self):
        ctypes.PyDLL(None).pause()  # with the lock of the interpreter

with started() as process:
    process.nodes.append(Stuck())
    print("done", flush=True)
"""


def test_a_process_ends_although_ros_does_not():
    # Fast DDS can wait for itself for ever when several participants end at once; a robot's process was found so.
    done = subprocess.run([sys.executable, "-c", WAITS_FOR_ITSELF], stdout=subprocess.PIPE, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (1, "done\n")


def text(file):
    file.seek(0)
    return file.read()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("robot", "--robot", 9), "robot must be a whole number from 0 to 4, got 9"),
        (("world", "--scenario", "failure"), "scenario must be of robots of kind car or differential, got curve"),
        (("launch", "--policy", "nobody"), "got 'nobody'"),
    ],
)
def test_bad_input_is_one_line(arguments, words):
    done = process(*arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    _, error = done.communicate(timeout=60)
    assert (done.returncode, error.splitlines()[0][:7]) == (2, "error: ")
    assert words in error
    assert len(error.splitlines()) == 1


def wait_until(holds, limit):
    ends = time.monotonic() + limit
    while not holds() and time.monotonic() < ends:
        time.sleep(0.05)
    assert holds()
