"""Layout of the observation: the robot itself, its ring neighbours, and the objects in sight or known by messages.

One row of float32 per robot: `OWN_ENTRIES`, then `NEIGHBOUR_ENTRIES` for each of its two neighbours on the ring,
`ROBOT_ENTRIES` for each of the `sensing.robots_seen` nearest robots within `sensing.sight`, `TARGET_ENTRIES` for each
of the `sensing.targets_seen` nearest targets there, `message_entries` for the messages that the policies of its two
neighbours send, `TRACK_ENTRIES` for each of the `sensing.tracks_seen` nearest tracks, `TEAMMATE_ENTRIES` for each of
the `sensing.teammates_seen` nearest teammates that it knows, `CELL_ENTRIES` for each of the `sensing.cells_seen` cells
of the rectangle, and the entries of the scenario's extensions, in their order. `layout` returns name, range and meaning
of each entry; `print(layout(scenario))` shows them with their indices.

A target that leaves when it is detected is listed in the step of its detection. A robot that has failed senses nothing
but still receives messages; entries 0 to 6 of a removed robot are frozen, and all others but those of extensions are
zeros. Directions are in the world frame.

A policy's message is the last `messages.size` components of an action. The neighbours observe it in the row that this
step returns or, with a delay, in a later one. It is delayed and lost together with the phase message; the last message
received remains in the row. It is zeros before the first action, and before a neighbour is heard. A failed robot, which
does not act, repeats its last message; a removed robot is silent.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import warp as wp

from lissajous_env.parameters import named
from lissajous_env.parameters.extensions import ObservationEntry
from lissajous_env.parameters.scenario import Scenario

OWN_ENTRIES = (
    ("x", -4, 4, "measured x [half_width]"),
    ("y", -4, 4, "measured y [half_height]"),
    ("cos_heading", -1, 1, "cosine of the measured heading"),
    ("sin_heading", -1, 1, "sine of the measured heading"),
    ("speed", -4, 4, "measured speed [top speed; for points, the speed in the equilibrium]"),
    ("cos_phase", -1, 1, "cosine of the measured phase theta"),
    ("sin_phase", -1, 1, "sine of the measured phase theta"),
    ("works", 0, 1, "1 working, 0 failed or removed"),
)
NEIGHBOUR_ENTRIES = (
    ("heard", 0, 1, "1 after the first message; neighbour 0 is the previous robot on the ring, 1 the next"),
    ("age", 0, 1, "time since its last message was sent, at most 1 [0.3 rad / omega]"),
    ("cos_phase", -1, 1, "cosine of its phase relative to own phase"),
    ("sin_phase", -1, 1, "sine of its phase relative to own phase"),
    ("x", -4, 4, "relative x [2 half_width]"),
    ("y", -4, 4, "relative y [2 half_height]"),
)
ROBOT_ENTRIES = (
    ("present", 0, 1, "1 if the slot has one of the robots in sight, else 0; the nearest comes first"),
    ("x", -1, 1, "relative x [sight]"),
    ("y", -1, 1, "relative y [sight]"),
    ("x_velocity", -1, 1, "relative velocity along x [2 top speeds]"),
    ("y_velocity", -1, 1, "relative velocity along y [2 top speeds]"),
)
TARGET_ENTRIES = (
    ("present", 0, 1, "1 if the slot has one of the targets in sight, else 0; the nearest comes first"),
    ("x", -1, 1, "relative x [sight]"),
    ("y", -1, 1, "relative y [sight]"),
)
TRACK_ENTRIES = (
    ("present", 0, 1, "1 if the slot has a track, else 0; the nearest comes first"),
    ("x", -4, 4, "relative x when it was last in sight [2 half_width]"),
    ("y", -4, 4, "relative y when it was last in sight [2 half_height]"),
    ("age", 0, 1, "time since it was last in sight [memory]"),
    ("x_velocity", -1, 1, "velocity along x then, 0 if unknown [2 top speeds]"),
    ("y_velocity", -1, 1, "velocity along y then, 0 if unknown [2 top speeds]"),
    ("own", 0, 1, "1 if this robot has it in sight"),
    ("other", 0, 1, "1 if another robot had it in sight according to the messages that arrived in this step"),
    ("leaves", 0, 1, "1 if it was detected then and leaves; the next row does not contain it"),
)
TEAMMATE_ENTRIES = (
    ("present", 0, 1, "1 if the slot has a teammate whose place is known, else 0; the nearest comes first"),
    ("x", -4, 4, "relative x when its last message was sent [2 half_width]"),
    ("y", -4, 4, "relative y when its last message was sent [2 half_height]"),
    ("age", 0, 1, "time since its last message was sent [memory]"),
)
CELL_ENTRIES = (
    ("age", 0, 1, "time since it was covered, as far as the robot knows; 1 for longer ago or never [memory]"),
)
"""Name, range and meaning, with its unit in brackets, of the entries of each part of a row."""


def message_entries(size: int) -> tuple[tuple[str, float, float, str], ...]:
    """Return name, range and meaning of the entries of a ring neighbour's message of `size` numbers."""
    return tuple((f"message_{m}", -1, 1, f"component {m} of its policy's last message received") for m in range(size))


