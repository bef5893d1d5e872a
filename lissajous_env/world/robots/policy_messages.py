"""Messages of policies: the last components of an action, which both ring neighbours receive with the phase message."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.world.state import REMOVED, WORKING, Clock, Links, Messages, Robots

wp.set_module_options(OPTIONS)


@wp.kernel
def reset_policy_messages(first: int, lanes: int, clock: Clock, messages: Messages):
    """Set every message to zeros."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for i in range(lane, messages.sending.shape[1], lanes):
        for m in range(messages.sending.shape[2]):
            messages.sending[w, i, m] = 0.0
            for slot in range(messages.sent.shape[2]):
                messages.sent[w, i, slot, m] = 0.0
            for side in range(2):
                messages.heard[w, i, side, m] = 0.0


@wp.kernel
def send_policy_messages(
    first: int, lanes: int, taken: wp.array3d(dtype=float), clock: Clock, robots: Robots, messages: Messages
):
    """Send the last components of each action; a failed robot repeats its last message, a removed one is silent."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    size = messages.sending.shape[2]
    moving = taken.shape[2] - size
    slot = clock.step[w] % messages.sent.shape[2]
    for i in range(lane, robots.status.shape[1], lanes):
        status = robots.status[w, i]
        for m in range(size):
            if status == WORKING:
                messages.sending[w, i, m] = taken[w, i, moving + m]
            elif status == REMOVED:
                messages.sending[w, i, m] = 0.0
            messages.sent[w, i, slot, m] = messages.sending[w, i, m]


@wp.kernel
def hear_policy_messages(
    first: int,
    lanes: int,
    start: int,
    neighbours: wp.array2d(dtype=int),
    clock: Clock,
    robots: Robots,
    links: Links,
    messages: Messages,
    observation_out: wp.array3d(dtype=float),
):
    """Receive a neighbour's message where its phase message arrives now, and observe the latest, from entry `start`."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    size = messages.heard.shape[3]
    slots = messages.sent.shape[2]
    sent_at = clock.step[w] - (slots - 1)
    for i in range(lane, messages.heard.shape[1], lanes):
        present = robots.status[w, i] != REMOVED
        for side in range(2):
            arrives = sent_at >= 0 and links.heard_at[w, i, side] == sent_at
            for m in range(size):
                if arrives:
                    messages.heard[w, i, side, m] = messages.sent[w, neighbours[i, side], sent_at % slots, m]
                observation_out[w, i, start + side * size + m] = wp.where(present, messages.heard[w, i, side, m], 0.0)
