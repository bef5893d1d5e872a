"""The command `lissajous policies`: a list of the policies."""

from collections.abc import Sequence
from typing import Annotated

import tyro

from baselines.policies import registry
from lissajous_env.console.terminal import DEFAULT_OUTPUT, Column, OutputOptions, print_table

_ScenarioOrNone = Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[SCENARIO]")]


def policies(scenario: _ScenarioOrNone = None, output: OutputOptions = DEFAULT_OUTPUT) -> None:
    """List the policies, each with the robots that it drives and a description.

    Example:
        lissajous policies team

    Args:
        scenario: name of a scenario, .toml file, or module:attribute; with it, only policies that drive its robots are
            listed.
    """
    listed = [registry.describe(name) for name in registry.names(scenario)]
    output.print_json(listed)
    console = output.console()
    columns = [
        Column("name", left=True, style="bold cyan"),
        Column("robots", left=True),
        Column("made", left=True, rank=2),
        Column("for", prose=True, rank=1),
        Column("description", prose=True),
    ]
    rows = [_described(**entry) for entry in listed]
    print_table(console, columns, rows)
    words = (
        "\nA policy can also be given as a checkpoint's folder; as module:factory, where factory(scenario, num_worlds, "
        "device) returns a policy; as module:act, where act(observation) returns actions; or by a name that a module "
        "registers which --import MODULE imports."
    )
    console.print(words, style="dim", highlight=False)


def _described(name: str, kind: str | None, made_for: Sequence[str], learned: bool, description: str) -> list[str]:
    return [name, kind or "any", "learned" if learned else "classical", ", ".join(made_for) or "any", description]
