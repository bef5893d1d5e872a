"""The command `lissajous ros robot`: one robot's policy as a node of ROS 2."""

from typing import Annotated

import tyro

from baselines.commands.playing import progress_console
from baselines.ros.settings import RobotSettings
from lissajous_env.console.terminal import DEFAULT_OUTPUT, OutputOptions, print_line

_Namespace = Annotated[str | None, tyro.conf.arg(metavar="NAME")]


def robot(
    settings: tyro.conf.OmitArgPrefixes[RobotSettings],
    namespace: _Namespace = None,
    output: OutputOptions = DEFAULT_OUTPUT,
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
        print_line(progress_console(output), words)
        process.spin()
