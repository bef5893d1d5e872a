"""Motion, reward and observation of rogues, for actions of agents, networks and scripts.

The observation has one row of float32 per target slot: `OWN_ENTRIES`, `WALL_ENTRIES`, then `ROBOT_ENTRIES` for each
robot that was not removed and is within `targets.sight`, if that is not 0, the nearest first, and zeros.
`rogue_layout` has index, name, range and meaning of each entry; `print(rogue_layout(scenario))` shows them.

A row is zero before its target appears and after the step in which it is detected. Directions are in the world frame,
positions and velocities are true ones: a rogue has no noise.
"""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import into_rectangle
from lissajous_env.device.stage import TARGET, part, stage
from lissajous_env.device.trig import atan2
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.observation import Layout, layout_of
from lissajous_env.world.observing import FARTHEST, clip_coordinate, comes_before, velocity_of
from lissajous_env.world.robots.signals import flag_invalid
from lissajous_env.world.state import DETECTED, ENDED, HIDDEN, IDLE, PRESENT, REMOVED, RUNNING, WORKING, planar

wp.set_module_options(OPTIONS)

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
"""Components of a rogue's action, a velocity [speed_limit], which `commanded` limits."""

OWN_SIZE = wp.constant(len(OWN_ENTRIES))
FIRST_ROBOT = wp.constant(len(OWN_ENTRIES) + len(WALL_ENTRIES))
"""Index of the first entry of the nearest robot."""
ROBOT_SIZE = wp.constant(len(ROBOT_ENTRIES))


def rogue_layout(scenario: str | Scenario) -> Layout:
    """Return the layout of the observation of one rogue of a scenario."""
    return layout_of(rogue_entries(named.build(scenario).num_robots))


def rogue_entries(num_robots: int) -> list[tuple]:
    """Return name, range and meaning of the entries of a rogue's row."""
    parts = [("", OWN_ENTRIES), ("wall_", WALL_ENTRIES), *((f"robot_{k}_", ROBOT_ENTRIES) for k in range(num_robots))]
    return [(prefix + name, *rest) for prefix, part in parts for name, *rest in part]


@wp.func
def commanded(x: float, y: float) -> wp.vec2:
    """Return the action x, y [speed_limit], clipped to [-1, 1] and then shortened to length 1 if it is longer."""
    action = wp.vec2(wp.clamp(x, -1.0, 1.0), wp.clamp(y, -1.0, 1.0))
    return action / wp.max(wp.length(action), 1.0)


@stage(TARGET, writes="clock: invalid, invalid_at; rogues: velocity; targets: heading, position")
def move_rogues(w, t, curve, target, task, clock, targets, rogues):
    """Move each undetected rogue by its action; walls stop it, and an action that is not finite counts as zero."""
    moved = wp.vec2(0.0, 0.0)
    if targets.status[w, t] == PRESENT:
        x = rogues.action[w, t, 0]
        y = rogues.action[w, t, 1]
        place = targets.position[w, t]
        if wp.isfinite(x) and wp.isfinite(y):
            after = into_rectangle(place + target.speed_limit * task.step * commanded(x, y), curve)
            moved = after - place
            targets.position[w, t] = after
        else:
            flag_invalid(w, clock)
        if wp.length_sq(moved) > 0.0:
            targets.heading[w, t] = atan2(moved[1], moved[0])
    rogues.velocity[w, t] = moved / task.step


@stage(TARGET, writes="rogues: present, reward, terminated, truncated", idle=True)
def reward_rogues(w, t, task, clock, targets, rogues):
    """Reward each rogue with the time of this step for which it was undetected [s]; a detection terminates it."""
    status = targets.status[w, t]
    now = clock.step[w]
    if clock.active[w] == 1:
        reward = float(0.0)
        if targets.appears_at[w, t] < now and (status == PRESENT or targets.found_at[w, t] == now):
            reward = (1.0 - targets.found_early[w, t]) * task.step
        rogues.present[w, t] = status == PRESENT and clock.status[w] == RUNNING
        rogues.terminated[w, t] = status != PRESENT and status != HIDDEN
        rogues.truncated[w, t] = status == PRESENT and clock.status[w] == ENDED
        rogues.reward[w, t] = reward
    elif clock.status[w] == IDLE:  # a reset of other worlds leaves rewards of a latest step unchanged
        rogues.reward[w, t] = 0.0


