"""The state of a batch of worlds: flat device arrays, world first, grouped by what they describe.

W worlds, N robots, T target slots, S sub-steps, R rows and C columns of a grid; the bits of a row are in B words, whose
size each struct states. A name that ends in `_at` is that of a step, counted from 0 at the reset. At the beginning of
an episode, arrays are zero or have the value that the decorator of their struct states.
"""

import warp as wp

from lissajous_env.device.stage import TYPES, named_struct

WORKING = wp.constant(0)
FAILED = wp.constant(1)
REMOVED = wp.constant(2)
"""`robots.status`."""
HIDDEN = wp.constant(0)
PRESENT = wp.constant(1)
DETECTED = wp.constant(2)
GONE = wp.constant(3)
"""`targets.status`."""
RUNNING = wp.constant(0)
ENDED = wp.constant(1)
IDLE = wp.constant(2)
"""`clock.status`."""
NEVER = wp.constant(2**30)
"""Step of an event that has not happened."""
LONGER = wp.constant(1.0 + 1.0e-6)
"""Factor above which a time in float32 exceeds a limit: a whole number of steps is rounded, and so is a limit."""
NOWHERE = wp.constant(1.0e15)
"""Coordinate of the sensor of a robot that senses nothing [m]."""


@named_struct("clock")
class Clock:
    """Time and randomness of each world (W,)."""

    seed: wp.array(dtype=wp.int32)
    """Seed of the world's random draws."""
    step: wp.array(dtype=wp.int32)
    """Number of control steps in this episode so far."""
    status: wp.array(dtype=wp.int32)
    """RUNNING, ENDED by the latest step, or IDLE: ended earlier and waiting for a reset."""
    active: wp.array(dtype=wp.int32)
    """1 where the world is part of the current step or reset."""
    fresh: wp.array(dtype=wp.int32)
    """1 where a reset begins a new episode."""
    invalid: wp.array(dtype=wp.int32)
    """1 where an action of this episode was not finite and was replaced by zero."""
    invalid_at: wp.array(dtype=wp.int32)
    """Step in which that happened first, counted from 1; 0 for none."""


@named_struct("robots", resumed_at=-1)
class Robots:
    """Robots (W, N) in truth and as they measure themselves."""

    position: wp.array2d(dtype=wp.vec3)
    """x, y, z [m]."""
    heading: wp.array2d(dtype=wp.float32)
    """Heading [rad]."""
    speed: wp.array2d(dtype=wp.float32)
    """Speed along the heading over the ground, below 0 in reverse [m/s]."""
    phase: wp.array2d(dtype=wp.float64)
    """theta of (1) in [0, 2 pi) [rad]; the curve's parameter is alpha theta."""
    path: wp.array3d(dtype=wp.vec3)
    """(W, N, S + 1) positions through the latest step [m]."""
    status: wp.array2d(dtype=wp.int32)
    """WORKING, FAILED or REMOVED."""
    failed_until: wp.array2d(dtype=wp.int32)
    """Step at whose end a random fault is over; NEVER for a robot that a collision stopped."""
    resumed_at: wp.array2d(dtype=wp.int32)
    """Step at whose end the latest fault was over; -1 for none."""
    removed_at: wp.array2d(dtype=wp.int32)
    """Step after which the robot is removed."""
    wheelbase: wp.array2d(dtype=wp.float32)
    """Wheelbase of this car [m]."""
    drive: wp.array2d(dtype=wp.float32)
    """alpha of (12), the acceleration of this car's motor at full throttle [m/s^2]."""
    yaw_rate: wp.array2d(dtype=wp.float32)
    """Yaw rate of a differential drive [rad/s]; 0 for other robots."""
    sensor: wp.array2d(dtype=wp.vec2)
    """x, y of a working robot [m]; NOWHERE for a robot that has failed or been removed."""
    measured: wp.array2d(dtype=wp.vec4)
    """Measured x, y [m], heading [rad], speed [m/s]."""
    measured_turn: wp.array2d(dtype=wp.vec4)
    """Cosine and sine of the measured phase, and of the measured heading."""
    curvature: wp.array2d(dtype=wp.float32)
    """Curvature of the path of a car in the latest step in which it worked [1/m], for `faults.stop` = `coast`."""


