"""Which curve, how many robots, which sensor: every design for a rectangle, checked against (6), (7) and (8)."""

import dataclasses
import math
from typing import Any

from rich.console import Console

from lissajous_env.console.terminal import AS_USUAL, Column, Speech, print_left_out, print_table
from lissajous_env.episodes.guarantee import Reach, reach_of
from lissajous_env.parameters import named
from lissajous_env.parameters.parts import Curve
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory import closed_forms, geometry
from lissajous_env.theory.candidate import Candidate
from lissajous_env.wording import shown

Reaches = dict[Candidate, Reach]
_ROGUES = ["rogue\nunseen [s]", "defeated\nfrom [m/s]"]
_MOST_ROBOTS = 200
_RANGE = 1e-6, 1e6
"""Lengths that a design can be made for [m]: from a thousandth of a millimetre to a thousand kilometres."""


def design(
    half_width: float,
    half_height: float,
    robot_radius: float,
    sensor_radius: float,
    num_robots: int | None = None,
    phase_rate: float = 0.3,
    wheelbase: float | None = None,
    steering_max: float = math.pi / 9,
) -> list[Candidate]:
    """List every design for a rectangle [-A, A] x [-B, B]: all N, a odd, b with a + b = N and gcd(a, b) = 1.

    Args:
        half_width: A [m].
        half_height: B [m].
        robot_radius: r_i, radius of a robot's body [m].
        sensor_radius: r_s, radius of a robot's sensing disc [m].
        num_robots: N; None tries 2 up to what the body or the sensor could need, 200 at most.
        phase_rate: omega, rate of the robots along the curve's parameter [rad/s].
        wheelbase: distance between a car's axles [m]; None for robots that turn on the spot.
        steering_max: largest steering angle of a car [rad].

    Returns:
        The feasible ones by T_max, then the largest margin; after them the others, those that fail by least first.

    Raises:
        ValueError: a value that a rule forbids.
    """
    _require_positive(half_width=half_width, half_height=half_height, robot_radius=robot_radius)
    _require_positive(sensor_radius=sensor_radius)
    _require_positive("rad/s", phase_rate=phase_rate)
    if wheelbase is not None:
        _require_positive(wheelbase=wheelbase)
    if not _is_number(steering_max) or not 0 < steering_max < math.pi / 2:
        raise ValueError(f"steering_max must be between 0 and pi / 2, both excluded [rad], got {shown(steering_max)}")
    if num_robots is not None and (not isinstance(num_robots, int) or not 2 <= num_robots <= 1024):
        raise ValueError(f"num_robots must be a whole number from 2 to 1024, got {shown(num_robots)}")

    turning_radius = None if wheelbase is None else geometry.turning_radius(wheelbase, steering_max)
    largest = _largest_num_robots(half_width, half_height, robot_radius, sensor_radius)
    candidates = []
    for n in range(2, largest + 1) if num_robots is None else [num_robots]:
        p = closed_forms.default_p(n)
        kappa = closed_forms.cluster_size(n, p)
        for a in range(1, n, 2):
            if math.gcd(a, n) > 1:
                continue
            curve = Curve(half_width, half_height, a, n - a)
            candidates.append(
                Candidate(
                    curve=curve,
                    num_robots=n,
                    phase_rate=phase_rate,
                    robot_radius=robot_radius,
                    sensor_radius=sensor_radius,
                    wheelbase=wheelbase,
                    steering_max=steering_max,
                    p=p,
                    alpha=closed_forms.default_alpha(curve, n, p),
                    clusters=kappa,
                    robot_radius_bound=closed_forms.robot_radius_bound(curve, n) if kappa == 1 else 0.0,
                    robot_radius_measured=geometry.measured_robot_radius(curve, n, kappa),
                    coverage_radius=closed_forms.coverage_radius(curve),
                    detection_radius=closed_forms.detection_radius(curve, n, kappa),
                    detection_time_bound=closed_forms.detection_time_bound(phase_rate, n, kappa),
                    top_speed=phase_rate * geometry.largest_speed(curve),
                    tight_share=None if turning_radius is None else geometry.tight_share(curve, turning_radius),
                )
            )
    return sorted(candidates, key=_rank)


