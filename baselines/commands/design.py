"""The command `lissajous design`: a curve and a number of robots for a rectangle, tried in simulation."""

import dataclasses
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from baselines.designing import Played, first_that_works, scenario_of
from lissajous_env.console.recordings import check_file
from lissajous_env.console.terminal import DEFAULT_OUTPUT, Column, OutputOptions, print_left_out, print_table
from lissajous_env.device.devices import cores
from lissajous_env.episodes.guarantee import Reach, reach_of
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import as_toml
from lissajous_env.settings.parts import Curve, Robot
from lissajous_env.storage.files import replacing
from lissajous_env.theory import design as theory
from lissajous_env.theory.candidate import Candidate
from lissajous_env.wording import shown
from lissajous_env.world.columns import DETECTED, TARGETS

_Scenario = Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[SCENARIO]", help_behavior_hint="")]
_Out = Annotated[Path | None, tyro.conf.arg(metavar="FILE")]
_Reaches = dict[Candidate, Reach]
_ROGUES = "undetected\n[s]", "for ever\nfrom [m/s]"
_SENSOR = 1.3
"""Default sensing radius [m], with which the paper's experiment meets Eq. (7) and (8)."""


def design(
    scenario: _Scenario = None,
    half_width: float | None = None,
    half_height: float | None = None,
    robot_radius: float | None = None,
    sensor_radius: float | None = None,
    speed_max: float | None = None,
    num_robots: int | None = None,
    turning_radius: float | None = None,
    wheelbase: float | None = None,
    steering_max: float | None = None,
    grip: float | None = None,
    headroom: float = theory.HEADROOM,
    phase_rate: float | None = None,
    rogue_speed: float | None = None,
    rows: int = 5,
    seed: int = 0,
    out: _Out = None,
    output: OutputOptions = DEFAULT_OUTPUT,
) -> int:
    """Find the curve and the number of robots for a rectangle, play the design, and write it as a scenario's file.

    The formation moves as fast as the robots can drive the curve, less the headroom. Robots are cars if a turning
    circle is given or the scenario has cars; otherwise they turn on the spot and are simulated as points on the curve.
    The exit code is 1 if no design works.

    Example:
        lissajous design --half-width 5 --half-height 5 --robot-radius 0.1 --sensor-radius 1.5 --speed-max 2

    Options:
        area and sensor: half_width, half_height, sensor_radius
        robots: num_robots, robot_radius, speed_max, turning_radius, wheelbase, steering_max, grip
        formation: phase_rate, headroom
        evading targets: rogue_speed
        results: rows, seed, out

    Args:
        scenario: name of a scenario, .toml file, or module:attribute from which missing options are taken; by default
            the rectangle and the robots of the paper's experiment.
        half_width: A, half of the rectangle's width [m].
        half_height: B, half of the rectangle's height [m].
        robot_radius: radius of a robot's body [m].
        sensor_radius: radius of a robot's sensing disc [m].
        speed_max: top speed of the robots [m/s]; required without a scenario with cars.
        num_robots: number of robots; by default every number is tried.
        turning_radius: radius of a car's tightest circle [m], in place of its wheelbase.
        wheelbase: distance between a car's axles [m].
        steering_max: largest steering angle of a car [rad].
        grip: largest lateral acceleration of a car [m/s^2].
        headroom: share of the top speed and of the grip that is reserved for robots that must catch up; 0 allows the
            fastest formation, which cannot recover from faults.
        phase_rate: omega, rate of the robots along the curve's parameter [rad/s]; by default the largest that the
            robots can drive, less the headroom.
        rogue_speed: top speed of evading targets that know the robots' future [m/s]; adds the time for which one can
            stay undetected, and the speed from which one can do so for ever.
        rows: number of designs that work, and of designs that do not, to show.
        seed: seed of the simulated episodes.
        out: .toml file to which the recommended design is written.
        output: Console output.
    """
    if rogue_speed is not None and not 0 <= rogue_speed <= 100:
        raise ValueError(f"rogue_speed must be from 0 to 100 [m/s], got {shown(rogue_speed)}")
    if not isinstance(rows, int) or rows < 1:
        raise ValueError(f"rows must be a whole number of at least 1, got {shown(rows)}")
    check_file(out, ".toml")
    base = None if scenario is None else named.build(scenario)
    robot = _robot(base, robot_radius, speed_max, turning_radius, wheelbase, steering_max, grip)
    curve = Curve() if base is None else base.curve
    candidates = theory.design(
        curve.half_width if half_width is None else half_width,
        curve.half_height if half_height is None else half_height,
        robot.radius,
        (_SENSOR if base is None else base.sensing_radius) if sensor_radius is None else sensor_radius,
        robot.top_speed,
        num_robots,
        phase_rate,
        robot.wheelbase if robot.kind == "car" else None,
        robot.steering_max,
        robot.lateral_acceleration_max,
        headroom,
    )
    return _answer(candidates, robot, base, rogue_speed, rows, seed, phase_rate is None, out, output)


