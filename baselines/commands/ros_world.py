"""The command `lissajous ros world`: the simulation in place of the robots' hardware, over ROS 2."""

from dataclasses import replace
from pathlib import Path

import tyro
from rich import progress as bars

from baselines.benchmark.progress import bar
from baselines.commands.playing import FORMATS, check_file, progress_console, show
from baselines.ros.settings import RobotSettings, WorldSettings
from lissajous_env.console.terminal import DEFAULT_OUTPUT, OutFile, OutputOptions, Overrides, parse_overrides
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario


def world(
    settings: tyro.conf.OmitArgPrefixes[WorldSettings],
    scenario: str = "experiment",
    out: OutFile = None,
    output: OutputOptions = DEFAULT_OUTPUT,
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


def play(
    scenario: Scenario,
    settings: WorldSettings,
    out: Path | None,
    output: OutputOptions,
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
    console = output.console()
    shown = bar(progress_console(output), bars.TextColumn("{task.description}"))
    with alone(), started() as process, shown as shown_bar:
        world = WorldNode(scenario, settings)
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
    print_row(console, recording.score, recording.scenario)
    output.print_json(recording.score)
    if out is not None:
        show(recording, out, output)
