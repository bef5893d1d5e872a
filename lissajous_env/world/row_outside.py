"""The observation row of one robot outside the simulation, by the functions that fill the rows of a simulation."""

import math
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.program import Program, Stage
from lissajous_env.device.stage import ROBOT as ROBOTS
from lissajous_env.device.stage import part, stage
from lissajous_env.device.structs import NoiseStruct, allocate
from lissajous_env.parameters.extensions import ObservationEntry
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.observation import LINK, OWN, ROBOT, TARGET, layout
from lissajous_env.world.observing import (
    clear,
    empty,
    keep_nearest,
    observe_self,
    put_message,
    put_robot,
    put_target,
)
from lissajous_env.world.robots.bins import Bins
from lissajous_env.world.robots.placing import follow_curve
from lissajous_env.world.robots.signals import measure
from lissajous_env.world.state import STUCK, WORKING, Clock, Robots
from lissajous_env.world.values import constants_of

wp.set_module_options(OPTIONS)

MOST_SEEN = 256
"""Largest number of robots, and of targets, that are accepted from a sensor; farther ones are dropped."""


@wp.struct
class Outside:
    """Input of one robot besides its own pose."""

    message: wp.array(dtype=wp.vec4)
    """(2,) last message of each ring neighbour: cosine and sine of its phase, x, y [m]."""
    age: wp.array(dtype=wp.float32)
    """(2,) time since it was sent [step]; -1 for none yet."""
    numbers: wp.array2d(dtype=wp.float32)
    """(2, k) numbers of its policy in it."""
    seen: wp.array2d(dtype=wp.vec4)
    """(2, MOST_SEEN) relative x, y [m] and relative velocity [m/s] of the robots, and of the targets, that the sensor
    detects; of targets, the velocity is not used."""
    count: wp.array(dtype=wp.int32)
    """(2,) number of these robots, and targets."""
    phase: wp.array(dtype=wp.vec3)
    """(1,) cosine and sine of the measured phase, and 1 where it is given."""


@part
def list_seen(
    w,
    i,
    kind: int,
    start: int,
    width: int,
    room: int,
    sensing,
    speed_unit,
    robots,
    bins,
    outside: Outside,
    observation_out,
):
    """List the nearest robots, kind 0, or targets, kind 1, that are in the disc."""
    kept = int(0)
    works = robots.status[w, i] == WORKING
    for k in range(wp.where(room > 0 and works, outside.count[kind], 0)):
        away = wp.vec2(outside.seen[kind, k][0], outside.seen[kind, k][1])
        if wp.dot(away, away) < sensing.sight * sensing.sight:
            kept = keep_nearest(w, i, kept, room, away / sensing.sight, k, bins)
    for k in range(kept):
        seen = outside.seen[kind, int(bins.nearest[w, i, k][1])]
        offset = wp.vec2(seen[0], seen[1]) / sensing.sight
        if kind == 0:
            relative = wp.vec2(seen[2], seen[3]) / (2.0 * speed_unit)
            put_robot(w, i, start + k * width, offset, relative, observation_out)
        else:
            put_target(w, i, start + k * width, offset, observation_out)
    empty(w, i, start + kept * width, width, room - kept, observation_out)


@stage(ROBOTS, writes="bins: nearest; observation_out; robots: measured_turn")
def fill_row(
    w,
    i,
    curve,
    sensing,
    age_per_step,
    speed_unit,
    message_start,
    clock,
    robots,
    bins,
    outside: Outside,
    observation_out,
):
    """Fill the row of a robot as `lissajous_env.world.observing` does."""
    given = outside.phase[0]
    if given[2] > 0.0:
        faces = robots.measured_turn[w, i]
        robots.measured_turn[w, i] = wp.vec4(given[0], given[1], faces[2], faces[3])
    observe_self(w, i, curve, speed_unit, robots, observation_out)
    for side in range(2):
        entry = OWN + LINK * side
        clear(w, i, entry, entry + LINK, observation_out)
        if outside.age[side] >= 0.0:
            own = robots.measured[w, i]
            turn = robots.measured_turn[w, i]
            age = outside.age[side] * age_per_step
            put_message(w, i, entry, age, outside.message[side], own, turn, curve, observation_out)
        for m in range(outside.numbers.shape[1]):
            observation_out[w, i, message_start + side * outside.numbers.shape[1] + m] = outside.numbers[side, m]
    seen, sighted = sensing.robots_seen, sensing.targets_seen
    entry = OWN + 2 * LINK
    list_seen(w, i, 0, entry, ROBOT, seen, sensing, speed_unit, robots, bins, outside, observation_out)
    entry += ROBOT * seen
    list_seen(w, i, 1, entry, TARGET, sighted, sensing, speed_unit, robots, bins, outside, observation_out)