@named_struct("links", heard_at=-1)
class Links:
    """Messages on the ring: those that each robot sent, and the last ones from its two neighbours."""

    sent: wp.array3d(dtype=wp.vec4)
    """(W, N, delay + 1) cosine and sine of the phase, x, y [m] as sent in the latest steps."""
    sending: wp.array3d(dtype=wp.int32)
    """(W, N, delay + 1) 1 where a robot sent a message in that step, 0 where it was removed."""
    heard: wp.array3d(dtype=wp.vec4)
    """(W, N, 2) the last message received from each neighbour, in the same form."""
    heard_at: wp.array3d(dtype=wp.int32)
    """(W, N, 2) step in which that message was sent; -1 for none yet."""


@named_struct("messages")
class Messages:
    """Messages of k numbers that policies send on the ring."""

    sending: wp.array3d(dtype=wp.float32)
    """(W, N, k) message that each robot sends in the latest step; zeros before its first action."""
    sent: wp.array4d(dtype=wp.float32)
    """(W, N, delay + 1, k) messages that each robot sent in the latest steps."""
    heard: wp.array4d(dtype=wp.float32)
    """(W, N, 2, k) last message received from each ring neighbour; zeros for none yet."""


@named_struct("targets", found_at=NEVER)
class Targets:
    """Target slots (W, T)."""

    position: wp.array2d(dtype=wp.vec2)
    """x, y [m]."""
    before: wp.array2d(dtype=wp.vec2)
    """x, y at the end of the previous step [m], of a target that an extension or an adversary moves."""
    heading: wp.array2d(dtype=wp.float32)
    """Heading [rad]."""
    motion: wp.array2d(dtype=wp.int32)
    """STILL, DRIFTING, WANDERING, FLEEING or CUSTOM."""
    status: wp.array2d(dtype=wp.int32)
    """HIDDEN until it appears, PRESENT, DETECTED by a robot, or GONE if it left after its detection."""
    appears_at: wp.array2d(dtype=wp.int32)
    """Step in which it appears."""
    found_at: wp.array2d(dtype=wp.int32)
    """Step in which it was detected; NEVER before."""
    found_early: wp.array2d(dtype=wp.float32)
    """Share of that step that was left at its detection, in [0, 1]: it was detected at step found_at - found_early."""
    in_sight: wp.array2d(dtype=wp.int32)
    """1 while a working robot has it within `sensing.sight` at the end of a step."""
    speed: wp.array2d(dtype=wp.float32)
    """Speed while it drifts or wanders [m/s]."""
    earlier: wp.array2d(dtype=wp.int32)
    """Number of earlier detections, after each of which it appeared anew."""
    earlier_time: wp.array2d(dtype=wp.float64)
    """Sum of the times of these detections [step]."""
    earlier_longest: wp.array2d(dtype=wp.float32)
    """Longest of these times [step]."""


@named_struct(
    "tracks", sighted_at=-1, left_at=-1, own_sighted_at=-1, other_sighted_at=-1, mate_sent_at=-1, covered_at=-1
)
class Tracks:
    """Targets, teammates and covered cells, as far as each robot knows: `lissajous_env.world.tracks`."""

    sighted: wp.array4d(dtype=wp.int32)
    """(W, N, delay + 1, T) 1 where a robot had a target in sight in the latest steps; 2 if it left after that step."""
    target_position: wp.array3d(dtype=wp.vec2)
    """(W, delay + 1, T) positions of the targets in these steps [m]."""
    position: wp.array3d(dtype=wp.vec2)
    """(W, N, T) position of a target when it was last in sight, as far as a robot knows [m]."""
    velocity: wp.array3d(dtype=wp.vec2)
    """(W, N, T) its velocity then [m/s]; 0 unless it was also in sight a step before."""
    sighted_at: wp.array3d(dtype=wp.int32)
    """(W, N, T) step of that position and velocity; -1 for a target without a track."""
    leaves: wp.array3d(dtype=wp.int32)
    """(W, N, T) 1 if the robot learned in this step that the target was detected at `sighted_at`, and leaves."""
    left_at: wp.array3d(dtype=wp.int32)
    """(W, N, T) step in which the target that left last was detected, as far as the robot knows; -1 for none yet."""
    own_sighted_at: wp.array3d(dtype=wp.int32)
    """(W, N, T) step in which the robot itself had it in sight last; -1 for never."""
    other_sighted_at: wp.array3d(dtype=wp.int32)
    """(W, N, T) step in which another robot had it in sight last, as far as the robot knows; -1 for never."""
    mate_position: wp.array3d(dtype=wp.vec2)
    """(W, N, N) position of a teammate as measured by itself [m]."""
    mate_sent_at: wp.array3d(dtype=wp.int32)
    """(W, N, N) step in which the teammate sent that position; -1 for none yet."""
    sensor_position: wp.array3d(dtype=wp.vec2)
    """(W, N, delay + 1) position of a robot's sensor in the latest steps [m]; NOWHERE where it sensed nothing."""
    covered_at: wp.array4d(dtype=wp.int32)
    """(W, N, rows, columns) step in which a cell was last covered, as far as a robot knows; -1 for never."""


