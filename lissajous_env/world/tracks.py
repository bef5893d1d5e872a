"""Information that each robot has from its sensor and messages: tracks of targets, teammates and covered cells.

A robot has a track of a target from the moment in which it learns that the target was in sight until `sensing.memory`
has passed since, or until the step after the one in which it learns that the target was detected and leaves. It learns
of its own sightings at once. By `sensing.shared`, messages tell it those of its two ring neighbours or of the team.
Messages between ring neighbours are the phase messages, with their delay and loss; those of other teammates are delayed
alike, and lost with the same probability. So each of `none`, `ring` and `team` informs a robot at least as well as the
one before it.

In the same way, a robot knows when the cells of `sensing.cells_seen` were covered: at the end of a step, a working
robot covers those whose centres are within `sensing.radius`. The cells are those of the rectangle, the same for all
robots, so that their knowledge can be compared and joined; relative positions follow from the robot's own x and y.
"""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.discs import CENTRE, columns_of, disc_run, points_per_metre
from lissajous_env.device.stage import ROBOT, part, stage
from lissajous_env.device.structs import code_of
from lissajous_env.settings.task import Sensing
from lissajous_env.world.observation import TEAMMATE_SIZE, TRACK_SIZE
from lissajous_env.world.observing import clear_entries, clear_slots, clip_coordinate, insert_nearest
from lissajous_env.world.state import DETECTED, GONE, HIDDEN, LONGER, REMOVED

wp.set_module_options(OPTIONS)

_RING = wp.constant(code_of(Sensing, "shared", "ring"))
_TEAM = wp.constant(code_of(Sensing, "shared", "team"))

_OUT_OF_SIGHT = wp.constant(0)
_IN_SIGHT = wp.constant(1)
_LEAVES = wp.constant(2)
"""In sight for the last time: it was detected in this step and leaves."""


@stage(ROBOT, writes="tracks: sighted, target_position")
def record_sightings(w, i, sensing, target, clock, robots, targets, tracks):
    """Record which targets the robot has in sight now, and where they are."""
    now = clock.step[w]
    slot = now % tracks.sighted.shape[2]
    for t in range(tracks.sighted_at.shape[2]):
        if i == 0:
            tracks.target_position[w, slot, t] = targets.position[w, t]
        sighted = int(_OUT_OF_SIGHT)
        status = targets.status[w, t]
        if status != HIDDEN and status != GONE:
            away = robots.sensor[w, i] - targets.position[w, t]
            if wp.dot(away, away) < sensing.sight * sensing.sight:
                leaves = status == DETECTED and target.leave == 1
                sighted = wp.where(leaves, _LEAVES, _IN_SIGHT)
        tracks.sighted[w, i, slot, t] = sighted


@part
def update_track(w, i, t, sighted: int, slot, sighted_at: int, step: float, tracks):
    """Update the track of a target by a sighting, unless the track is newer.

    `sighted` is _IN_SIGHT or _LEAVES in the step `sighted_at`, whose slot is `slot`; `step` is the control step [s].
    """
    latest = tracks.sighted_at[w, i, t]
    left_at = tracks.left_at[w, i, t]
    if sighted == _LEAVES and sighted_at >= latest:
        tracks.leaves[w, i, t] = 1
        tracks.left_at[w, i, t] = sighted_at
    if sighted_at > latest:
        position = tracks.target_position[w, slot, t]
        velocity = wp.vec2(0.0, 0.0)
        if sighted == _IN_SIGHT:  # if it left, it has appeared anew since then
            tracks.leaves[w, i, t] = 0
        if latest > left_at and latest == sighted_at - 1:  # not where it was before it left
            velocity = (position - tracks.position[w, i, t]) / step
        tracks.position[w, i, t] = position
        tracks.velocity[w, i, t] = velocity
        tracks.sighted_at[w, i, t] = sighted_at


