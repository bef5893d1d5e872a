"""Closing up of a line: each robot moves its lane where a robot of the line has stopped or been removed.

A robot receives the messages of its two neighbours in the line. It counts a neighbour as missing that is silent, or
that sends the same place again and again. The others notice that a neighbour has moved to another lane, and move too:
the line closes up from robot to robot, and opens again when the missing one drives on. One missing robot at a time is
allowed for.
"""

from typing import Any

import warp as wp

from baselines.policies.failures import AGE, STATE, STILL, note_message
from baselines.policies.line_path import LinePlan, largest_spacing
from baselines.policies.own_row import hears, message_age, offset_heard, own_heading, own_position, own_works
from baselines.policies.timed_paths import STEPS
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.parameters.scenario import Scenario

wp.set_module_options(OPTIONS)

_MISSING = STATE
"""Entry of the memory of a ring neighbour: number of robots that are missing on its side of the line."""
_STANDS = wp.constant(3.0)
"""Messages from the same place after which a neighbour counts as missing."""


@wp.struct
class Closing:
    """Constants of closing up: lengths [m], times [s], steps."""

    cars: int
    half_span: float
    """Half of the span of a line, with R of turns inside."""
    room: float
    """Largest distance of a lane from the middle."""
    aside: float
    """Distance of a car from its lane in a sweep: R of turns inside."""
    half_length: float
    upright: int
    speed: float
    step: float
    unit: float
    clear: float
    lead_in: int


def closing_of(scenario: Scenario, plan: LinePlan, lead_in: int) -> Any:
    """Return the constants of closing up."""
    closing = Closing()
    closing.cars, closing.half_span, closing.half_length = (
        len(plan.lanes),
        plan.half_span + plan.aside,
        plan.half_length,
    )
    closing.room = min(scenario.driven.half_width, scenario.driven.half_height) - plan.aside
    closing.aside = plan.aside
    closing.upright = int(scenario.curve.half_height > scenario.curve.half_width)
    closing.speed, closing.step, closing.unit = plan.speed, plan.step, scenario.time_unit
    closing.clear, closing.lead_in = 3 * scenario.robot.radius + plan.aside, lead_in
    return closing


def closes_up(scenario: Scenario, plan: LinePlan) -> bool:
    """Return whether one robot less can still span the rectangle at the speed of the line; one of several lines cannot.

    Several lines are interleaved: the lanes between those of a line belong to other lines.
    """
    cars = scenario.num_robots
    spacing = largest_spacing(plan.speed, scenario.sensing_radius, scenario.rogue_speed, plan.step)
    return plan.line_of.max() == 0 and cars > 3 and (cars - 1) * spacing >= 2 * (plan.half_span + plan.aside)


@wp.func
def lane_of(slot: int, above: float, below: float, closing: Closing) -> float:
    """Place across of a robot of the line [m], where some robots are missing above and below it."""
    cars = float(closing.cars) - above - below
    half = wp.min(closing.half_span, closing.room * cars / wp.max(cars - 1.0, 1.0))
    return half * (2.0 * (float(slot) - below + 0.5) / cars - 1.0)


@wp.func
def across(place: wp.vec2, closing: Closing) -> float:
    """Coordinate across the sweep [m]."""
    return wp.where(closing.upright == 1, -place[0], place[1])


@wp.func
def beside_lane(heading: float, closing: Closing) -> float:
    """Coordinate across of a car that sweeps, less that of its lane [m]."""
    ahead = wp.where(closing.upright == 1, wp.sin(heading), wp.cos(heading))
    return closing.aside * wp.sign(ahead)


@wp.func
def sweeps(place: wp.vec2, heading: float, closing: Closing) -> bool:
    """Return whether a robot drives straight along, away from the turns."""
    along = wp.where(closing.upright == 1, place[1], place[0])
    sideways = wp.where(closing.upright == 1, wp.cos(heading), wp.sin(heading))
    return wp.abs(along) < 0.9 * closing.half_length and wp.abs(sideways) < 0.2


@wp.func
def is_missing(known: wp.array(dtype=float), is_heard: bool, place: wp.vec2, age: float, closing: Closing) -> bool:
    """Return whether a neighbour is missing, and store its message."""
    if is_heard:
        note_message(known, place, age, 0.2 * closing.speed * closing.step, closing.step)
    known[AGE] = age
    return not is_heard or known[STILL] >= _STANDS


@wp.kernel
def close_up(
    curve: CurveStruct,
    closing: Closing,
    slots: wp.array(dtype=int),
    memory: wp.array3d(dtype=float),
    observation: wp.array3d(dtype=float),
    remembered: wp.array4d(dtype=float),
    shift: wp.array2d(dtype=wp.vec2),
):
    """Move the lane of each robot to where the robots that are left span the rectangle evenly."""
    w, i = wp.tid()
    if memory[w, i, STEPS] < float(closing.lead_in) or not own_works(w, i, observation):
        return
    slot = slots[i]
    place = own_position(w, i, curve, observation)
    straight = sweeps(place, own_heading(w, i, observation), closing)
    low = -closing.half_span
    high = closing.half_span
    for side in range(2):
        known = remembered[w, i, side]
        beside = slot + 2 * side - 1
        if beside >= 0 and beside < closing.cars:
            is_heard = hears(w, i, side, observation)
            theirs = place + offset_heard(w, i, side, curve, observation)
            missing = is_missing(known, is_heard, theirs, message_age(w, i, side, closing.unit, observation), closing)
            if missing:
                known[_MISSING] = 1.0
                if is_heard and side == 0:
                    low = across(theirs, closing) + closing.clear
                elif is_heard:
                    high = across(theirs, closing) - closing.clear
            elif remembered[w, i, 1 - side][_MISSING] == 1.0:
                known[_MISSING] = 0.0  # the neighbour moves because of that
            elif straight:
                full = lane_of(beside, 0.0, 0.0, closing)
                fewer = lane_of(beside, float(side), 1.0 - float(side), closing)
                lane = across(theirs, closing) - beside_lane(own_heading(w, i, observation), closing)
                known[_MISSING] = wp.where((lane - full) / (fewer - full) > 0.4, 1.0, 0.0)
    lane = lane_of(slot, remembered[w, i, 1][_MISSING], remembered[w, i, 0][_MISSING], closing)
    lane = wp.clamp(lane, low, wp.max(low, high))
    if not straight:
        return
    most = 0.2 * closing.speed * closing.step
    change = wp.clamp(lane - lane_of(slot, 0.0, 0.0, closing) - across(shift[w, i], closing), -most, most)
    moved = wp.where(closing.upright == 1, wp.vec2(-change, 0.0), wp.vec2(0.0, change))
    shift[w, i] = shift[w, i] + moved
