"""Commands that run a world and its robots over ROS 2: how they end, and what they refuse."""

import subprocess
import sys

import pytest

pytest.importorskip("rclpy", reason='ROS 2 is not installed: pip install ".[ros]"')
from command_line import called
from ros_team import PATIENCE, use_domain

from baselines.ros.running import alone
from lissajous_env.console.terminal import CommandError


@pytest.fixture(autouse=True)
def _domain():
    use_domain()


def test_a_second_team_in_the_same_domain_is_refused():
    # Story: somebody launches a team while another one drives; both would obey each other's messages.
    with alone(), pytest.raises(CommandError, match="ROS_DOMAIN_ID must be one in which no other world runs"), alone():
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


@pytest.mark.parametrize(("arguments", "words"), [
    (("world", "--scenario", "failure"), "scenario must be of robots of kind car or differential, got 'curve'"),
    (("launch", "--policy", "nobody"), "got 'nobody'"),
    (("launch", "--duration", "1", "--set", "task.duration=2"), "must give task.duration once"),
])  # fmt: skip
def test_bad_input_is_one_line(arguments, words, capsys):
    code, _, error = called(capsys, "ros", *arguments)
    assert (code, error[:7], len(error.splitlines())) == (2, "error: ", 1)
    assert words in error
