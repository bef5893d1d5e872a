"""The commands `lissajous ros robot`, `ros world` and `ros launch`: policies and the simulation over ROS 2."""

import os
from dataclasses import replace
from pathlib import Path

from baselines.commands.playing import FORMATS, check_file, show
from baselines.ros.settings import RobotSettings, WorldSettings
from lissajous_env.console.terminal import (
    DEFAULT_OUTPUT,
    OutFile,
    Output,
    Overrides,
    bar,
    parse_overrides,
    print_line,
)
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario


def robot(
    settings: RobotSettings,
    namespace: str | None = None,
    output: Output = DEFAULT_OUTPUT,
) -> None:
    """Run one robot's policy as a node of ROS 2.

    Each option is also a parameter of the node. Arguments of ROS 2 can follow the options.

    Example:
        lissajous ros robot --robot 2 --policy kuramoto-mpcc --scenario lab.toml --frame map

    Args:
        settings: Defaults of the parameters.
        namespace: namespace of the node's topics; robot_K by default.
    """
    from baselines.ros.robot import RobotNode
    from baselines.ros.running import started

    with started() as process:
        node = RobotNode(settings, namespace)
        process.nodes.append(node)
        words = f"{node.get_fully_qualified_name()} runs {node.settings.policy} on {node.scenario.name}: {node.reason}"
        print_line(output.progress(), words)
        process.spin()


def world(
    settings: WorldSettings,
    scenario: str = "experiment",
    out: OutFile = None,
    output: Output = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Simulate the robots' hardware as a node of ROS 2, and print the score.

    The node waits for all robots, starts them, and stops them at the end. The robots' nodes need the parameter
    use_sim_time: their clock is that of the simulation, which waits for their decisions.

    Example:
        lissajous ros world --scenario experiment --set task.duration=20 --out episode.html

    Args:
        settings: Settings of the node.
        scenario: name of a scenario, .toml file, or module:attribute.
        out: file to write, as in `lissajous run`: .html, .mp4, .gif, .npz or .mcap.
    """
    play(named.scenario(scenario, **parse_overrides(overrides)), settings, out, output)


def launch(
    settings: WorldSettings,
    scenario: str = "experiment",
    policy: str = "kuramoto-mpcc",
    duration: float | None = None,
    out: OutFile = None,
    output: Output = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Run a simulated world and all robots as nodes of ROS 2, and print the score.

    The nodes communicate on this machine alone, unless ROS_AUTOMATIC_DISCOVERY_RANGE is set.

    Example:
        lissajous ros launch --scenario experiment --policy kuramoto-mpcc --duration 20

    Args:
        settings: Settings of the simulation's node; the robots' commands are of the same kind.
        scenario: name of a scenario, .toml file, or module:attribute.
        policy: name of a policy, folder of a checkpoint, or module:factory.
        duration: duration of the episode [s]; by default that of the scenario.
        out: file to write, as in `lissajous ros world`.
    """
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    given = () if duration is None else ((f"task.duration={duration}",),)
    setup = named.scenario(scenario, **parse_overrides((*overrides, *given)))
    robots = RobotSettings(policy=policy, command=settings.command, message_loss=setup.noise.message_loss)
    play(setup, settings, out, output, robots)


def play(
    scenario: Scenario,
    settings: WorldSettings,
    out: Path | None,
    output: Output,
    robots: RobotSettings | None = None,
) -> None:
    """Play an episode over ROS 2, print the score, and write a file.

    Args:
        scenario: The scenario.
        settings: Settings of the simulation's node.
        out: File to write; None for none.
        output: Options of the output.
        robots: Settings of the robots' nodes, which are run in this process; None if they are run elsewhere.
    """
    from baselines.benchmark.shown import print_row
    from baselines.ros import library as ros
    from baselines.ros.robot import RobotNode
    from baselines.ros.running import alone, started
    from baselines.ros.world import WorldNode

    check_file(out, *FORMATS)
    with alone(), started() as process, bar(output.progress()) as shown_bar:
        world = WorldNode(scenario, settings)
        world.recorded = out is not None
        if robots is not None:
            for k in range(scenario.num_robots):
                robot = RobotNode.simulated(replace(robots, robot=k), scenario)
                if output.quiet:
                    robot.get_logger().set_level(ros.LoggingSeverity.WARN)
                process.nodes.append(robot)
                world.loop.add_node(robot)
        process.nodes.append(world)
        task = shown_bar.add_task(f"{scenario.name} over ROS 2", total=scenario.task.steps)
        recording = world.play(lambda: shown_bar.advance(task), process.check)
    recording = replace(recording, score=recording.score | {"policy": "ros"})
    print_row(output.console(), recording.score, recording.scenario)
    output.print_json(recording.score)
    if out is not None:
        show(recording, out, output)
