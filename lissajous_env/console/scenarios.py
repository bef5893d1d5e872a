"""The command `lissajous scenarios`."""

import functools
import json
from pathlib import Path
from typing import Any

from rich.console import Console

from lissajous_env.console.terminal import DEFAULT_OUTPUT, Column, Output, ScenarioNames, print_line, print_table
from lissajous_env.parameters import named
from lissajous_env.parameters.assumptions import violations
from lissajous_env.parameters.scenario import PARTS, Scenario
from lissajous_env.parameters.scenario_file import changed_fields
from lissajous_env.world.columns import task_score

_FEEDBACK = Path(named.__file__).with_name("feedback.json")
"""Measured values of feedback of scenarios, by name: `python benchmarks/feedback.py --store` writes it."""


def scenarios(names: ScenarioNames = (), output: Output = DEFAULT_OUTPUT) -> None:
    """List the scenarios and their designs; for named scenarios, print every field and every violated assumption.

    Example:
        lissajous scenarios intruders team

    Args:
        names: names of scenarios, .toml files, or module:attribute; SPACE:SPLIT:COUNT, such as watch-v1:test:2, stands
            for the first COUNT scenarios of a split; all scenarios by default.
    """
    console = output.console()
    given = [named.build(name) for name in named.expanded(names) or named.scenarios()]
    resolved_scenarios = [scenario.resolve() for scenario in given]
    _print_designs(console, resolved_scenarios)
    if names:
        for scenario in given:
            _print_settings(console, scenario)
            if sentences := violations(scenario):
                console.print("\nViolated assumptions of the paper:")
            for words in sentences:
                print_line(console, f"* {words}")
    derived = ("num_robots", "detection_time_bound", "detection_time_is_bounded")
    output.print_json([
        scenario.to_dict()
        | {name: getattr(scenario, name) for name in derived}
        | {"score": task_score(scenario).name, "value_of_feedback": value_of_feedback(scenario)}
        | {"violations": violations(scenario)}
        for scenario in resolved_scenarios
    ])  # fmt: skip


def _print_designs(console: Console, resolved_scenarios: list[Scenario]) -> None:
    titles = "rectangle\n[m]", "curve\na:b", "r_s\n[m]", "T_max\n[s]", "feed-\nback"
    columns = [Column("name", left=True, style="bold cyan"), "N", Column("robots", left=True)]
    columns += [*titles, Column("description", prose=True, rank=1)]
    rows = []
    for scenario in resolved_scenarios:
        curve = scenario.curve
        name = f"{curve.a}:{curve.b}" + (f":{curve.c}" if curve.half_depth > 0 else "")
        sides = [2 * curve.half_width, 2 * curve.half_height, 2 * curve.half_depth]
        rows.append([
            scenario.name,
            str(scenario.num_robots),
            scenario.robot.kind,
            " x ".join(f"{side:g}" for side in sides if side > 0),
            "series" if curve.harmonics else name,
            f"{scenario.sensing.radius:.3g}",
            f"{scenario.detection_time_bound:.3g}" if scenario.detection_time_is_bounded else "-",
            "-" if (value := value_of_feedback(scenario)) is None else f"{value:.3g}",
            scenario.description,
        ])  # fmt: skip
    print_table(console, columns, rows)
    words = (
        "\nN: number of robots; series: a curve that is rounded within walls, or another one than Lissajous's; r_s: "
        "sensing radius; T_max = (2 pi / omega) / (N / kappa): detection-time bound of the undisturbed formation. -: "
        "no bound, because r_s does not satisfy (8) or N is not a + b. feedback: score of the best rule that reacts to "
        "targets over that of the best patrol; 1 where no observation says where an undetected target is."
    )
    console.print(words, style="dim", highlight=False)


def _print_settings(console: Console, given: Scenario) -> None:
    """Print the fields of a scenario that differ from their defaults, and the score of its task."""
    rows = [
        [f"{part}.{name}", str(value), str(getattr(PARTS[part](), name))]
        for part, changed in changed_fields(given).items()
        for name, value in changed.items()
    ]
    for extension in given.extensions:
        settings = ", ".join(f"{name} = {value}" for name, value in extension.settings.items())
        rows.append(["extensions", f"{extension.kind} {extension.place}{settings and f' ({settings})'}", ""])
    columns = [Column("field", left=True), Column(given.name, prose=True), Column("default", left=True, rank=1)]
    console.print()
    print_table(console, columns, rows)
    score = f"The score of its task is {task_score(given).name}."
    words = f"{given.name}: fields that differ from the defaults; digest {given.digest()}. {score}"
    console.print(words, style="dim", markup=False)


@functools.cache
def measured() -> dict[str, dict[str, Any]]:
    """Return for each measured scenario its `value` of feedback, its 95 % interval, and the policy that reaches it.

    `sees_all` is the ratio for a rule that sees all targets, with its interval; it is no bound.
    """
    values: dict[str, dict[str, Any]] = json.loads(_FEEDBACK.read_text(encoding="utf-8"))
    return values


def value_of_feedback(scenario: Scenario) -> float | None:
    """Return the score of the best rule that reacts to targets over that of the best patrol, which observes none.

    Above 1, reacting is better. It is 1 where targets appear independently of everything and leave when they are first
    observed: then no observation says where an undetected target is. It is None where it has not been measured.
    """
    entry = measured().get(scenario.name)
    if entry is not None and scenario.resolve() == named.build(scenario.name).resolve():
        return float(entry["value"])
    targets = scenario.targets
    leaves_at_sight = targets.leave and not targets.respawn and scenario.sight <= scenario.sensing_radius
    independent = targets.entry != "hotspots" and not scenario.extensions
    return 1.0 if leaves_at_sight and independent else None