def _robot(
    base: Scenario | None,
    radius: float | None,
    speed_max: float | None,
    turning_radius: float | None,
    wheelbase: float | None,
    steering_max: float | None,
    grip: float | None,
) -> Robot:
    """Make the robot: that of the base, with the options that were given."""
    if turning_radius is not None and wheelbase is not None:
        raise ValueError(f"turning_radius must be left out beside wheelbase [m], got {shown(turning_radius)}")
    robot = Robot(kind="curve") if base is None else base.robot
    if robot.kind == "curve" and (turning_radius is not None or wheelbase is not None):
        robot = dataclasses.replace(robot, kind="car")
    if speed_max is None and (base is None or base.robot.kind != "car"):
        raise ValueError(
            "speed_max must be given, the top speed of the robots [m/s], or a scenario with cars, got None"
        )
    given: dict[str, Any] = {"count": None, "phase_rate_max": None}
    if speed_max is not None:
        given |= {"speed_max": speed_max, "throttle_max": None}
    named_fields = {"radius": radius, "wheelbase": wheelbase, "steering_max": steering_max}
    given |= {name: value for name, value in named_fields.items() if value is not None}
    if grip is not None:
        given["lateral_acceleration_max"] = grip
    if turning_radius is not None:
        if not turning_radius > 0:
            raise ValueError(f"turning_radius must be positive [m], got {shown(turning_radius)}")
        given["wheelbase"] = turning_radius * math.tan(robot.steering_max if steering_max is None else steering_max)
    return dataclasses.replace(robot, **given)


def _answer(
    candidates: Sequence[Candidate],
    robot: Robot,
    base: Scenario | None,
    rogue_speed: float | None,
    rows: int,
    seed: int,
    may_slow_down: bool,
    out: Path | None,
    output: Any,
) -> int:
    """Print the designs, simulate those that should work until one does, and write that one."""
    console, listed = output.console(), list(candidates)
    feasible = [each for each in listed if each.feasible]
    worth = theory.worth_playing(listed)
    works = worth[:rows]
    others = [each for each in listed if not each.feasible and each not in works][:rows]
    reaches: _Reaches = {}
    if rogue_speed is not None:
        followed = works or others
        scenarios = [scenario_of(each, robot, base, rogue_speed) for each in followed]
        with ThreadPoolExecutor(cores()) as threads:
            reached = threads.map(lambda made: reach_of(made, rogue_speed), scenarios)
            reaches = dict(zip(followed, reached, strict=True))
    left_out: list[str] = []
    if works:
        how = "meet all conditions" if feasible else "work by what is measured, though (6) or (7) requires more"
        left_out += _print_designs(console, f"Designs for {_asked(listed[0])}: {len(worth)} {how}", works, reaches)
    if others:
        title = "Designs that fail by least" if works else f"Designs for {_asked(listed[0])}: none meets all conditions"
        left_out += _print_failing(console, title, others, {} if works else reaches)
    print_left_out(console, left_out, "--json has them, and a wider terminal shows them.")

    played, refused = first_that_works(worth, robot, base, rogue_speed, seed, may_slow_down)
    chosen = played.candidate if played is not None else worth[0] if worth and not refused else None
    words = [
        f"Refused: {theory.in_words(each.candidate)} at omega = {each.candidate.phase_rate:.3g} rad/s. "
        f"Played: {'; '.join(each.failures)}."
        for each in refused
    ]
    made = None
    if chosen is None:
        helps = "A larger headroom, smaller bodies, a tighter turning circle or another number of robots may help"
        played_in_vain = f"none of the {len(refused)} that were played. {helps}."
        failed = f"{theory.what_fails(listed)}. {theory.what_would_help(listed)}"
        words.append(f"No design works: {played_in_vain if refused else failed}")
        if listed[0] in reaches and not refused:
            words.append(f"{theory.in_words(listed[0])}: {_words_of_rogues(reaches[listed[0]], rogue_speed)}")
    else:
        made = played.scenario if played is not None else scenario_of(chosen, robot, base, rogue_speed)
        words += _recommendation(chosen, reaches.get(chosen), rogue_speed)
        words.append(_done(played) if played else f"Not played: no method of the package drives {robot.kind} robots.")
    for line in words:
        console.print(line, soft_wrap=True, markup=False, highlight=False)
    text = None if made is None else as_toml(made)
    if text is not None:
        _print_file(console, text, played, out)
    output.print_json({
        "recommendation": None if chosen is None else _as_plain(chosen),
        "words": words,
        "episodes": [] if played is None else played.rows,
        "refused": [{"design": _as_plain(each.candidate), "failures": each.failures} for each in refused],
        "scenario": text,
        "feasible": len(feasible),
        "designs": [_as_plain(each) | (reaches[each]._asdict() if each in reaches else {}) for each in works + others],
    })  # fmt: skip
    return 0 if chosen is not None else 1


