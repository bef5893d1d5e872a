"""What a robot observes: itself, what its ring neighbours sent, what its sensor sees.

One row of float32 per robot: `OWN_ENTRIES`, then `NEIGHBOUR_ENTRIES` for each of its two neighbours on the ring,
`ROBOT_ENTRIES` for each of the `sensing.robots_seen` nearest robots in its sensing disc, `TARGET_ENTRIES` for each of
the `sensing.targets_seen` nearest targets, and what the extensions of the scenario bring, in the order of these.
`layout` has index, name, range and meaning of each; `print(layout(scenario))` shows them.

A target that leaves when it is detected is seen in the step of its detection. A stuck robot senses nothing, but hears;
of a removed robot, entries 0 to 6 keep what they were. Directions are those of the rectangle, not of the robot.
"""

from typing import NamedTuple

import numpy as np
import warp as wp

from lissajous_env.device.bits import lowest
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.part_structs import SensingStruct
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters import named
from lissajous_env.parameters.extensions import ObservationEntry
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.robots.sight import planar
from lissajous_env.world.state import REMOVED, WORKING, Clock, Latest, Links, Robots, Targets

wp.set_module_options(OPTIONS)

_FAR = wp.constant(4.0)


OWN_ENTRIES = (
    ("x", -4, 4, "measured x [half_width]"),
    ("y", -4, 4, "measured y [half_height]"),
    ("cos_heading", -1, 1, "cosine of the measured heading"),
    ("sin_heading", -1, 1, "sine of the measured heading"),
    ("speed", -4, 4, "measured speed [top speed of a car; of a point in the equilibrium]"),
    ("cos_phase", -1, 1, "cosine of the measured phase theta"),
    ("sin_phase", -1, 1, "sine of the measured phase theta"),
    ("works", 0, 1, "1 working, 0 stuck or removed"),
)
NEIGHBOUR_ENTRIES = (
    ("heard", 0, 1, "1 once a message came; neighbour 0 is before, 1 after on the ring"),
    ("age", 0, 1, "time since its last message was sent, at most 1 [0.3 rad / omega]"),
    ("cos_phase", -1, 1, "cosine of its phase less one's own"),
    ("sin_phase", -1, 1, "sine of its phase less one's own"),
    ("x", -4, 4, "its x less one's own [2 half_width]"),
    ("y", -4, 4, "its y less one's own [2 half_height]"),
)
ROBOT_ENTRIES = (
    ("present", 0, 1, "1 where there is one: robots in the sensing disc, the nearest first"),
    ("x", -1, 1, "its x less one's own [sensing radius]"),
    ("y", -1, 1, "its y less one's own [sensing radius]"),
    ("x_velocity", -1, 1, "its velocity along x less one's own [2 top speeds]"),
    ("y_velocity", -1, 1, "its velocity along y less one's own [2 top speeds]"),
)
TARGET_ENTRIES = (
    ("present", 0, 1, "1 where there is one: targets in the sensing disc, the nearest first"),
    ("x", -1, 1, "its x less one's own [sensing radius]"),
    ("y", -1, 1, "its y less one's own [sensing radius]"),
)
"""Name, range and meaning, with its unit in brackets, of the entries of each part of a row."""


OWN = wp.constant(len(OWN_ENTRIES))
LINK = wp.constant(len(NEIGHBOUR_ENTRIES))
ROBOT = wp.constant(len(ROBOT_ENTRIES))
TARGET = wp.constant(len(TARGET_ENTRIES))


class Layout(NamedTuple):
    """Names, ranges and meanings of the entries of an observation row."""

    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    meanings: tuple[str, ...]

    @property
    def size(self) -> int:
        """D, entries in a row."""
        return len(self.names)

    def __str__(self) -> str:
        width = max(map(len, self.names))
        rows = enumerate(zip(self.names, self.low, self.high, self.meanings, strict=True))
        return "\n".join(
            f"{k:3}  {name:{width}}  {f'[{low:g}, {high:g}]':7}  {what}" for k, (name, low, high, what) in rows
        )


