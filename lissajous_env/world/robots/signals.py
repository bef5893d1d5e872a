"""Signals of robots: limits and noise of their actions, their phases, measurements of themselves, and messages.

On the ring, robots send their measured phase and position, and receive those of their two neighbours. Policies may add
a message of their own, the last components of an action, which arrives with the phase message.
"""

import numpy as np
import warp as wp

from lissajous_env.device import abreast, randomness
from lissajous_env.device.abreast import Floats
from lissajous_env.device.compilation import MOTION
from lissajous_env.device.curve import curve_parameter, project, project_lissajous, wrap_phase
from lissajous_env.device.stage import ROBOT, part, stage
from lissajous_env.device.trig import cos_sin
from lissajous_env.world.robots.faults import is_coasting
from lissajous_env.world.state import NOWHERE, REMOVED, WORKING

wp.set_module_options(MOTION)

LARGEST_CORRECTION = wp.constant(0.1)
"""Limit of a correction of a robot's parameter on the curve [rad]: it may slide along its branch, not jump."""
_LARGEST = wp.constant(float(np.finfo(np.float32).max))
"""Largest number of float32; NaN and infinity are not at most as large."""


@part
def flag_invalid(w, clock):
    """Flag a world that received an action that is not finite."""
    clock.invalid[w] = 1
    if clock.invalid_at[w] == 0:
        clock.invalid_at[w] = clock.step[w]


@part
def disturb_command(w, i, noise, clock, command):
    """Add noise to the commands of a robot."""
    draw = randomness.stream(randomness.step_key(clock.seed[w], clock.step[w]), i, randomness.ACTUATOR)
    for entry in range(command.shape[2]):
        command[w, i, entry] = wp.clamp(command[w, i, entry] + noise.actuator * wp.randn(draw), -1.0, 1.0)


@stage(ROBOT, writes="clock: invalid, invalid_at; command; latest: change, effort; limited_action")
def limit_actions(block, noise, action, clock, robots, latest, limited_action, command):
    """Limit the actions to [-1, 1], and add noise to the commands in them; compute their effort and change.

    An action that is not finite is replaced by zero, and its world flagged. The last components of an action are a
    message, to which neither noise nor effort applies. `limited_action` has commands, without noise, and message.
    Actions of robots that do not work have no effort and no change, because they have no effect.
    """
    n = action.shape[1]
    size = command.shape[2]
    invalid = Floats()
    for entry in range(action.shape[2]):
        given = abreast.entries(block, action, entry)
        for k in range(abreast.ABREAST):
            if k < abreast.width():
                invalid[k] = wp.where(wp.abs(given[k]) <= _LARGEST, invalid[k], 1.0)
    has_earlier = abreast.where_world(block, n, clock.step, 2)
    squares = Floats()
    change = Floats()
    for entry in range(action.shape[2]):
        limited = abreast.entries(block, action, entry)
        before = abreast.entries(block, limited_action, entry)
        counts = wp.where(entry < size, 1.0, 0.0)
        for k in range(abreast.ABREAST):
            if k < abreast.width():
                limited[k] = wp.where(invalid[k] == 0.0, wp.clamp(limited[k], -1.0, 1.0), 0.0)
                difference = limited[k] - before[k]
                squares[k] += counts * limited[k] * limited[k]
                change[k] += counts * difference * difference
        abreast.put_entries(block, block.active_mask, limited, entry, limited_action)
        if entry < size:
            abreast.put_entries(block, block.active_mask, limited, entry, command)
    working = abreast.where_equal(block, robots.status, WORKING)
    for k in range(abreast.ABREAST):
        if k < abreast.width():
            squares[k] = wp.where(abreast.is_in(k, working), squares[k] / float(size), 0.0)
            change[k] = wp.where(abreast.is_in(k, has_earlier & working), change[k] / float(size), 0.0)
    abreast.put_floats(block, block.active_mask, squares, latest.effort)
    abreast.put_floats(block, block.active_mask, change, latest.change)
    flagged = block.active_mask & abreast.where_above(block, invalid, 0.0)
    if flagged != 0:
        for k in range(block.count):
            if abreast.is_in(k, flagged):
                flag_invalid((block.start + k) / n, clock)
    if noise.actuator > 0.0:
        for k in range(block.count):
            if abreast.is_in(k, block.active_mask):
                disturb_command((block.start + k) / n, (block.start + k) % n, noise, clock, command)


@stage(ROBOT, writes="robots: phase")
def follow_curve(block, curve, formation, faults, clock, robots):
    """Update the phase of each robot that is not bound to the curve: that of the nearest point on its branch."""
    alpha = float(formation.alpha)
    x = abreast.coordinates(block, robots.position, 0)
    y = abreast.coordinates(block, robots.position, 1)
    phase = abreast.doubles(block, robots.phase)
    if curve.harmonics.shape[0] == 0:
        for k in range(abreast.ABREAST):
            if k < abreast.width():
                start = curve_parameter(alpha, phase[k])
                gamma = project_lissajous(curve, x[k], y[k], start, LARGEST_CORRECTION)
                phase[k] = wrap_phase(phase[k] + wp.float64((gamma - start) / alpha))
    else:
        for k in range(block.count):
            start = curve_parameter(alpha, phase[k])
            gamma = project(curve, wp.vec2(x[k], y[k]), start, LARGEST_CORRECTION)
            phase[k] = wrap_phase(phase[k] + wp.float64((gamma - start) / alpha))
    moving = abreast.where_equal(block, robots.status, WORKING) | is_coasting(block, faults, robots)
    abreast.put_doubles(block, block.active_mask & moving, phase, robots.phase)