@named_struct("rogues")
class Rogues:
    """Targets that an adversary moves (W, T): `lissajous_env.world.rogues`."""

    action: wp.array3d(dtype=wp.float32)
    """(W, T, 2) velocity as commanded [speed limit]."""
    velocity: wp.array2d(dtype=wp.vec2)
    """Velocity in the latest step [m/s], which walls may have reduced."""
    observation: wp.array3d(dtype=wp.float32)
    """(W, T, D) rows: `lissajous_env.world.rogues.acting`."""
    reward: wp.array2d(dtype=wp.float32)
    """Time of the latest step for which it was undetected [s]."""
    present: wp.array2d(dtype=wp.bool)
    """True if it acts in the next step: it is present and undetected, and the episode runs."""
    terminated: wp.array2d(dtype=wp.bool)
    """True from its detection on."""
    truncated: wp.array2d(dtype=wp.bool)
    """True if it was undetected when the episode ended."""


@named_struct("cells")
class Cells:
    """The coverage grid: R rows, C columns, and B words of bits for 64 columns each."""

    sensed_at: wp.array3d(dtype=wp.int32)
    """(W, R, C) last step before the present visit in which a cell was sensed, 0 for never: `coverage.last_sensed`."""
    sensed: wp.array3d(dtype=wp.uint64)
    """(W, B, R) a bit for each cell that some robot has sensed."""
    sensed_by: wp.array4d(dtype=wp.uint64)
    """(W, N, B, R) a bit for each cell that this robot has sensed."""
    in_discs: wp.array3d(dtype=wp.uint64)
    """(W, B, R) a bit for each cell that is sensed now."""
    coming: wp.array3d(dtype=wp.uint64)
    """(W, B, R) the next `in_discs`, while a step computes it; zeros between steps."""
    idle_squares: wp.array2d(dtype=wp.int64)
    """(W, R) sum over cells and visits of the squared time since the visit before [step^2]."""
    idle_max: wp.array2d(dtype=wp.int32)
    """(W, R) longest time since the visit before [step]."""


@named_struct("contamination", row_oldest=NEVER, cleared_at=NEVER, high_at=-1)
class Contamination:
    """Cells in which undetected targets may be: `lissajous_env.world.contamination.field`.

    Its grid has R rows and C columns, in B words of bits for 32 columns each, or D words for 64.
    """

    labels: wp.array4d(dtype=wp.int32)
    """(W, K, R + 4, C + 4 or more) label in each of the latest K ticks of each cell, with a margin around the grid."""
    labelled: wp.array4d(dtype=wp.uint32)
    """(W, R + 4, B + 2, K) a bit for each cell that had a label in this tick and was not sensed since."""
    sensed: wp.array3d(dtype=wp.uint64)
    """(W, D, R) a bit for each cell that a robot senses now."""
    swept: wp.array3d(dtype=wp.uint64)
    """(W, D, R) a bit for each of these, and for each that the disc of a robot that moved far has passed over."""
    settled: wp.array3d(dtype=wp.uint32)
    """(W, R, B) four bytes, one for each 8 cells: latest ticks after which all had the label of the oldest target."""
    row_oldest: wp.array2d(dtype=wp.int32)
    """(W, R) earliest introduction of a target that may be in this row now [step]; NEVER for none."""
    row_ages: wp.array2d(dtype=wp.int64)
    """(W, R) time since the introduction, summed over the cells of this row [step]."""
    oldest: wp.array(dtype=wp.int32)
    """(W,) min e, the earliest introduction of an undetected target that may be anywhere now [step]; NEVER for none."""
    cleared_at: wp.array(dtype=wp.int32)
    """(W,) first step since which no cell is contaminated; NEVER while one is."""
    age: wp.array(dtype=wp.int32)
    """(W,) worst-case undetected time now [step]."""
    age_max: wp.array(dtype=wp.int32)
    """(W,) largest `age` of the episode [step]."""
    mean_age: wp.array(dtype=wp.float32)
    """(W,) time since the introduction, mean over the cells, 0 where one is cleared [step]."""
    mean_age_sum: wp.array(dtype=wp.float64)
    """(W,) `mean_age`, summed over steps [step]."""
    age_reduction: wp.array(dtype=wp.float32)
    """(W,) decrease of the mean age in the latest step [step]."""
    age_before: wp.array(dtype=wp.int32)
    """(W,) largest `age` before the first fault [step]."""
    high_at: wp.array(dtype=wp.int32)
    """(W,) latest step after the first fault in which `age` exceeded 1.1 times `age_before`; -1 for none."""


