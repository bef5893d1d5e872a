"""The command `lissajous policies`: a list of the policies."""

from typing import Annotated

import tyro

from baselines.policies import registry
from lissajous_env.console.terminal import DEFAULT_OUTPUT, Column, Output, print_table

_ScenarioOrNone = Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[SCENARIO]")]


def policies(scenario: _ScenarioOrNone = None, output: Output = DEFAULT_OUTPUT) -> None:
    """List the policies, each with the robots that it drives and a description.

    Example:
        lissajous policies team

    Args:
        scenario: name of a scenario, .toml file, or module:attribute; with it, only policies that drive its robots are
            listed.
    """
    listed = [registry.describe(name) for name in registry.names(scenario)]
    output.print_json(listed)
    columns = [
        Column("name", left=True, style="bold cyan"),
        Column("robots", left=True),
        Column("steered by", left=True, rank=2),
        Column("for", prose=True, rank=1),
        Column("description", prose=True),
    ]
    rows = [
        [of["name"], of["kind"] or "any", of["steered_by"], ", ".join(of["made_for"]) or "any", of["description"]]
        for of in listed
    ]
    print_table(output.console(), columns, rows)
    words = (
        "\nA policy can also be given as a checkpoint's folder; as module:factory, where factory(scenario, num_worlds, "
        "device) returns a policy; as module:act, where act(observation) returns actions; or by a name that a module "
        "registers which --import MODULE imports."
    )
    output.console().print(words, style="dim", highlight=False)
