"""A team of robots as nodes of ROS 2 in this process, with the simulated world, for tests.

The clock of the world waits for the robots, so that a story is the same on every machine, however busy.
"""

import contextlib
import os
import subprocess
import sys
import time

from baselines.ros import library as ros
from baselines.ros.robot import RobotNode
from baselines.ros.settings import RobotSettings, WorldSettings
from baselines.ros.world import WorldNode

AGILE = {"robot.steering_max": 0.8, "robot.model_offset": None, "formation.start_noise": 0.0, "faults.schedule": ()}
"""Cars whose turning circle is smaller than the curve's tightest bend, without failures."""
PATIENCE = 100.0
"""Longest time that a test waits for a condition [s]."""


def use_domain():
    """Use a domain of this process, on the loopback interface."""
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


@contextlib.contextmanager
def in_ros():
    """ROS 2 in a domain of this process."""
    use_domain()
    ros.start_ros()
    try:
        yield
    finally:
        ros.rclpy.try_shutdown()


def node_of(settings, **options):
    """A robot's node, without the arguments of this process."""
    return RobotNode(settings, use_global_arguments=False, **options)


def process(*arguments, **options):
    """A command `lissajous ros ...` as a process of its own."""
    command = [sys.executable, "-m", "lissajous_env", "ros", *map(str, arguments)]
    return subprocess.Popen(command, text=True, **options)


def wait_until(holds, spin=lambda: time.sleep(0.05)):
    """Call a function until a condition holds."""
    ends = time.monotonic() + PATIENCE
    while not holds() and time.monotonic() < ends:
        spin()
    assert holds()


class Team:
    """A world and robots in one process; `world.play()` runs all of them, as fast as the robots decide."""

    def __init__(self, scenario, policy, robots=None, options_of=lambda k: {}, world=None, **more):
        self._scenario = scenario
        settings: dict = {"pace": 1000.0, "wait": PATIENCE} | (world or {})
        self.world = WorldNode(scenario, WorldSettings(**settings))
        self.world.discovery = 0.0  # within one process, everyone is known at once
        chosen = range(scenario.num_robots) if robots is None else robots
        self._settings, self._options_of = {"policy": policy, "message_wait": PATIENCE} | more, options_of
        self.robots = [self.robot(k) for k in chosen]
        self.others = []
        for node in self.robots:
            self.world.loop.add_node(node)

    def robot(self, k, **more):
        """The node of a robot, whose clock is that of the world."""
        settings = RobotSettings(robot=k, **self._settings | more)
        options = {"use_global_arguments": False} | self._options_of(k)
        return RobotNode.simulated(settings, self._scenario, **options)

    def add(self, node):
        self.others.append(node)
        self.world.loop.add_node(node)
        return node

    def spin(self):
        self.world.loop.spin_once(timeout_sec=0.05)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for node in (*self.robots, *self.others, self.world):
            node.destroy_node()
