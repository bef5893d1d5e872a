"""The command `lissajous run`: one episode, played and shown."""

from typing import Annotated

import tyro

from baselines.benchmark import shown
from baselines.benchmark.theorem import about_theorem
from baselines.commands.playing import DEFAULT_PLAY, FORMATS, PlayOptions, check_file, has_display, record_one, show
from lissajous_env.console.terminal import OutFile, RogueName, ScenarioName, print_line

_PolicyName = Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[POLICY]", help_behavior_hint="")]


def run(
    scenario: ScenarioName,
    policy: _PolicyName = None,
    out: OutFile = None,
    rogues: RogueName = None,
    common: PlayOptions = DEFAULT_PLAY,
) -> None:
    """Play one episode and print its scores; show it in a window, or write a page, a film, a recording or a log.

    Example:
        lissajous run evaders kuramoto-mpcc --seed 3 --out episode.html

    Args:
        scenario: name of a scenario, .toml file, or module:attribute.
        policy: name of a policy, folder of a checkpoint or of a plan, or module:factory. If only a folder is given, its
            policy is played on the scenario for which it was made.
        out: file to write, ending in .html, .mp4, .gif, .npz (a recording) or .mcap (a log of
            ROS); without it, a window opens if there is a display.
    """
    check_file(out, *FORMATS)
    cell = common.cell((scenario,) if policy is None else (scenario, policy), rogues=rogues)
    recording = record_one(cell, common.seed, common)
    row = recording.score
    shown.print_row(common.console(), row, recording.scenario)
    shown.print_theorem(common.console(), about_theorem([cell], [row], common.device))
    common.print_json(row)
    if out is not None or has_display():
        show(recording, out, common)
    else:
        words = f"there is no display for a window; --out FILE writes {', '.join(FORMATS)} instead"
        print_line(common.progress(), words)
