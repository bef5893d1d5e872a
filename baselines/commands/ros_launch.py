"""The command `lissajous ros launch`: the simulated world and all robots, each as a process."""

import contextlib
import os
import tempfile
from pathlib import Path
from typing import Annotated

import tyro

from baselines.commands.playing import FORMATS, check_file
from baselines.onboard import Onboard
from baselines.ros.settings import CommandKind, WorldSettings, check_command
from lissajous_env.console.terminal import DEFAULT_OUTPUT, OutFile, OutputOptions, Overrides, parse_overrides
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario_file import as_toml

_Duration = Annotated[float | None, tyro.conf.arg(metavar="FLOAT")]


def launch(
    scenario: str = "experiment",
    policy: str = "kuramoto-mpcc",
    duration: _Duration = None,
    seed: int = 0,
    pace: float = 1.0,
    command: CommandKind = "car",
    out: OutFile = None,
    output: OutputOptions = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Run a simulated world and all robots over ROS 2, each as a process, and print the score.

    The processes communicate on this machine alone, unless ROS_AUTOMATIC_DISCOVERY_RANGE is set. All of them are
    stopped at Ctrl-C, or when one of them ends.

    Example:
        lissajous ros launch --scenario experiment --policy kuramoto-mpcc --duration 20

    Args:
        scenario: name of a scenario, .toml file, or module:attribute.
        policy: name of a policy, folder of a checkpoint, or module:factory.
        duration: duration of the episode [s]; by default that of the scenario.
        seed: seed of the episode.
        pace: largest number of simulated seconds per second; the simulation waits for the robots' decisions.
        command: kind of the robots' commands: car or dart, of differential drives twist or twist_stamped.
        out: file to write, as in `lissajous ros world`.
    """
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    from baselines.ros import library  # noqa: F401 - the extra is named before anything is started
    from baselines.ros.launching import run_team

    check_file(out, *FORMATS)
    WorldSettings(pace=pace)  # for its checks, before anything is started
    changes = parse_overrides(overrides) | ({} if duration is None else {"task.duration": duration})
    setup = named.scenario(scenario, **changes)
    check_command(setup, command)
    Onboard(policy, setup, 0)  # a wrong policy is reported once, and the kernels are compiled once
    with contextlib.ExitStack() as stack:
        given = scenario
        if changes:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="lissajous-"))
            file = Path(folder, "scenario.toml")
            file.write_text(as_toml(setup), encoding="utf-8")
            given = str(file)
        shared = ["--scenario", given, "--command", command]
        world = ["--seed", str(seed), "--pace", str(pace), *(["--out", str(out.resolve())] if out is not None else [])]
        world += [flag for flag, given in (("--json", output.json), ("--quiet", output.quiet)) if given]
        robots = ["--policy", policy, "--message-loss", str(setup.noise.message_loss), "--quiet"]
        robots += ["--ros-args", "-p", "use_sim_time:=true", *(["--log-level", "warn"] if output.quiet else [])]
        run_team(setup.num_robots, [*shared, *world], [*shared, *robots])
