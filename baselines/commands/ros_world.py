"""The command `lissajous ros world`: the simulation in place of the robots' hardware, over ROS 2."""

from dataclasses import replace

import tyro
from rich import progress as bars

from baselines.benchmark.progress import bar
from baselines.commands.playing import FORMATS, check_file, progress_console, show
from baselines.ros.settings import WorldSettings
from lissajous_env.console.terminal import DEFAULT_OUTPUT, OutFile, OutputOptions, Overrides, parse_overrides
from lissajous_env.parameters import named


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
    from baselines.benchmark.shown import print_row
    from baselines.ros.running import started
    from baselines.ros.world import WorldNode

    check_file(out, *FORMATS)
    setup = named.scenario(scenario, **parse_overrides(overrides))
    console = output.console()
    shown = bar(progress_console(output), bars.TextColumn("{task.description}"))
    with started() as process, shown as shown_bar:
        node = WorldNode(setup, settings)
        process.nodes.append(node)
        task = shown_bar.add_task(f"{setup.name} over ROS 2", total=setup.task.steps)
        recording = node.play(lambda: shown_bar.advance(task), process.check)
    recording = replace(recording, score=recording.score | {"policy": "ros"})
    print_row(console, recording.score, recording.scenario)
    output.print_json(recording.score)
    if out is not None:
        show(recording, out, output)