def _print_file(console: Console, text: str, played: Played | None, out: Path | None) -> None:
    """Write the file of the recommended design, or print it to be saved, and say how to go on."""
    name = "design.toml" if out is None else str(out)
    if out is None:
        console.print(f"\nSave the lines that follow as {name}, or let --out write them.\n", highlight=False)
        console.print(text, soft_wrap=True, markup=False, highlight=False)
    else:
        with replacing(out) as temporary, open(temporary, "w", encoding="utf-8") as file:
            file.write(text)
        console.print(f"wrote {out}", soft_wrap=True, markup=False, highlight=False)
    policy = "POLICY" if played is None else played.policy
    console.print(f"Watch it: lissajous run {name} {policy} --out design.html", soft_wrap=True, markup=False)


def _asked(each: Candidate) -> str:
    curve = each.curve
    words = f"{2 * curve.half_width:g} m x {2 * curve.half_height:g} m, bodies of {each.robot_radius:g} m"
    words += f", sensors of {each.sensor_radius:g} m, robots of {each.speed_max:.3g} m/s"
    return words if each.turning_radius is None else f"{words} that turn at {each.turning_radius:.3g} m"


def _recommendation(each: Candidate, reach: Reach | None, rogue_speed: float | None) -> list[str]:
    """Return a description of the design, of its requirements, and of what evading targets can do."""
    used = each.top_speed / each.speed_max
    words = [
        f"Take {theory.in_words(each)} (p = {each.p}, alpha = {each.alpha}) at omega = {each.phase_rate:.4g} rad/s: "
        f"a lap takes {each.lap_time:.4g} s, and in formation every target is detected within "
        f"T_max = {each.detection_time_bound:.4g} s.",
        f"The curve requires {each.slowest_speed:.3g} to {each.top_speed:.3g} m/s, {each.mean_speed:.3g} m/s on "
        f"average: at most {used:.0%} of the robots' {each.speed_max:.3g} m/s.",
    ]
    if each.turning_radius is not None:
        bend = each.smallest_curvature_radius
        tight = f"{each.tight_share:.1%} of the arc is tighter, and cars cut these corners"
        words.append(
            f"Its sharpest bend has a radius of {bend:.2g} m, the cars turn at {each.turning_radius:.3g} m: "
            + (tight if bend < each.turning_radius else "they can follow all of it")
            + "."
        )
    if not each.avoids_collisions:
        words.append(
            f"Bodies of {each.robot_radius:g} m exceed (6), {each.robot_radius_bound:.4g} m, but not half of the "
            f"smallest distance in the undisturbed formation, {each.robot_radius_measured:.4g} m."
        )
    if not each.covers:
        words.append(
            f"Sensors of {each.sensor_radius:g} m do not meet (7), {each.coverage_radius:.4g} m, but a lap covers the "
            f"rectangle from {each.coverage_radius_measured:.4g} m on."
        )
    if reach is not None:
        words.append(_words_of_rogues(reach, rogue_speed))
    return words


