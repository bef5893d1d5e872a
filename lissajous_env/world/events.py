"""What happens in a step, as it is gathered by the stages and read by the reward and the score."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.world.state import Clock, Counted, Latest
from lissajous_env.world.tally import EpisodeTotals

wp.set_module_options(OPTIONS)


@wp.func
def clear(w: int, i: int, latest: Latest):
    """Forget the events of a robot, and with the first one's those of its world."""
    latest.detections[w, i] = 0
    latest.collisions[w, i] = 0
    if i == 0:
        latest.in_sight[w] = 0
        latest.waiting[w] = 0
        latest.idle_ended[w] = wp.int64(0)


@wp.kernel
def reset_events(first: int, lanes: int, clock: Clock, latest: Latest, counted: Counted):
    """Forget what happened, was counted, earned and ended in the episode before."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for i in range(lane, latest.reward.shape[1], lanes):
        clear(w, i, latest)
        latest.terminated[w, i] = False
        latest.truncated[w, i] = False
        latest.reward[w, i] = 0.0
        for term in range(latest.terms.shape[2]):
            latest.terms[w, i, term] = 0.0
        for part in range(counted.collisions.shape[1]):
            counted.detections[w, part, i] = 0
            counted.met[w, part, i] = 0
    if lane == 0:
        for part in range(counted.collisions.shape[1]):
            forget_collisions(w, part, counted)
            counted.waiting[w, part] = 0
            counted.in_sight[w, part] = 0


@wp.func
def forget_collisions(w: int, part: int, counted: Counted):
    """Begin to count the collisions of a part anew."""
    counted.collisions[w, part] = wp.int64(0)
    counted.contact_steps[w, part] = wp.int64(0)
    counted.min_separation[w, part] = 1.0e30


@wp.kernel
def gather_collisions(first: int, clock: Clock, counted: Counted, latest: Latest, tally: EpisodeTotals):
    """Sum up what the parts of the robots counted, and forget it."""
    w = first + wp.tid()
    if clock.active[w] == 0:
        return
    for part in range(counted.collisions.shape[1]):
        if counted.collisions[w, part] > wp.int64(0):
            for i in range(latest.collisions.shape[1]):
                latest.collisions[w, i] += counted.met[w, part, i]
                counted.met[w, part, i] = 0
        tally.collisions[w] += counted.collisions[w, part]
        tally.contact_steps[w] += counted.contact_steps[w, part]
        tally.min_separation[w] = wp.min(tally.min_separation[w], counted.min_separation[w, part])
        forget_collisions(w, part, counted)


@wp.kernel
def gather_detections(first: int, clock: Clock, counted: Counted, latest: Latest):
    """Sum up what the parts of the targets counted, and forget it."""
    w = first + wp.tid()
    if clock.active[w] == 0:
        return
    for part in range(counted.waiting.shape[1]):
        for i in range(latest.detections.shape[1]):
            latest.detections[w, i] += counted.detections[w, part, i]
            counted.detections[w, part, i] = 0
        latest.waiting[w] += counted.waiting[w, part]
        latest.in_sight[w] += counted.in_sight[w, part]
        counted.waiting[w, part] = 0
        counted.in_sight[w, part] = 0


@wp.kernel
def clear_events(first: int, lanes: int, clock: Clock, latest: Latest):
    """Forget what happened in the step before."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for i in range(lane, latest.reward.shape[1], lanes):
        clear(w, i, latest)
