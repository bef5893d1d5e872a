"""The command `lissajous ros launch`: the simulated world and all robots over ROS 2, in one process."""

import os
from typing import Annotated

import tyro

from baselines.commands.ros_world import play
from baselines.ros.settings import RobotSettings, WorldSettings
from lissajous_env.console.terminal import DEFAULT_OUTPUT, OutFile, OutputOptions, Overrides, parse_overrides
from lissajous_env.parameters import named

_Duration = Annotated[float | None, tyro.conf.arg(metavar="FLOAT")]


def launch(
    settings: tyro.conf.OmitArgPrefixes[WorldSettings],
    scenario: str = "experiment",
    policy: str = "kuramoto-mpcc",
    duration: _Duration = None,
    out: OutFile = None,
    output: OutputOptions = DEFAULT_OUTPUT,
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
    changes = parse_overrides(overrides) | ({} if duration is None else {"task.duration": duration})
    setup = named.scenario(scenario, **changes)
    robots = RobotSettings(policy=policy, command=settings.command, message_loss=setup.noise.message_loss)
    play(setup, settings, out, output, robots)