class RowOutside:
    """The observation row of one robot of a scenario, built of what is written into the host arrays.

    Raises:
        ValueError: the scenario has observation entries of an extension, which are computed of a whole world.
    """

    def __init__(self, scenario: Scenario):
        names = [name for entry in scenario.extensions if isinstance(entry, ObservationEntry) for name in entry.entries]
        if names:
            rule = "must have no observation entries of extensions, which require a simulation"
            raise ValueError(f"scenario of a robot outside the simulation {rule}, got {', '.join(names)}")
        if scenario.sensing.has_tracks:
            rule = "must be 0 for a robot outside the simulation"
            raise ValueError(f"sensing.tracks_seen and sensing.teammates_seen {rule}, got a scenario with tracks")
        if scenario.task.action != "control":
            raise ValueError(
                f"task.action must be control for a robot outside the simulation, got {scenario.task.action}"
            )
        constants = constants_of(scenario, as_device("cpu"))
        size, seen = scenario.messages.size, max(scenario.sensing.robots_seen, scenario.sensing.targets_seen)
        robots: Any = allocate(Robots, {"track": (1, 1, 1)}, (1, 1), "cpu")
        clock = allocate(Clock, {}, (1,), "cpu")
        clock.active.fill_(1)
        shapes = {"numbers": (2, size), "seen": (2, MOST_SEEN), "phase": (1,)}
        outside: Any = allocate(Outside, shapes, (2,), "cpu")
        bins = Bins()
        bins.nearest = wp.zeros((1, 1, seen), dtype=wp.vec2, device="cpu")
        row = wp.zeros((1, 1, layout(scenario).size), dtype=wp.float32, device="cpu")
        values = constants | {"noise": NoiseStruct(), "robots": robots, "clock": clock, "bins": bins}
        values |= {"outside": outside, "observation_out": row}
        follow = Stage("phase", follow_curve)
        rest = [Stage("measurement", measure), Stage("observation", fill_row)]
        with compile_quietly():
            self._follow = Program([follow, *rest], values, {ROBOTS: 1}, 1, robots.status.device)
            self._fill = Program(rest, values, {ROBOTS: 1}, 1, robots.status.device)
        self._kept = robots, outside, row
        self._position = robots.position.numpy()[0, 0]
        self._heading, self._speed = robots.heading.numpy()[0], robots.speed.numpy()[0]
        self._phase, self._status = robots.phase.numpy()[0], robots.status.numpy()[0]
        self._measured, self._turn = robots.measured.numpy()[0, 0], robots.measured_turn.numpy()[0, 0]
        self.message, self.age, self.numbers = outside.message.numpy(), outside.age.numpy(), outside.numbers.numpy()
        self._seen, self._count = outside.seen.numpy(), outside.count.numpy()
        self._given = outside.phase.numpy()[0]
        self.age[:] = -1
        self.row = row.numpy()[0, 0]

    @property
    def phase(self) -> float:
        """Phase theta in [0, 2 pi) [rad]."""
        return float(self._phase[0])

    @phase.setter
    def phase(self, phase: float) -> None:
        self._phase[0] = phase % (2 * math.pi)

    def see(self, robots: np.ndarray, targets: np.ndarray) -> None:
        """Store the objects that the sensor detects: robots (K, 4) and targets (K, 2), as in `Outside`."""
        for kind, seen in enumerate((robots, targets)):
            if len(seen) > MOST_SEEN:
                seen = seen[np.argsort(np.hypot(seen[:, 0], seen[:, 1]), kind="stable")[:MOST_SEEN]]
            self._seen[kind, : len(seen), : seen.shape[1]] = seen
            self._count[kind] = len(seen)

    def fill(
        self,
        x: float,
        y: float,
        heading: float,
        speed: float,
        works: bool,
        phase: tuple[float, float] | None,
        follows: bool = True,
    ) -> np.ndarray:
        """Fill the row, and return it: the same array each time.

        Args:
            x: Measured x [m].
            y: Measured y [m].
            heading: Measured heading [rad].
            speed: Measured speed [m/s].
            works: False for a robot that has failed.
            phase: Cosine and sine of the measured phase; None lets the phase of the call before follow the curve to
                this place.
            follows: False for a place to which the phase has followed already.
        """
        self._position[:2] = x, y
        self._heading[0], self._speed[0], self._status[0] = heading, speed, WORKING if works else STUCK
        if phase is None:
            self._given[:] = 0
            (self._follow if follows else self._fill)()
        else:
            self._given[:] = *phase, 1
            self.phase = math.atan2(phase[1], phase[0])
            self._fill()
        return self.row

    @property
    def sent(self) -> tuple[float, float, float, float]:
        """Cosine and sine of the phase, and x, y [m], as the robot sends them to its ring neighbours."""
        turn, measured = self._turn, self._measured
        return float(turn[0]), float(turn[1]), float(measured[0]), float(measured[1])