@part
def arrives(w, i, j, key, sent_at: int, sensing, noise, neighbours, links) -> bool:
    """Return whether the message that teammate j sent in the step `sent_at` arrives at robot i now."""
    if sensing.shared < _RING or j == i or sent_at < 0:
        return False
    for side in range(2):
        if neighbours[i, side] == j:
            return links.heard_at[w, i, side] == sent_at
    if sensing.shared < _TEAM or links.sending[w, j, sent_at % links.sent.shape[2]] == 0:
        return False
    n = links.sent.shape[1]
    # The first 2 n entities are those of the messages on the ring.
    return randomness.uniform(key, 2 * n + n * i + j, randomness.MESSAGE) >= noise.message_loss


@stage(
    ROBOT,
    writes="tracks: leaves, left_at, mate_position, mate_sent_at, other_sighted_at, own_sighted_at, position, "
    "sighted_at, velocity",
)
def update_tracks(w, i, sensing, noise, task, neighbours, clock, links, tracks):
    """Update the tracks of each robot by the messages that arrive, then by its own sightings, which are not older."""
    now = clock.step[w]
    slots = tracks.sighted.shape[2]
    sent_at = now - (slots - 1)
    key = randomness.step_key(clock.seed[w], now)
    for t in range(tracks.sighted_at.shape[2]):
        if tracks.leaves[w, i, t] == 1:
            tracks.leaves[w, i, t] = 0
            tracks.sighted_at[w, i, t] = -1
    for j in range(tracks.mate_sent_at.shape[2]):
        if arrives(w, i, j, key, sent_at, sensing, noise, neighbours, links):
            slot = sent_at % slots
            message = links.sent[w, j, slot]
            tracks.mate_sent_at[w, i, j] = sent_at
            tracks.mate_position[w, i, j] = wp.vec2(message[2], message[3])
            for t in range(tracks.sighted_at.shape[2]):
                sighted = tracks.sighted[w, j, slot, t]
                # Older news than that of its departure are of the target before it appeared anew.
                if sighted != _OUT_OF_SIGHT and sent_at > tracks.left_at[w, i, t]:
                    tracks.other_sighted_at[w, i, t] = sent_at
                    update_track(w, i, t, sighted, slot, sent_at, task.step, tracks)
    slot = now % slots
    for t in range(tracks.sighted_at.shape[2]):
        sighted = tracks.sighted[w, i, slot, t]
        if sighted != _OUT_OF_SIGHT:
            tracks.own_sighted_at[w, i, t] = now
            update_track(w, i, t, sighted, slot, now, task.step, tracks)


@part
def fill_known(
    w, i, now, entry: int, size: int, slots: int, here: wp.vec2, seen_at: wp.array3d(dtype=wp.int32),
    position: wp.array3d(dtype=wp.vec2), curve, sensing, task, nearest, observation,
) -> int:  # fmt: skip
    """Fill the first four entries of the targets or teammates that a robot at `here` [m] knows; return their number.

    They are: present, relative x and y, and age [memory]. The nearest one has the first of the slots of `size` entries
    that begin at `entry`; slots without any are cleared.
    """
    unit = wp.length(wp.vec2(curve.half_width, curve.half_height))
    count = int(0)
    for k in range(seen_at.shape[2]):
        age = float(now - seen_at[w, i, k]) * task.step
        if seen_at[w, i, k] >= 0 and age <= LONGER * sensing.memory:
            count = insert_nearest(w, i, count, slots, (position[w, i, k] - here) / unit, k, nearest)
    for k in range(count):
        known = int(nearest[w, i, k][1])
        start = entry + k * size
        offset = position[w, i, known] - here
        observation[w, i, start] = 1.0
        observation[w, i, start + 1] = clip_coordinate(0.5 * offset[0] / curve.half_width)
        observation[w, i, start + 2] = clip_coordinate(0.5 * offset[1] / curve.half_height)
        observation[w, i, start + 3] = wp.min(float(now - seen_at[w, i, known]) * task.step / sensing.memory, 1.0)
    clear_slots(w, i, entry + count * size, size, slots - count, observation)
    return count


