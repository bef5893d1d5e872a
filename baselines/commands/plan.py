"""The command `lissajous plan`: the patrols that a team can run, and what each guarantees."""

import re
from contextlib import nullcontext
from typing import Annotated, Any, Literal

import tyro
from rich import progress as bars

from baselines.benchmark.progress import bar
from baselines.commands.playing import progress_console
from baselines.planning import report
from baselines.planning.budget import Budget
from baselines.planning.planner import Outcome
from baselines.planning.plans import top_speed
from baselines.planning.request import Request
from baselines.planning.search import Search
from lissajous_env.console.options import OutFolder
from lissajous_env.console.terminal import DEFAULT_OUTPUT, OutputOptions, print_line
from lissajous_env.settings.checks import whole_number
from lissajous_env.wording import shown

_Scenario = Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[SCENARIO]", help_behavior_hint="")]


def plan(
    scenario: _Scenario = None,
    width: float | None = None,
    height: float | None = None,
    open: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    robots: str | None = None,
    robot_radius: float | None = None,
    sensor_radius: float | None = None,
    speed: float | None = None,
    turning_radius: float | None = None,
    robot: Literal["curve", "car", "differential"] | None = None,
    acceleration: float | None = None,
    rogue_speed: float | None = None,
    entry: Literal["inside", "boundary", "unseen"] | None = None,
    failures: int = 0,
    guarantee: float | None = None,
    clearance: float | None = None,
    plans: int | None = None,
    seconds: float | None = None,
    optimise: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    fixed_start: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    rows: int = 8,
    seed: int = 0,
    out: OutFolder = None,
    output: OutputOptions = DEFAULT_OUTPUT,
) -> int:
    """Find patrols for a team, simulate them, and print which are best and what each guarantees.

    The plans are partitions, lines, formations on Lissajous curves, loops, and every included classical policy. The
    table shows those that no other plan dominates. The exit code is 1 if there is none without collisions.

    Example:
        lissajous plan evaders --failures 1 --out plans

    Args:
        scenario: name of a scenario, .toml file, or module:attribute from which missing options are taken; without it,
            the rectangle and the robots must be given.
        width: width of the rectangle [m].
        height: height of the rectangle [m].
        open: plan for open ground: bodies may leave the rectangle, and the table has the space outside that a plan
            needs. Without it, a rectangle that is given by its width and height has walls.
        robots: number of robots, or a range such as 3:8.
        robot_radius: radius of a robot's body [m].
        sensor_radius: radius of a robot's sensing disc [m].
        speed: top speed of the robots [m/s].
        turning_radius: radius of a car's tightest circle [m]; without it and --robot, robots are points that stay on
            the curve, and all plans are formations.
        robot: kind of the robots: points on the curve, cars, or differential drives, which turn on the spot.
        acceleration: largest acceleration of differential drives [m/s^2].
        rogue_speed: top speed of evading targets that know the robots' future [m/s]; 0 by default.
        entry: place where targets appear: anywhere in the rectangle, on its boundary, or outside all sensing discs.
        failures: number of robots that fail for good: each combination of as many is removed once.
        guarantee: time within which every target must be detected [s]; if robots is a range, the command searches for
            the smallest number that achieves it.
        clearance: least distance of two bodies [m]; plans whose bodies come closer are marked and come after the
            others. It is a tenth of a body's diameter by default.
        plans: number of plans that are tried for each number of robots, 200 by default; a fifth as many of the best
            ones are then simulated to the end. The result does not depend on the speed of the machine.
        seconds: duration of the search [s], in place of a number of plans.
        optimise: also improve paths of any form by CMA-ES, from the best plans; requires the extra `plan` and a longer
            search.
        fixed_start: include only plans whose robots begin where the scenario places them.
        rows: largest number of plans to show and to write.
        seed: seed of the simulated episodes and of the search.
        out: folder to which the plans are written, one folder each, with a picture of the best three.
    """
    whole_number("rows", rows)
    budget = Budget.of(plans, seconds)
    outcome = Outcome.of(Request(
        scenario, width, height, open, _range(robots), robot_radius, sensor_radius, speed, turning_radius, robot,
        acceleration, rogue_speed, entry, failures, guarantee, clearance, seed,
    ))  # fmt: skip
    with nullcontext() if out is None else report.open_folder(out) as folder:
        _search(outcome, budget, optimise, fixed_start, output)
        if outcome.interrupted and not outcome.finals:
            raise KeyboardInterrupt("no plan had been played to the end")
        shown_ones = outcome.plans[:rows]
        _print(output.console(), outcome, shown_ones)
        if folder is not None and shown_ones:
            report.write(folder, shown_ones, outcome.request.episodes)
            output.print(f"wrote {len(shown_ones)} plans and {report.PICTURE} in {out}")
            output.print(f"Watch one: lissajous run {out}/1 --out plan.html")
    output.print_json({
        "plans": report.as_rows(shown_ones),
        "limits": outcome.limits,
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
    met = outcome.request.guarantee is None or outcome.fewest_robots is not None
    return 0 if shown_ones and met else 1


def _search(outcome: Outcome, budget: Budget, optimise: bool, fixed_start: bool, output: Any) -> None:
    """Search with a progress bar."""
    counted = bars.TextColumn("{task.fields[looks]} plans tried, {task.fields[finals]} played")
    with bar(progress_console(output), bars.TextColumn("{task.description}"), counted) as shown_bar:
        task = shown_bar.add_task("planning", total=1.0, looks=0, finals=0)

        def progress(share: float, outcome: Outcome, search: Search) -> None:
            looks, finals = outcome.looks + len(search.looks), len(outcome.finals) + len(search.finals)
            name = f"planning {search.task.name}, N = {search.task.num_robots}"
            shown_bar.update(task, completed=min(share, 1.0), description=name, looks=looks, finals=finals)

        outcome.search(budget, optimise, fixed_start, progress)


def _print(console: Any, outcome: Outcome, plans: list) -> None:
    if untried := report.untried_in_words(outcome):
        print_line(console, untried, "bold")
    if plans:
        title = f"Plans for {_asked(outcome)}: {len(plans)} that no other dominates"
        print_line(console, title, "italic")
        report.print_plans(console, outcome, plans)
    else:
        print_line(console, f"No plan without collisions was found for {_asked(outcome)}.")
    for line in report.sentences(outcome):
        print_line(console, line)


def _asked(outcome: Outcome) -> str:
    """Return a phrase with the rectangle and the robots."""
    numbers, (task, *_) = list(outcome.tasks), list(outcome.tasks.values())
    team = f"{numbers[0]} to {numbers[-1]}" if len(numbers) > 1 else f"{numbers[0]}"
    return (
        f"{2 * task.curve.half_width:g} m x {2 * task.curve.half_height:g} m, {team} robots of {task.robot.radius:g} m "
        f"and {top_speed(task):.3g} m/s, sensors of {task.sensing_radius:.3g} m, targets of {task.rogue_speed:g} m/s"
    )


def _range(robots: str | None) -> tuple[int, int] | None:
    """Return the fewest and the most robots of a text such as 5 or 3:8."""
    if robots is None:
        return None
    found = re.fullmatch(r"(\d{1,4})(?::(\d{1,4}))?", robots)
    if found is None:
        raise ValueError(f"robots must be a number, or a range such as 3:8, got {shown(robots)}")
    return int(found[1]), int(found[2] or found[1])
