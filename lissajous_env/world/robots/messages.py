"""Messages on the ring: robots send their measured phase and position, and receive those of their two neighbours."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.part_structs import NoiseStruct
from lissajous_env.world.state import REMOVED, Clock, Links, Robots

wp.set_module_options(OPTIONS)


@wp.kernel
def reset_messages(first: int, lanes: int, clock: Clock, links: Links):
    """Clear every message."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    for i in range(lane, links.sending.shape[1], lanes):
        for slot in range(links.sending.shape[2]):
            links.sending[w, i, slot] = 0
        for side in range(2):
            links.heard_at[w, i, side] = -1


@wp.kernel
def send(first: int, lanes: int, clock: Clock, robots: Robots, links: Links):
    """Send measured phase and position to both neighbours; a removed robot sends nothing."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    slot = clock.step[w] % links.sent.shape[2]
    for i in range(lane, robots.status.shape[1], lanes):
        links.sending[w, i, slot] = wp.where(robots.status[w, i] == REMOVED, 0, 1)
        pose = robots.measured[w, i]
        turn = robots.measured_turn[w, i]
        links.sent[w, i, slot] = wp.vec4(turn[0], turn[1], pose[0], pose[1])


@wp.kernel
def hear(first: int, lanes: int, noise: NoiseStruct, neighbours: wp.array2d(dtype=int), clock: Clock, links: Links):
    """Receive the neighbours' messages that arrive now, unless they are lost."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    now = clock.step[w]
    slots = links.sent.shape[2]
    sent_at = now - (slots - 1)
    if sent_at < 0:
        return
    slot = sent_at % slots
    key = randomness.step_key(clock.seed[w], now)
    for i in range(lane, links.sending.shape[1], lanes):
        for side in range(2):
            j = neighbours[i, side]
            arrives = j >= 0
            if arrives:
                arrives = links.sending[w, j, slot] == 1
            if arrives and noise.message_loss > 0.0:
                arrives = randomness.uniform(key, 2 * i + side, randomness.MESSAGE) >= noise.message_loss
            if arrives:
                links.heard[w, i, side] = links.sent[w, j, slot]
                links.heard_at[w, i, side] = sent_at