@part
def next_robot(w, place: wp.vec2, after: wp.vec2, sight: float, robots) -> wp.vec2:
    """Return (squared distance [m^2], index) of the next robot in sight, the nearest first; index -1 for none.

    `after` is that of the robot before it, or (-1, -1). A `sight` of 0 means no limit [m].
    """
    best = wp.vec2(wp.inf, -1.0)
    for i in range(robots.status.shape[1]):
        away = planar(robots.position[w, i]) - place
        key = wp.vec2(wp.dot(away, away), float(i))
        is_in_sight = robots.status[w, i] != REMOVED and (sight == 0.0 or key[0] < sight * sight)
        if is_in_sight and comes_before(after, key) and key[0] < best[0]:
            best = key
    return best


@part
def observe_itself(w, t, place: wp.vec2, curve, target, radius: float, age: float, targets, rogues):
    """Fill `OWN_ENTRIES` and `WALL_ENTRIES`, for a radius of sensing [m] and the time since it appeared [T_max]."""
    velocity = rogues.velocity[w, t] / target.speed_limit
    rogues.observation[w, t, 0] = wp.where(targets.status[w, t] == PRESENT, 1.0, 0.0)
    rogues.observation[w, t, 1] = wp.clamp(place[0] / curve.half_width, -1.0, 1.0)
    rogues.observation[w, t, 2] = wp.clamp(place[1] / curve.half_height, -1.0, 1.0)
    rogues.observation[w, t, 3] = wp.clamp(velocity[0], -1.0, 1.0)
    rogues.observation[w, t, 4] = wp.clamp(velocity[1], -1.0, 1.0)
    rogues.observation[w, t, 5] = wp.min(age, FARTHEST)
    for side in range(2):
        sign = float(1 - 2 * side)
        to_side = (curve.half_width + sign * place[0]) / radius
        to_end = (curve.half_height + sign * place[1]) / radius
        rogues.observation[w, t, OWN_SIZE + side] = wp.clamp(to_side, 0.0, FARTHEST)
        rogues.observation[w, t, OWN_SIZE + 2 + side] = wp.clamp(to_end, 0.0, FARTHEST)


@part
def observe_robot(w, t, i, start: int, away: wp.vec2, curve, radius: float, speed_unit, robots, rogues):
    """Fill the entries of robot i, from `start` on; `away` is its position relative to the rogue [m]."""
    velocity = velocity_of(w, i, robots) / speed_unit
    rogues.observation[w, t, start] = 1.0
    rogues.observation[w, t, start + 1] = wp.where(robots.status[w, i] == WORKING, 1.0, 0.0)
    rogues.observation[w, t, start + 2] = clip_coordinate(0.5 * away[0] / curve.half_width)
    rogues.observation[w, t, start + 3] = clip_coordinate(0.5 * away[1] / curve.half_height)
    rogues.observation[w, t, start + 4] = clip_coordinate(velocity[0])
    rogues.observation[w, t, start + 5] = clip_coordinate(velocity[1])
    rogues.observation[w, t, start + 6] = wp.clamp(wp.length(away) / radius - 1.0, -1.0, FARTHEST)


@stage(TARGET, writes="rogues: observation")
def fill_rows(w, t, curve, sensing, target, speed_unit, bounds_per_step, clock, robots, targets, rogues):
    """Fill the row of each rogue, for the last time in the step of its detection; later it is zeros."""
    size = rogues.observation.shape[2]
    now = clock.step[w]
    entry = int(0)
    is_last = targets.status[w, t] == DETECTED and targets.found_at[w, t] == now
    if targets.status[w, t] == PRESENT or is_last:
        place = targets.position[w, t]
        age = float(now - targets.appears_at[w, t]) * bounds_per_step
        observe_itself(w, t, place, curve, target, sensing.radius, age, targets, rogues)
        entry = FIRST_ROBOT
        nearest = next_robot(w, place, wp.vec2(-1.0, -1.0), target.sight, robots)
        while nearest[1] >= 0.0:
            i = int(nearest[1])
            away = planar(robots.position[w, i]) - place
            observe_robot(w, t, i, entry, away, curve, sensing.radius, speed_unit, robots, rogues)
            entry += ROBOT_SIZE
            nearest = next_robot(w, place, nearest, target.sight, robots)
    for k in range(entry, size):
        rogues.observation[w, t, k] = 0.0