def layout(scenario: str | Scenario) -> Layout:
    """Lay out the observation of one robot of a scenario."""
    scenario = named.scenario(scenario)
    parts = [("", OWN_ENTRIES), *((f"neighbour_{k}_", NEIGHBOUR_ENTRIES) for k in range(2))]
    parts += [(f"robot_{k}_", ROBOT_ENTRIES) for k in range(scenario.sensing.robots_seen)]
    parts += [(f"target_{k}_", TARGET_ENTRIES) for k in range(scenario.sensing.targets_seen)]
    entries: list[tuple[str, float, float, str]] = [
        (prefix + name, low, high, meaning) for prefix, part in parts for name, low, high, meaning in part
    ]
    for each in scenario.extensions:
        if isinstance(each, ObservationEntry):
            entries += [(name, each.low, each.high, each.about) for name in each.entries]
    names, low, high, meanings = zip(*entries, strict=True)
    return Layout(names, np.array(low, dtype=np.float32), np.array(high, dtype=np.float32), meanings)


@wp.func
def clear(w: int, i: int, start: int, stop: int, observation_out: wp.array3d(dtype=float)):
    """Zero a range of a row."""
    for k in range(start, stop):
        observation_out[w, i, k] = 0.0


@wp.func
def empty(w: int, i: int, start: int, width: int, listed: int, room: int, observation_out: wp.array3d(dtype=float)):
    """Zero the entries of a list after the first `listed`, up to the first that is zero."""
    for place in range(listed, room):
        entry = start + place * width
        if observation_out[w, i, entry] == 0.0:
            break
        clear(w, i, entry, entry + width, observation_out)


@wp.func
def insert(
    w: int,
    i: int,
    start: int,
    width: int,
    listed: int,
    room: int,
    offset: wp.vec2,
    observation_out: wp.array3d(dtype=float),
) -> int:
    """Enter `offset` into a list of at most `room` entries, `listed` so far, sorted by distance.

    Returns its place, or `room` where that many are nearer.
    """
    place = int(listed)
    square = wp.dot(offset, offset)
    while place > 0:
        before = start + (place - 1) * width
        x = observation_out[w, i, before + 1]
        y = observation_out[w, i, before + 2]
        if x * x + y * y <= square:
            break
        if place < room:
            for k in range(width):
                observation_out[w, i, before + width + k] = observation_out[w, i, before + k]
        place -= 1
    if place < room:
        entry = start + place * width
        observation_out[w, i, entry] = 1.0
        observation_out[w, i, entry + 1] = offset[0]
        observation_out[w, i, entry + 2] = offset[1]
    return place


@wp.func
def velocity(w: int, i: int, robots: Robots) -> wp.vec2:
    """Velocity of a robot [m/s]."""
    return robots.speed[w, i] * cos_sin(robots.heading[w, i])


@wp.func
def far(value: float) -> float:
    """Clip a scaled coordinate to the range of the observation."""
    return wp.clamp(value, -_FAR, _FAR)


@wp.func
def observe_self(
    w: int, i: int, curve: CurveStruct, speed_unit: float, robots: Robots, observation_out: wp.array3d(dtype=float)
):
    """Fill entries 0 to 7."""
    own = robots.measured[w, i]
    turn = robots.measured_turn[w, i]
    observation_out[w, i, 0] = far(own[0] / curve.half_width)
    observation_out[w, i, 1] = far(own[1] / curve.half_height)
    observation_out[w, i, 2] = turn[2]
    observation_out[w, i, 3] = turn[3]
    observation_out[w, i, 4] = far(own[3] / speed_unit)
    observation_out[w, i, 5] = turn[0]
    observation_out[w, i, 6] = turn[1]
    observation_out[w, i, 7] = wp.where(robots.status[w, i] == WORKING, 1.0, 0.0)


@wp.func
def observe_ring(
    w: int,
    i: int,
    now: int,
    curve: CurveStruct,
    age_per_step: float,
    robots: Robots,
    links: Links,
    observation_out: wp.array3d(dtype=float),
):
    """Fill entries 8 to 19."""
    own = robots.measured[w, i]
    turn = robots.measured_turn[w, i]
    for side in range(2):
        start = OWN + LINK * side
        heard_at = links.heard_at[w, i, side]
        if heard_at < 0 or robots.status[w, i] == REMOVED:
            clear(w, i, start, start + LINK, observation_out)
        else:
            message = links.heard[w, i, side]
            observation_out[w, i, start] = 1.0
            observation_out[w, i, start + 1] = wp.min(float(now - heard_at) * age_per_step, 1.0)
            observation_out[w, i, start + 2] = wp.clamp(message[0] * turn[0] + message[1] * turn[1], -1.0, 1.0)
            observation_out[w, i, start + 3] = wp.clamp(message[1] * turn[0] - message[0] * turn[1], -1.0, 1.0)
            observation_out[w, i, start + 4] = far(0.5 * (message[2] - own[0]) / curve.half_width)
            observation_out[w, i, start + 5] = far(0.5 * (message[3] - own[1]) / curve.half_height)


