"""Layout of a rogue's observation: the rogue itself, the walls, and the robots.

One row of float32 per target slot: `OWN_ENTRIES`, `WALL_ENTRIES`, then `ROBOT_ENTRIES` for each robot, those that it
observes first, the nearest first. It observes all robots that were not removed, or those within `targets.sight`.
`rogue_layout` has index, name, range and meaning of each entry; `print(rogue_layout(scenario))` shows them.

A row is zero before its target appears and after the step in which it is detected. Directions are in the world frame,
positions and velocities are true ones: a rogue has no noise.
"""

import warp as wp

from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.observation import Layout, layout_of

OWN_ENTRIES = (
    ("present", 0, 1, "1 while it is present and undetected"),
    ("x", -1, 1, "x [half_width]"),
    ("y", -1, 1, "y [half_height]"),
    ("x_velocity", -1, 1, "velocity along x in the latest step [speed_limit]"),
    ("y_velocity", -1, 1, "velocity along y in the latest step [speed_limit]"),
    ("age", 0, 4, "time since it appeared, at most 4 [detection-time bound T_max]"),
)
WALL_ENTRIES = (
    ("left", 0, 4, "distance to the left wall, at most 4 [sensing radius]"),
    ("right", 0, 4, "distance to the right wall, at most 4 [sensing radius]"),
    ("bottom", 0, 4, "distance to the bottom wall, at most 4 [sensing radius]"),
    ("top", 0, 4, "distance to the top wall, at most 4 [sensing radius]"),
)
ROBOT_ENTRIES = (
    ("present", 0, 1, "1 if the slot has one of the robots in sight, else 0; the nearest comes first"),
    ("works", 0, 1, "1 working, 0 failed: a failed robot senses nothing"),
    ("x", -4, 4, "relative x [2 half_width]"),
    ("y", -4, 4, "relative y [2 half_height]"),
    ("x_velocity", -4, 4, "velocity along x [top speed; for points, the speed in the equilibrium]"),
    ("y_velocity", -4, 4, "velocity along y [top speed; for points, the speed in the equilibrium]"),
    ("gap", -1, 4, "distance from the edge of its sensing disc, at most 4 [sensing radius]"),
)
"""Name, range and meaning, with its unit in brackets, of the entries of each part of a row."""

ACTION_NAMES = "x_velocity", "y_velocity"
"""Components of a rogue's action, a velocity [speed_limit]; a longer one is shortened to length 1."""

OWN_SIZE = wp.constant(len(OWN_ENTRIES))
FIRST_ROBOT = wp.constant(len(OWN_ENTRIES) + len(WALL_ENTRIES))
ROBOT_SIZE = wp.constant(len(ROBOT_ENTRIES))


def rogue_layout(scenario: str | Scenario) -> Layout:
    """Lay out the observation of one rogue of a scenario."""
    scenario = named.build(scenario)
    parts = [("", OWN_ENTRIES), ("wall_", WALL_ENTRIES)]
    parts += [(f"robot_{k}_", ROBOT_ENTRIES) for k in range(scenario.num_robots)]
    return layout_of([(prefix + name, *rest) for prefix, part in parts for name, *rest in part])