def print_design(
    half_width: float = 1.8,
    half_height: float = 0.8,
    robot_radius: float = 0.125,
    sensor_radius: float = 1.3,
    num_robots: int | None = None,
    phase_rate: float = 0.3,
    wheelbase: float | None = None,
    steering_max: float = math.pi / 9,
    rogue_speed: float | None = None,
    rows: int = 10,
    output: Speech = AS_USUAL,
) -> None:
    """Say which curve and how many robots suit a rectangle, and why others do not.

    Args:
        half_width: A, half of the rectangle's width [m].
        half_height: B, half of the rectangle's height [m].
        robot_radius: radius of a robot's body [m].
        sensor_radius: radius of a robot's sensing disc [m].
        num_robots: number of robots; without it every number is tried.
        phase_rate: omega, rate of the robots along the curve's parameter [rad/s].
        wheelbase: distance between a car's axles [m]; without it robots turn on the spot.
        steering_max: largest steering angle of a car [rad].
        rogue_speed: top speed of the rogues [m/s]: designs are then shown with how long one that knows what the robots
            will do can stay unseen, and how fast one must be to do so for ever.
        rows: how many feasible, and how many infeasible, designs to show.
        output: How it speaks.
    """
    if rogue_speed is not None and not (_is_number(rogue_speed) and 0 <= rogue_speed <= 100):
        raise ValueError(f"rogue_speed must be from 0 to 100 [m/s], got {shown(rogue_speed)}")
    if not isinstance(rows, int) or rows < 1:
        raise ValueError(f"rows must be a whole number of at least 1, got {shown(rows)}")
    candidates = design(
        half_width, half_height, robot_radius, sensor_radius, num_robots, phase_rate, wheelbase, steering_max
    )
    feasible = [each for each in candidates if each.feasible]
    infeasible = [each for each in candidates if not each.feasible]
    console, words = output.console(), recommendation(candidates)
    shown_ones = feasible[:rows] + infeasible[:rows]
    reaches = {} if rogue_speed is None else {each: reach_of(_scenario(each), rogue_speed) for each in shown_ones}
    if candidates[0] in reaches:
        words += _in_words_of_rogues(reaches[candidates[0]], rogue_speed)
    area = f"{2 * half_width:g} m x {2 * half_height:g} m, bodies of {robot_radius:g} m, sensors of {sensor_radius:g} m"
    left_out: list[str] = []
    if feasible:
        left_out += _print_feasible(console, f"Designs for {area}: {len(feasible)} work", feasible[:rows], reaches)
    if infeasible:
        title = "Those that fail by least" if feasible else f"Designs for {area}: none meets all bounds"
        left_out += _print_infeasible(console, title, infeasible[:rows], reaches)
    print_left_out(console, left_out, "--json has them, and a wider terminal shows them.")
    console.print(words, soft_wrap=True, markup=False, highlight=False)
    designs = [_as_plain(each) | (reaches[each]._asdict() if each in reaches else {}) for each in shown_ones]
    output.give({"recommendation": words, "feasible": len(feasible), "designs": designs})


def recommendation(candidates: list[Candidate]) -> str:
    """Say which design to take and how to use it or, where none meets all bounds, what fails and what would help."""
    first = candidates[0]
    if first.feasible:
        fewest = min((each for each in candidates if each.feasible), key=lambda each: each.num_robots)
        words = f"Take {_in_words(first)}: every target is found T_max = {first.detection_time_bound:.2f} s"
        if fewest.num_robots < first.num_robots:
            words += f" (as few as {fewest.num_robots} robots work, in {fewest.detection_time_bound:.2f} s)"
        return f"{words}. {_call(first)}"
    # Each try costs some milliseconds, and designs that fail by much do not work by measure either.
    measured = next((each for each in candidates[:200] if each.works_measured), None)
    if measured is not None:
        return (
            f"No design meets all bounds ({_what_fails(candidates)}), but they are not tight: {_in_words(measured)} "
            f"works by what is measured, bodies below {measured.robot_radius_measured:.3f} m and sensors above "
            f"{max(measured.coverage_radius_measured, measured.detection_radius):.3f} m, as long as the formation is "
            f"undisturbed. {_call(measured)}"
        )
    return f"No design works: {_what_fails(candidates)}. {_what_would_help(candidates)}"


def _what_fails(candidates: list[Candidate]) -> str:
    rules = [
        ("(6), robots must not touch,", [each.avoids_collisions for each in candidates]),
        ("(7), a lap must leave no gap,", [each.covers for each in candidates]),
        ("(8), sensing discs must overlap,", [each.detects for each in candidates]),
    ]
    for_all = [name for name, holds in rules if not any(holds)]
    if for_all:
        return f"{' and '.join(for_all)} fail{'s' if len(for_all) == 1 else ''} for every one"
    return "each of (6), (7) and (8) can be met, but not all by one design"


def _what_would_help(candidates: list[Candidate]) -> str:
    """Name the sensor that these bodies need, and the robots that these sensors need."""
    any_one = candidates[0]
    curve, sensor = any_one.curve, any_one.sensor_radius
    clear = [each for each in candidates if each.avoids_collisions]
    if clear:
        best = min(clear, key=lambda each: max(each.coverage_radius, each.detection_radius))
        needed = max(best.coverage_radius, best.detection_radius)
        words = f"With these bodies sensors must reach above {needed:.4g} m ({_in_words(best)})"
    else:
        best = max(candidates, key=lambda each: each.robot_radius_bound)
        words = f"Bodies must be below {best.robot_radius_bound:.4g} m for any ({_in_words(best)})"
        if best.clusters > 1:
            words = f"{best.num_robots} robots always share places, another number of robots does not"
    robots, a, b = closed_forms.fewest_robots(curve.half_width, curve.half_height, sensor)
    body = closed_forms.robot_radius_limit(curve.half_width, curve.half_height, robots)
    return (
        f"{words}; with these sensors it takes at least {robots} robots (a of {a}, b of {b} or more by (7)), "
        f"whose bodies must be below {body:.4g} m."
    )


