"""A team of robots as nodes of ROS 2 in this process, with the simulated world, for tests."""

import contextlib
import functools
import os
import subprocess
import sys
import tempfile

from baselines.ros import library as ros
from baselines.ros.robot import RobotNode
from baselines.ros.settings import RobotSettings, WorldSettings
from baselines.ros.world import WorldNode
from lissajous_env.parameters.scenario_file import as_toml

AGILE = {"robot.steering_max": 0.8, "robot.model_offset": None, "formation.start_noise": 0.0, "faults.schedule": ()}
"""Cars whose turning circle is smaller than the curve's tightest bend, without failures."""


@contextlib.contextmanager
def in_ros():
    """ROS 2 in a domain of this process, on the loopback interface."""
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    ros.start_ros()
    try:
        yield
    finally:
        ros.rclpy.try_shutdown()


def in_real_time(story):
    """A story that is told up to four times: on a busy machine, messages come late and robots stop as they should."""

    @functools.wraps(story)
    def told(*args, **kwargs):
        for _ in range(3):
            with contextlib.suppress(AssertionError):
                return story(*args, **kwargs)
        return story(*args, **kwargs)

    return told


def node_of(settings, **options):
    """A robot's node, without the arguments of this process."""
    return RobotNode(settings, use_global_arguments=False, **options)


def process(*arguments, **options):
    """A command `lissajous ros ...` as a process of its own."""
    command = [sys.executable, "-m", "lissajous_env", "ros", *map(str, arguments)]
    return subprocess.Popen(command, text=True, **options)


def on_simulated_time(options_of, robot):
    """Options of a robot's node, and the parameter by which its clock is that of the world."""
    from rclpy.parameter import Parameter

    return {"parameter_overrides": [Parameter("use_sim_time", value=True)], **options_of(robot)}


class Team:
    """A world and robots in one process; `world.play()` runs all of them."""

    def __init__(self, scenario, policy, settings=WorldSettings(), robots=None, options_of=lambda k: {}, **more):  # noqa: B008
        self._folder = tempfile.TemporaryDirectory()
        self.file = os.path.join(self._folder.name, "lab.toml")
        with open(self.file, "w", encoding="utf-8") as file:
            file.write(as_toml(scenario))
        self.world = WorldNode(scenario, settings)
        self.world.discovery = 0.0  # within one process, everyone is known at once
        chosen = range(scenario.num_robots) if robots is None else robots
        # A busy machine must not be taken for a jump of the clock.
        if settings.pace != 1:
            options_of = functools.partial(on_simulated_time, options_of)
        given = {"policy": policy, "scenario": self.file, "lockstep": settings.lockstep, "clock_jump": 5.0} | more
        self.robots = []
        self.others = []
        for k in chosen:
            self.robots.append(node_of(RobotSettings(robot=k, **given), **options_of(k)))
            self.world.loop.add_node(self.robots[-1])

    def add(self, node):
        self.others.append(node)
        self.world.loop.add_node(node)
        return node

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for node in (*self.robots, *self.others, self.world):
            node.destroy_node()
        self._folder.cleanup()
