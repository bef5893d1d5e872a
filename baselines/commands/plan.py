"""The command `lissajous plan`: the patrols that a team can run, and what each guarantees."""

from contextlib import nullcontext
from dataclasses import dataclass
from typing import Annotated, Any

import tyro

from baselines.planning import report
from baselines.planning.plans import robots_top_speed
from baselines.planning.request import PLANS, Request
from baselines.planning.search import PlanOutcome
from lissajous_env.console.terminal import DEFAULT_OUTPUT, OutFolder, Output, bar, print_line
from lissajous_env.settings.checks import whole_number
from lissajous_env.wording import counted


@dataclass(frozen=True)
class Options(Request, part=""):
    """The request as options of the command, whose library is not imported with `baselines`."""

    scenario: Annotated[
        str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[SCENARIO]", help_behavior_hint="")
    ] = None
    """Name of a scenario, .toml file, or module:attribute from which missing options are taken; without it, the
    rectangle and the robots must be given."""


def plan(
    request: Options,
    rows: int = 8,
    out: OutFolder = None,
    output: Output = DEFAULT_OUTPUT,
) -> int:
    """Find patrols for a team, simulate them, and print which are best and what each guarantees.

    The plans are partitions, lines, formations on Lissajous curves, loops, and every included classical policy. The
    table shows those that no other plan dominates. The exit code is 1 if there is none without collisions.

    Example:
        lissajous plan evaders --failures 1 --out plans

    Args:
        request: Subject and extent of the search.
        rows: largest number of plans to show and to write.
        out: folder to which the plans are written, one folder each.
    """
    whole_number("rows", rows)
    outcome = PlanOutcome.of(request)
    with nullcontext() if out is None else report.open_folder(out, min(rows, PLANS)) as folder:
        _search(outcome, output)
        if outcome.interrupted and not outcome.finals:
            raise KeyboardInterrupt("no plan had been played to the end")
        plans = outcome.plans[:rows]
        _print(output.console(), outcome, plans)
        if folder is not None and plans:
            report.write(folder, plans, request.episodes)
            output.print(f"wrote {counted(len(plans), 'plan')} in {out}")
            output.print(f"Watch one: lissajous run {out}/1 --out plan.html")
    output.print_json({
        "plans": report.as_rows(plans),
        "lower_bounds": outcome.lower_bounds,
        "fewest_robots": outcome.fewest_robots,
        "looked_at": outcome.looks,
        "seconds": outcome.seconds,
        "played": len(outcome.finals),
        "refusals": outcome.refusals,
        "untried": outcome.untried,
        "words": [words for words in (report.untried_in_words(outcome), *report.sentences(outcome)) if words],
    })  # fmt: skip
    if outcome.interrupted:
        raise KeyboardInterrupt("the plans above are the best that were played until then")
    met = request.guarantee is None or outcome.fewest_robots is not None
    return 0 if plans and met else 1


def _search(outcome: PlanOutcome, output: Any) -> None:
    """Search with a progress bar."""
    with bar(output.progress(), "{task.fields[looks]} plans tried, {task.fields[finals]} played") as shown_bar:
        task = shown_bar.add_task("planning", total=1.0, looks=0, finals=0)

        def progress(share: float, outcome: PlanOutcome) -> None:
            number, search = list(outcome.searches.items())[-1]
            finals = sum(len(entry.finals) for entry in outcome.searches.values())
            name = f"planning {search.scenario.name}, N = {number}"
            shown_bar.update(task, completed=min(share, 1.0), description=name, looks=outcome.looks, finals=finals)

        outcome.search(progress)


def _print(console: Any, outcome: PlanOutcome, plans: list) -> None:
    if untried := report.untried_in_words(outcome):
        print_line(console, untried, "bold")
    if plans:
        print_line(console, f"Plans for {_team_in_words(outcome)}: {len(plans)} that no other dominates", "italic")
        report.print_plans(console, outcome, plans)
    else:
        print_line(console, f"No plan without collisions was found for {_team_in_words(outcome)}.")
    for line in report.sentences(outcome):
        print_line(console, line)


def _team_in_words(outcome: PlanOutcome) -> str:
    """Return a phrase with the rectangle and the robots."""
    numbers, (scenario, *_) = list(outcome.scenarios), list(outcome.scenarios.values())
    team = f"{numbers[0]} to {numbers[-1]} robots" if len(numbers) > 1 else counted(numbers[0], "robot")
    curve, speed = scenario.curve, f" and {robots_top_speed(scenario):.3g} m/s".replace(" and nan m/s", "")
    return (
        f"{2 * curve.half_width:g} m x {2 * curve.half_height:g} m, {team} of {scenario.robot.radius:g} m{speed}, "
        f"sensors of {scenario.sensing_radius:.3g} m, targets of {scenario.rogue_speed:g} m/s"
    )