@named_struct("latest")
class StepEvents:
    """Events and measures of the latest step."""

    detections: wp.array2d(dtype=wp.int32)
    """(W, N) targets that this robot was the first to detect."""
    collisions: wp.array2d(dtype=wp.int32)
    """(W, N) collisions that began."""
    sensed: wp.array2d(dtype=wp.int32)
    """(W, N) 1 for a robot that worked in the step, even if a collision or the edge ended its work at the end."""
    effort: wp.array2d(dtype=wp.float32)
    """(W, N) mean square of the action without its message; 0 for a robot that does not work."""
    change: wp.array2d(dtype=wp.float32)
    """(W, N) mean square of the change of that action; 0 in an episode's first step and for robots that do not work."""
    lateral: wp.array2d(dtype=wp.float32)
    """(W, N) distance from the curve [m]."""
    tracking: wp.array2d(dtype=wp.float32)
    """(W, N) distance from the point of the curve at the robot's own phase [m]."""
    phase_offset: wp.array2d(dtype=wp.vec3)
    """(W, N) phase relative to the equilibrium [rad], its cosine and sine."""
    in_sight: wp.array(dtype=wp.int32)
    """(W,) targets that some working robot has within `sensing.sight`."""
    waiting: wp.array(dtype=wp.int32)
    """(W,) undetected targets present."""
    outside: wp.array2d(dtype=wp.int32)
    """(W, N) 1 where the whole body is outside the rectangle."""
    partly_outside: wp.array2d(dtype=wp.int32)
    """(W, N) 1 where some part of the body is outside the rectangle."""
    idle_ended: wp.array(dtype=wp.int64)
    """(W,) idleness of the cells that were sensed, summed [step]."""
    terms: wp.array3d(dtype=wp.float32)
    """(W, N, terms) terms of the reward: `lissajous_env.world.tally.TERMS`, then those of extensions."""
    reward: wp.array2d(dtype=wp.float32)
    """(W, N) sum of the terms."""
    terminated: wp.array2d(dtype=wp.bool)
    """(W, N) True if a collision or the edge of the rectangle removed the robot."""
    truncated: wp.array2d(dtype=wp.bool)
    """(W, N) True when the episode has reached its time limit."""