@wp.func
def observe_robots(
    w: int, i: int, sensing: SensingStruct, speed_unit: float, robots: Robots, observation_out: wp.array3d(dtype=float)
):
    """List the nearest robots in the disc."""
    start = OWN + 2 * LINK
    room = sensing.robots_seen
    listed = int(0)
    if room > 0 and robots.status[w, i] == WORKING:
        here = planar(robots.position[w, i])
        for j in range(robots.status.shape[1]):
            away = planar(robots.position[w, j]) - here
            if wp.dot(away, away) < sensing.radius * sensing.radius and j != i and robots.status[w, j] != REMOVED:
                place = insert(w, i, start, ROBOT, listed, room, away / sensing.radius, observation_out)
                if place < room:
                    relative = (velocity(w, j, robots) - velocity(w, i, robots)) / (2.0 * speed_unit)
                    observation_out[w, i, start + place * ROBOT + 3] = wp.clamp(relative[0], -1.0, 1.0)
                    observation_out[w, i, start + place * ROBOT + 4] = wp.clamp(relative[1], -1.0, 1.0)
                    listed = wp.min(listed + 1, room)
    empty(w, i, start, ROBOT, listed, room, observation_out)


_IN_DISC = """
    const int together = 32, left = in_sight.shape[1] - first;
    const wp::vec2* positions = &wp::index(position, w, first);
    const int* seen = &wp::index(in_sight, w, first);
    const float square = radius * radius;
    unsigned int near = 0;
    for (int k = 0; k < (left < together ? left : together); ++k) {
        const float x = positions[k][0] - place[0], y = positions[k][1] - place[1];
        near |= (unsigned int)(seen[k] == 1 & x * x + y * y < square) << k;
    }
    return near;
"""


@wp.func_native(_IN_DISC)
def in_disc(
    w: int,
    first: int,
    place: wp.vec2,
    radius: float,
    position: wp.array2d(dtype=wp.vec2),
    in_sight: wp.array2d(dtype=wp.int32),
) -> wp.uint32:
    """Bits of the targets, of the 32 from the first, that are in sight and in the disc at a place [m]."""
    ...


@wp.func
def observe_targets(
    w: int,
    i: int,
    sensing: SensingStruct,
    robots: Robots,
    targets: Targets,
    latest: Latest,
    observation_out: wp.array3d(dtype=float),
):
    """List the nearest targets in the disc."""
    start = OWN + 2 * LINK + ROBOT * sensing.robots_seen
    room = sensing.targets_seen
    listed = int(0)
    if room > 0 and latest.in_sight[w] > 0:
        here = robots.sensor[w, i]
        for first in range(0, targets.in_sight.shape[1], 32):
            near = in_disc(w, first, here, sensing.radius, targets.position, targets.in_sight)
            while near != wp.uint32(0):
                away = targets.position[w, first + lowest(near)] - here
                near &= near - wp.uint32(1)
                place = insert(w, i, start, TARGET, listed, room, away / sensing.radius, observation_out)
                listed = wp.where(place < room, wp.min(listed + 1, room), listed)
    empty(w, i, start, TARGET, listed, room, observation_out)


@wp.kernel
def keep_final(
    first: int,
    lanes: int,
    clock: Clock,
    observation: wp.array3d(dtype=float),
    final_observation_out: wp.array3d(dtype=float),
):
    """Keep the rows with which the episode before ended."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for i in range(lane, observation.shape[1], lanes):
        for k in range(observation.shape[2]):
            final_observation_out[w, i, k] = observation[w, i, k]


@wp.kernel
def observe(
    first: int,
    lanes: int,
    begin: int,
    end: int,
    curve: CurveStruct,
    sensing: SensingStruct,
    age_per_step: float,
    speed_unit: float,
    clock: Clock,
    robots: Robots,
    links: Links,
    targets: Targets,
    latest: Latest,
    observation_out: wp.array3d(dtype=float),
):
    """Fill the row of each robot."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for i in range(begin + lane, end, lanes):
        observe_self(w, i, curve, speed_unit, robots, observation_out)
        observe_ring(w, i, clock.step[w], curve, age_per_step, robots, links, observation_out)
        observe_robots(w, i, sensing, speed_unit, robots, observation_out)
        observe_targets(w, i, sensing, robots, targets, latest, observation_out)
