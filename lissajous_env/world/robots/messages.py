"""Messages on the ring: robots send their measured phase and position, and receive those of their two neighbours.

Policies may add a message of their own, the last components of an action, which arrives with the phase message.
"""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.part_structs import NoiseStruct
from lissajous_env.device.stage import ROBOT, stage
from lissajous_env.world.state import REMOVED, WORKING, Clock, Links, Messages, Robots

wp.set_module_options(OPTIONS)


@stage(ROBOT, writes="links: sending, sent")
def send(w: int, lane: int, lanes: int, clock: Clock, robots: Robots, links: Links):
    """Send measured phase and position to both neighbours; a removed robot sends nothing."""
    slot = clock.step[w] % links.sent.shape[2]
    for i in range(lane, robots.status.shape[1], lanes):
        links.sending[w, i, slot] = wp.where(robots.status[w, i] == REMOVED, 0, 1)
        pose = robots.measured[w, i]
        turn = robots.measured_turn[w, i]
        links.sent[w, i, slot] = wp.vec4(turn[0], turn[1], pose[0], pose[1])


@stage(ROBOT, writes="links: heard, heard_at")
def hear(
    w: int, lane: int, lanes: int, noise: NoiseStruct, neighbours: wp.array2d(dtype=int), clock: Clock, links: Links
):
    """Receive the neighbours' messages that arrive now, unless they are lost."""
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


@stage(ROBOT, writes="messages: sending, sent")
def send_policy_messages(
    w: int, i: int, taken: wp.array3d(dtype=float), clock: Clock, robots: Robots, messages: Messages
):
    """Send the last components of each action; a failed robot repeats its last message, a removed one is silent."""
    size = messages.sending.shape[2]
    moving = taken.shape[2] - size
    slot = clock.step[w] % messages.sent.shape[2]
    status = robots.status[w, i]
    for m in range(size):
        if status == WORKING:
            messages.sending[w, i, m] = taken[w, i, moving + m]
        elif status == REMOVED:
            messages.sending[w, i, m] = 0.0
        messages.sent[w, i, slot, m] = messages.sending[w, i, m]


@stage(ROBOT, writes="messages: heard; observation_out")
def hear_policy_messages(
    w: int,
    i: int,
    start: int,
    neighbours: wp.array2d(dtype=int),
    clock: Clock,
    robots: Robots,
    links: Links,
    messages: Messages,
    observation_out: wp.array3d(dtype=float),
):
    """Receive a neighbour's message where its phase message arrives now, and observe the latest, from entry `start`."""
    size = messages.heard.shape[3]
    slots = messages.sent.shape[2]
    sent_at = clock.step[w] - (slots - 1)
    present = robots.status[w, i] != REMOVED
    for side in range(2):
        arrives = sent_at >= 0 and links.heard_at[w, i, side] == sent_at
        for m in range(size):
            if arrives:
                messages.heard[w, i, side, m] = messages.sent[w, neighbours[i, side], sent_at % slots, m]
            observation_out[w, i, start + side * size + m] = wp.where(present, messages.heard[w, i, side, m], 0.0)