@named_struct(
    "tally", min_separation=1e30, covered_at=NEVER, covered_each_at=NEVER, off_at=-1, fault_end=-1, driven_from=NOWHERE
)
class EpisodeTotals:
    """Totals of an episode so far, from which the score columns are computed."""

    contact: wp.array3d(dtype=wp.int32)
    """(W, N, N) above the diagonal, latest step in which a pair collided, negative once it has parted; 0 for never."""
    collisions: wp.array(dtype=wp.int64)
    """(W,) collisions."""
    contact_steps: wp.array(dtype=wp.int64)
    """(W,) steps in contact, summed over pairs."""
    min_separation: wp.array(dtype=wp.float32)
    """(W,) smallest distance of two robots [m]."""
    covered: wp.array(dtype=wp.int64)
    """(W,) cells covered by some robot."""
    covered_each: wp.array(dtype=wp.int64)
    """(W,) cells covered, summed over robots."""
    covered_at: wp.array(dtype=wp.int32)
    """(W,) step in which every cell had been covered."""
    covered_each_at: wp.array(dtype=wp.int32)
    """(W,) step in which every robot had covered every cell."""
    present_steps: wp.array(dtype=wp.int32)
    """(W,) steps in which some robot was not removed."""
    change_steps: wp.array(dtype=wp.int32)
    """(W,) steps after the first in which some robot worked."""
    lateral_sum: wp.array(dtype=wp.float64)
    """(W,) distance from the curve, summed over steps, mean over robots [m]."""
    lateral_max: wp.array(dtype=wp.float32)
    """(W,) largest distance from the curve [m]."""
    tracking_sum: wp.array(dtype=wp.float64)
    """(W,) distance from the point of the curve at a robot's own phase, summed over steps, mean over robots [m]."""
    tracking_max: wp.array(dtype=wp.float32)
    """(W,) largest distance from the point of the curve at a robot's own phase [m]."""
    spacing_max: wp.array(dtype=wp.float32)
    """(W,) largest distance of ring neighbours [m]."""
    phase_error: wp.array(dtype=wp.float32)
    """(W,) deviation from the equilibrium now [rad]."""
    phase_error_max: wp.array(dtype=wp.float32)
    """(W,) largest deviation from the equilibrium [rad]."""
    nominal_phase_error: wp.array(dtype=wp.float32)
    """(W,) largest deviation from the equilibrium before a robot failed for the first time [rad]."""
    faulted: wp.array(dtype=wp.int32)
    """(W,) 1 from the first step in which a robot has failed."""
    off_at: wp.array(dtype=wp.int32)
    """(W,) latest step since then in which the deviation exceeded `nominal_phase_error` by a margin; -1 for never."""
    fault_end: wp.array(dtype=wp.int32)
    """(W,) step at whose end the latest failed robot resumed; -1 for none or while a robot has failed."""
    distance_sum: wp.array(dtype=wp.float64)
    """(W,) distance travelled, summed over robots [m]."""
    observed: wp.array(dtype=wp.int64)
    """(W,) targets in sight, summed over steps."""
    speed_max: wp.array(dtype=wp.float32)
    """(W,) largest speed of a robot, forwards or backwards [m/s]."""
    change_sum: wp.array(dtype=wp.float64)
    """(W,) mean square of the change of the action, summed over steps, mean over the working robots."""
    outside_steps: wp.array(dtype=wp.int64)
    """(W,) steps with the whole body outside the rectangle, summed over robots."""
    partly_outside_steps: wp.array(dtype=wp.int64)
    """(W,) steps with some part of the body outside the rectangle, summed over robots."""
    wall_contacts: wp.array2d(dtype=wp.int32)
    """(W, N) contacts with a wall that began."""
    at_wall: wp.array2d(dtype=wp.int32)
    """(W, N) 1 while a contact with a wall lasts."""
    blocked_steps: wp.array2d(dtype=wp.int32)
    """(W, N) steps in which a robot was blocked."""
    driven_steps: wp.array2d(dtype=wp.int32)
    """(W, N) steps in which its policy drove a robot since it last moved by its radius, from `driven_from`."""
    driven_from: wp.array2d(dtype=wp.vec2)
    """(W, N) position from which that motion is measured [m]."""
    returns: wp.array2d(dtype=wp.float64)
    """(W, N) sum of the rewards."""


TYPES.update(
    # Indices of a world, robots, a target, row and column of a grid, slot of a ring buffer; present step, key of draws.
    **dict.fromkeys(("w", "i", "j", "t", "row", "column", "slot", "now", "key"), int),
    # Constants of a scenario, which `lissajous_env.world.values` documents.
    **dict.fromkeys(("steps", "cells_total", "message_start", "track_start", "cell_start"), int),
    **dict.fromkeys(("age_per_step", "bounds_per_step", "speed_unit", "turning_radius"), float),
    **dict.fromkeys(("displacements", "drive_factors", "top_speeds"), wp.array(dtype=float)),
    **dict.fromkeys(("places", "removals"), wp.array(dtype=int)),
    **dict.fromkeys(("neighbours", "schedule"), wp.array2d(dtype=int)),
    action_speeds=wp.array2d(dtype=float),
    equilibrium=wp.array(dtype=wp.float64),
    # Arrays of a simulation, which `lissajous_env.world.simulation` documents.
    **dict.fromkeys(("action", "limited_action", "command"), wp.array3d(dtype=float)),
    **dict.fromkeys(("observation", "final_observation"), wp.array3d(dtype=float)),
    nearest=wp.array3d(dtype=wp.vec2),
    seeds=wp.array(dtype=int),
)


@wp.func
def planar(position: wp.vec3) -> wp.vec2:
    """Return the position on the ground [m]."""
    return wp.vec2(position[0], position[1])