OWN_SIZE = wp.constant(len(OWN_ENTRIES))
LINK_SIZE = wp.constant(len(NEIGHBOUR_ENTRIES))
ROBOT_SIZE = wp.constant(len(ROBOT_ENTRIES))
TARGET_SIZE = wp.constant(len(TARGET_ENTRIES))
TRACK_SIZE = wp.constant(len(TRACK_ENTRIES))
TEAMMATE_SIZE = wp.constant(len(TEAMMATE_ENTRIES))


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
    """Return the layout of the observation of one robot of a scenario."""
    scenario = named.build(scenario)
    parts = [("", OWN_ENTRIES), *((f"neighbour_{k}_", NEIGHBOUR_ENTRIES) for k in range(2))]
    parts += [(f"robot_{k}_", ROBOT_ENTRIES) for k in range(scenario.sensing.robots_seen)]
    parts += [(f"target_{k}_", TARGET_ENTRIES) for k in range(scenario.sensing.targets_seen)]
    parts += [(f"neighbour_{k}_", message_entries(scenario.messages.size)) for k in range(2)]
    parts += [(f"track_{k}_", TRACK_ENTRIES) for k in range(scenario.sensing.tracks_seen)]
    parts += [(f"teammate_{k}_", TEAMMATE_ENTRIES) for k in range(scenario.sensing.teammates_seen)]
    columns, rows = scenario.sensing.cells_seen or (0, 0)
    parts += [(f"cell_{k}_", CELL_ENTRIES) for k in range(columns * rows)]
    entries: list[tuple[str, float, float, str]] = [
        (prefix + name, low, high, meaning) for prefix, part in parts for name, low, high, meaning in part
    ]
    for extension in scenario.extensions:
        if isinstance(extension, ObservationEntry):
            entries += [(name, extension.low, extension.high, extension.about) for name in extension.entries]
    return layout_of(entries)


def layout_of(entries: Iterable[tuple[str, float, float, str]]) -> Layout:
    """Return the layout of a row with these names, ranges and meanings."""
    names, low, high, meanings = zip(*entries, strict=True)
    return Layout(names, np.array(low, dtype=np.float32), np.array(high, dtype=np.float32), meanings)


def message_start(scenario: Scenario) -> int:
    """Return the index of `neighbour_0_message_0`; the entries of neighbour 1 follow those of neighbour 0."""
    sensing = scenario.sensing
    return OWN_SIZE + 2 * LINK_SIZE + ROBOT_SIZE * sensing.robots_seen + TARGET_SIZE * sensing.targets_seen


def track_start(scenario: Scenario) -> int:
    """Return the index of `track_0_present`; the entries of teammates follow those of the tracks."""
    return message_start(scenario) + 2 * scenario.messages.size


def cell_start(scenario: Scenario) -> int:
    """Return the index of `cell_0_age`; cells follow row by row from the lower left corner of the rectangle."""
    sensing = scenario.sensing
    return track_start(scenario) + TRACK_SIZE * sensing.tracks_seen + TEAMMATE_SIZE * sensing.teammates_seen