def _largest_num_robots(half_width: float, half_height: float, robot_radius: float, sensor_radius: float) -> int:
    """Most robots worth a try: those that bodies leave room for, or those that sensors need."""
    needed = closed_forms.fewest_robots(half_width, half_height, sensor_radius)[0]
    roomy = (
        n
        for n in range(_MOST_ROBOTS, 2, -1)
        if closed_forms.robot_radius_limit(half_width, half_height, n) > robot_radius
    )
    return min(max(needed, next(roomy, 2)), _MOST_ROBOTS)


def _rank(each: Candidate) -> tuple:
    return (0, each.detection_time_bound, -each.margin) if each.feasible else (1, -each.margin, each.num_robots)


def _in_words(each: Candidate) -> str:
    return f"{each.num_robots} robots on a = {each.curve.a}, b = {each.curve.b}"


def _call(each: Candidate) -> str:
    return f"To use it: lissajous_env.scenario('experiment', **{each.overrides})"


def _scenario(each: Candidate) -> Scenario:
    return named.scenario("experiment", **each.overrides)


def _in_words_of_rogues(reach: Reach, speed: float | None) -> str:
    limit = f"{reach.critical_speed:.3g} m/s"
    if reach.guaranteed_time == math.inf:
        return f" A rogue of {speed:g} m/s can stay unseen for ever, one slower than {limit} cannot."
    words = f" A rogue of {speed:g} m/s stays unseen for {reach.guaranteed_time:.1f} s at most, whatever it does"
    return f"{words}, one from {limit} on for ever." if reach.critical_speed < math.inf else f"{words}."


def _rogues(each: Candidate, reaches: Reaches) -> list[str]:
    """Cells of a table: how long a rogue stays unseen, and from which speed on for ever."""
    if each not in reaches:
        return []
    time, speed = reaches[each].guaranteed_time, reaches[each].critical_speed
    return ["for ever" if time == math.inf else f"{time:.1f}", "none" if speed == math.inf else f"{speed:.3g}"]


def _print_feasible(console: Console, title: str, candidates: list[Candidate], reaches: Reaches) -> list[str]:
    headers = ["N", "a", "b", "p", "alpha", "T_max\n[s]", "r below (6)\n[m]", "r_s above (7)\n[m]", "r_s from (8)\n[m]"]
    headers += ["margin", "top speed\n[m/s]"]
    if candidates[0].tight_share is not None:
        headers.append("arc too\ntight")
    headers += _ROGUES if reaches else []
    rows = []
    for each in candidates:
        row = [str(number) for number in (each.num_robots, each.curve.a, each.curve.b, each.p, each.alpha)]
        row += [f"{each.detection_time_bound:.2f}", f"{each.robot_radius_bound:.4g}"]
        row += [f"{each.coverage_radius:.4g}", f"{each.detection_radius:.4g}"]
        row += [f"{each.margin:.0%}", f"{each.top_speed:.2f}"]
        if each.tight_share is not None:
            row.append(f"{each.tight_share:.1%}")
        row += _rogues(each, reaches)
        rows.append(row)
    return _print_designs(console, title, [Column(header) for header in headers], rows)


def _print_infeasible(console: Console, title: str, candidates: list[Candidate], reaches: Reaches) -> list[str]:
    columns = [*map(Column, ("N", "a", "b")), Column("T_max\n[s]", rank=1)]
    columns += [*map(Column, _ROGUES if reaches else []), Column("why not", prose=True)]
    rows = []
    for each in candidates:
        numbers = [str(number) for number in (each.num_robots, each.curve.a, each.curve.b)]
        rows.append([*numbers, f"{each.detection_time_bound:.2f}", *_rogues(each, reaches), each.reason])
    return _print_designs(console, title, columns, rows)


def _print_designs(console: Console, title: str, columns: list[Column], rows: list[list[str]]) -> list[str]:
    console.print(title, style="italic", markup=False, highlight=False, soft_wrap=True)
    left_out = print_table(console, columns, rows)
    console.print()
    return left_out


def _as_plain(each: Candidate) -> dict[str, Any]:
    """What a design is, and what follows from it, as plain values."""
    followed = ("feasible", "avoids_collisions", "covers", "detects", "margin", "reason", "overrides")
    return dataclasses.asdict(each) | {name: getattr(each, name) for name in followed}


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _require_positive(unit: str = "m", **values: float) -> None:
    for name, value in values.items():
        if not _is_number(value) or value <= 0:
            raise ValueError(f"{name} must be positive [{unit}], got {shown(value)}")
        if not _RANGE[0] <= value <= _RANGE[1]:
            raise ValueError(f"{name} must be from {_RANGE[0]:g} to {_RANGE[1]:g} [{unit}], got {shown(value)}")