@part
def disturb_pose(
    draw: wp.uint32, alpha: float, curve, noise, pose: wp.vec4, phase: wp.float64
) -> tuple[wp.vec4, wp.float64]:
    """Return a pose (x, y [m], heading [rad], speed [m/s]) with noise, and the phase [rad] that it has then."""
    pose[0] += noise.position * wp.randn(draw)
    pose[1] += noise.position * wp.randn(draw)
    pose[2] += noise.heading * wp.randn(draw)
    pose[3] += noise.speed * wp.randn(draw)
    gamma = curve_parameter(alpha, phase)
    measured = project(curve, wp.vec2(pose[0], pose[1]), gamma, LARGEST_CORRECTION)
    return pose, wrap_phase(phase + wp.float64((measured - gamma) / alpha))


@stage(ROBOT, writes="latest: sensed; robots: measured, measured_turn, sensor")
def measure(block, curve, formation, noise, clock, robots, latest):
    """Measure each robot's pose and phase, and place its sensor; measurements of a removed robot are frozen."""
    n = robots.status.shape[1]
    alpha = float(formation.alpha)
    x = abreast.coordinates(block, robots.position, 0)
    y = abreast.coordinates(block, robots.position, 1)
    phase = abreast.doubles(block, robots.phase)
    heading = abreast.floats(block, robots.heading)
    speed = abreast.floats(block, robots.speed)
    working = block.active_mask & abreast.where_equal(block, robots.status, WORKING)
    sensor_x = Floats()
    sensor_y = Floats()
    for k in range(abreast.ABREAST):
        if k < abreast.width():
            senses = abreast.is_in(k, working)
            sensor_x[k] = wp.where(senses, x[k], NOWHERE)
            sensor_y[k] = wp.where(senses, y[k], NOWHERE)
    abreast.put_pairs(block, block.active_mask, sensor_x, sensor_y, robots.sensor)
    abreast.put_bits(block, block.active_mask, working, latest.sensed)
    measuring = block.active_mask & ~(
        abreast.where_equal(block, robots.status, REMOVED) & abreast.where_world(block, n, clock.step, 1)
    )
    if noise.position > 0.0 or noise.heading > 0.0 or noise.speed > 0.0:
        for k in range(block.count):
            if abreast.is_in(k, measuring):
                w = (block.start + k) / n
                key = randomness.step_key(clock.seed[w], clock.step[w])
                draw = randomness.stream(key, (block.start + k) % n, randomness.MEASURE)
                pose, measured_phase = disturb_pose(
                    draw, alpha, curve, noise, wp.vec4(x[k], y[k], heading[k], speed[k]), phase[k]
                )
                x[k] = pose[0]
                y[k] = pose[1]
                heading[k] = pose[2]
                speed[k] = pose[3]
                phase[k] = measured_phase
    cos_phase = Floats()
    sin_phase = Floats()
    cos_heading = Floats()
    sin_heading = Floats()
    for k in range(abreast.ABREAST):
        if k < abreast.width():
            turn = cos_sin(float(phase[k]))
            cos_phase[k] = turn[0]
            sin_phase[k] = turn[1]
            faces = cos_sin(heading[k])
            cos_heading[k] = faces[0]
            sin_heading[k] = faces[1]
    abreast.put_fours(block, measuring, x, y, heading, speed, robots.measured)
    abreast.put_fours(block, measuring, cos_phase, sin_phase, cos_heading, sin_heading, robots.measured_turn)


@stage(ROBOT, writes="links: sending, sent")
def send(w, lane, lanes, clock, robots, links):
    """Send the measured phase and position to both ring neighbours; a removed robot sends nothing."""
    slot = clock.step[w] % links.sent.shape[2]
    for i in range(lane, robots.status.shape[1], lanes):
        links.sending[w, i, slot] = wp.where(robots.status[w, i] == REMOVED, 0, 1)
        pose = robots.measured[w, i]
        turn = robots.measured_turn[w, i]
        links.sent[w, i, slot] = wp.vec4(turn[0], turn[1], pose[0], pose[1])


@stage(ROBOT, writes="messages: sending, sent")
def send_messages(w, i, limited_action, clock, robots, messages):
    """Send a policy's message, the last components of its action; a failed robot repeats its last one.

    It is a stage of its own because the loop over the components would cost `send` a third more time without any.
    """
    size = messages.sending.shape[2]
    status = robots.status[w, i]
    for m in range(size):
        if status == REMOVED:
            messages.sending[w, i, m] = 0.0
        elif status == WORKING and clock.step[w] > 0:
            messages.sending[w, i, m] = limited_action[w, i, limited_action.shape[2] - size + m]
        messages.sent[w, i, clock.step[w] % messages.sent.shape[2], m] = messages.sending[w, i, m]


@stage(ROBOT, writes="links: heard, heard_at")
def hear(w, lane, lanes, noise, neighbours, clock, links):
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


@stage(ROBOT, writes="messages: heard")
def hear_messages(w, i, neighbours, clock, links, messages):
    """Receive the messages of policies, which arrive with the phase messages."""
    slots = links.sent.shape[2]
    sent_at = clock.step[w] - (slots - 1)
    for side in range(2):
        if sent_at >= 0 and links.heard_at[w, i, side] == sent_at:
            for m in range(messages.heard.shape[3]):
                messages.heard[w, i, side, m] = messages.sent[w, neighbours[i, side], sent_at % slots, m]
