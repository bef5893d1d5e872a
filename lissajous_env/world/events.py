"""Events of a step: cleared at its beginning, counted by the stages, read by the reward and the score."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.world.state import Clock, StepEvents

wp.set_module_options(OPTIONS)


@wp.func
def clear(w: int, i: int, latest: StepEvents):
    """Clear the events of a robot, and with the first robot's those of its world."""
    latest.detections[w, i] = 0
    latest.collisions[w, i] = 0
    if i == 0:
        latest.in_sight[w] = 0
        latest.waiting[w] = 0
        latest.idle_ended[w] = wp.int64(0)


@wp.kernel
def reset_events(first: int, lanes: int, clock: Clock, latest: StepEvents):
    """Clear the events, rewards and ends of the episode before."""
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


@wp.kernel
def clear_events(first: int, lanes: int, clock: Clock, latest: StepEvents):
    """Clear the events of the step before."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for i in range(lane, latest.reward.shape[1], lanes):
        clear(w, i, latest)