def _words_of_rogues(reach: Reach, speed: float | None) -> str:
    limit = f"{reach.critical_speed:.3g} m/s"
    if reach.guaranteed_time == math.inf:
        return f"A target of {speed:g} m/s can stay undetected for ever, one slower than {limit} cannot."
    words = f"In formation a target of {speed:g} m/s stays undetected for {reach.guaranteed_time:.3g} s at most"
    return f"{words}, one from {limit} on for ever." if reach.critical_speed < math.inf else f"{words}."


def _done(played: Played) -> str:
    """Return a description of a simulated design."""
    targets, detected = TARGETS.name, DETECTED.name
    appeared = sum(row[targets] for row in played.rows)
    found = sum(round(row[detected] * row[targets]) for row in played.rows if row[targets])
    words = (
        f"Played with {played.policy}, {len(played.rows)} episodes of {played.scenario.task.duration:.4g} s: "
        f"robots drove {played.distance_share:.0%} of the formation's distance, the fastest reached "
        f"{played.top_speed:.3g} m/s; {played.collisions} collisions; {found} of {appeared} targets were detected"
    )
    if found:
        words += f", the last after {played.detection_time:.3g} s"
    if not math.isnan(played.undetected_time):
        words += f"; no target can have stayed undetected for longer than {played.undetected_time:.3g} s"
    return f"{words}."


def _print_designs(console: Console, title: str, designs: Sequence[Candidate], reaches: _Reaches) -> list[str]:
    headers = ["N", "a", "b", "omega\n[rad/s]", "lap\n[s]", "T_max\n[s]", "speed needed\n[m/s]", "arc too\ntight"]
    ranks = dict.fromkeys(headers, 0) | dict.fromkeys(
        ["r below (6)\n[m]", "r_s above (7)\n[m]", "r_s from (8)\n[m]"], 1
    )
    ranks |= {"margin": 2} | (dict.fromkeys(_ROGUES, 0) if reaches else {})
    if designs[0].turning_radius is None:
        del ranks["arc too\ntight"]
    rows = []
    for each in designs:
        row = [str(number) for number in (each.num_robots, each.curve.a, each.curve.b)]
        row += [f"{each.phase_rate:.3g}", f"{each.lap_time:.4g}", f"{each.detection_time_bound:.3g}"]
        row.append(f"{each.slowest_speed:.2g} to {each.top_speed:.3g}")
        row += [] if each.tight_share is None else [f"{each.tight_share:.1%}"]
        row += [f"{each.robot_radius_bound:.3g}", f"{each.coverage_radius:.3g}", f"{each.detection_radius:.3g}"]
        row.append(f"{each.margin:.0%}")
        rows.append(row + _rogues(each, reaches))
    return _print_table(console, title, [Column(header, rank=rank) for header, rank in ranks.items()], rows)


def _rogues(each: Candidate, reaches: _Reaches) -> list[str]:
    """Return the cells of a table: undetected time of an evading target, and speed from which it can evade for ever."""
    if each not in reaches:
        return []
    time, speed = reaches[each].guaranteed_time, reaches[each].critical_speed
    return ["for ever" if time == math.inf else f"{time:.3g}", "none" if speed == math.inf else f"{speed:.3g}"]


def _print_failing(console: Console, title: str, designs: Sequence[Candidate], reaches: _Reaches) -> list[str]:
    columns = [*map(Column, ("N", "a", "b")), Column("T_max\n[s]", rank=1)]
    columns += [*map(Column, _ROGUES if reaches else ()), Column("why not", prose=True)]
    rows = []
    for each in designs:
        numbers = [str(number) for number in (each.num_robots, each.curve.a, each.curve.b)]
        rows.append([*numbers, f"{each.detection_time_bound:.3g}", *_rogues(each, reaches), each.reason])
    return _print_table(console, title, columns, rows)


def _print_table(console: Console, title: str, columns: list[Column], rows: list[list[str]]) -> list[str]:
    console.print(title, style="italic", markup=False, highlight=False, soft_wrap=True)
    left_out = print_table(console, columns, rows)
    console.print()
    return left_out


def _as_plain(each: Candidate) -> dict[str, Any]:
    """Return a design and its derived numbers as plain values."""
    followed = (
        "feasible", "avoids_collisions", "covers", "detects", "is_fast_enough", "can_follow", "margin", "lap_time",
        "slowest_speed", "mean_speed", "turning_radius", "smallest_curvature_radius", "tight_share", "reason",
        "overrides",
    )  # fmt: skip
    return dataclasses.asdict(each) | {name: getattr(each, name) for name in followed}