@stage(ROBOT, writes="nearest; observation")
def observe_tracks(w, i, track_start, curve, sensing, task, speed_unit, clock, robots, tracks, nearest, observation):
    """Fill the entries of each robot's tracks, then of its teammates; those of a removed robot are zeros."""
    mate_start = track_start + TRACK_SIZE * sensing.tracks_seen
    if robots.status[w, i] == REMOVED:
        clear_entries(w, i, track_start, mate_start + TEAMMATE_SIZE * sensing.teammates_seen, observation)
    else:
        now = clock.step[w]
        here = wp.vec2(robots.measured[w, i][0], robots.measured[w, i][1])
        count = fill_known(
            w, i, now, track_start, TRACK_SIZE, sensing.tracks_seen, here, tracks.sighted_at, tracks.position, curve,
            sensing, task, nearest, observation,
        )  # fmt: skip
        sent_at = now - (tracks.sighted.shape[2] - 1)
        for k in range(count):
            t = int(nearest[w, i, k][1])
            entry = track_start + k * TRACK_SIZE
            velocity = tracks.velocity[w, i, t] / (2.0 * speed_unit)
            observation[w, i, entry + 4] = wp.clamp(velocity[0], -1.0, 1.0)
            observation[w, i, entry + 5] = wp.clamp(velocity[1], -1.0, 1.0)
            observation[w, i, entry + 6] = wp.where(tracks.own_sighted_at[w, i, t] == now, 1.0, 0.0)
            has_arrived = sent_at >= 0 and tracks.other_sighted_at[w, i, t] == sent_at
            observation[w, i, entry + 7] = wp.where(has_arrived, 1.0, 0.0)
            observation[w, i, entry + 8] = float(tracks.leaves[w, i, t])
        fill_known(
            w, i, now, mate_start, TEAMMATE_SIZE, sensing.teammates_seen, here, tracks.mate_sent_at,
            tracks.mate_position, curve, sensing, task, nearest, observation,
        )  # fmt: skip


@part
def mark_covered(w, i, place: wp.vec2, covered_at: int, curve, sensing, tracks):
    """Record that the cells around a sensor at `place` [m] were covered in a step; around NOWHERE there are none."""
    rows = tracks.covered_at.shape[2]
    columns = tracks.covered_at.shape[3]
    scale = points_per_metre(columns, CENTRE, curve.half_width)
    for row in range(rows):
        y = (float(row) + CENTRE) / points_per_metre(rows, CENTRE, curve.half_height) - curve.half_height
        run = columns_of(disc_run(place, sensing.radius, y), curve.half_width, scale, CENTRE, columns)
        for column in range(run[0], run[1] + 1):
            tracks.covered_at[w, i, row, column] = wp.max(covered_at, tracks.covered_at[w, i, row, column])


@stage(ROBOT, writes="tracks: covered_at, sensor_position; observation")
def update_known_cells(
    w, i, cell_start, curve, sensing, noise, task, neighbours, clock, robots, links, tracks, observation
):
    """Update the cells that each robot knows to be covered, by its messages and its own sensor, and fill their ages."""
    now = clock.step[w]
    slots = tracks.sensor_position.shape[2]
    sent_at = now - (slots - 1)
    key = randomness.step_key(clock.seed[w], now)
    for j in range(robots.sensor.shape[1]):
        if arrives(w, i, j, key, sent_at, sensing, noise, neighbours, links):
            place = robots.sensor[w, j]  # without a delay, robot j may not have stored it yet
            if slots > 1:
                place = tracks.sensor_position[w, j, sent_at % slots]
            mark_covered(w, i, place, sent_at, curve, sensing, tracks)
    tracks.sensor_position[w, i, now % slots] = robots.sensor[w, i]
    mark_covered(w, i, robots.sensor[w, i], now, curve, sensing, tracks)
    columns = tracks.covered_at.shape[3]
    for k in range(tracks.covered_at.shape[2] * columns):
        covered_at = tracks.covered_at[w, i, k / columns, k % columns]
        age = float(1.0)
        if covered_at >= 0:
            age = wp.min(float(now - covered_at) * task.step / sensing.memory, 1.0)
        observation[w, i, cell_start + k] = wp.where(robots.status[w, i] == REMOVED, 0.0, age)
