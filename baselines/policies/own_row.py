"""The entries of a robot's observation row, decoded in kernels for the classical policies."""

import warp as wp

from lissajous_env.device import randomness
from lissajous_env.device.curve import CurveStruct
from lissajous_env.world.observation import LINK, OWN, ROBOT

Observation = wp.array3d(dtype=float)
"""(W, N, D) observation rows of W worlds of N robots."""
Actions = wp.array3d(dtype=float)
"""(W, N, A) actions of the robots, in [-1, 1]."""

# Places of the entries, by their names in `lissajous_env.world.observation.layout`.
X, Y = wp.constant(0), wp.constant(1)
COS_HEADING, SIN_HEADING = wp.constant(2), wp.constant(3)
SPEED = wp.constant(4)
COS_PHASE, SIN_PHASE = wp.constant(5), wp.constant(6)
WORKS = wp.constant(7)
# Within the entries of a ring neighbour.
HEARD, AGE = wp.constant(0), wp.constant(1)
COS_LEAD, SIN_LEAD = wp.constant(2), wp.constant(3)
X_AWAY, Y_AWAY = wp.constant(4), wp.constant(5)
# Within the entries of a robot in the disc.
PRESENT = wp.constant(0)
X_SEEN, Y_SEEN = wp.constant(1), wp.constant(2)
X_VELOCITY, Y_VELOCITY = wp.constant(3), wp.constant(4)


@wp.func
def own_position(w: int, i: int, curve: CurveStruct, observation: Observation) -> wp.vec2:
    """Return the measured x, y [m]."""
    return wp.vec2(observation[w, i, X] * curve.half_width, observation[w, i, Y] * curve.half_height)


@wp.func
def own_heading(w: int, i: int, observation: Observation) -> float:
    """Return the measured heading [rad]."""
    return wp.atan2(observation[w, i, SIN_HEADING], observation[w, i, COS_HEADING])


@wp.func
def own_speed(w: int, i: int, speed_unit: float, observation: Observation) -> float:
    """Return the measured speed [m/s]; `speed_unit` is the top speed of a car [m/s]."""
    return observation[w, i, SPEED] * speed_unit


@wp.func
def own_phase(w: int, i: int, observation: Observation) -> float:
    """Return the measured phase theta in [-pi, pi] [rad]."""
    return wp.atan2(observation[w, i, SIN_PHASE], observation[w, i, COS_PHASE])


@wp.func
def own_works(w: int, i: int, observation: Observation) -> bool:
    """Return whether the robot itself works."""
    return observation[w, i, WORKS] > 0.5


@wp.func
def own_key(w: int, i: int, observation: Observation) -> int:
    """Return the key of a robot's random draws, computed from its position: the same in any batch, at any index."""
    x = int(observation[w, i, X] * 1.0e6)
    y = int(observation[w, i, Y] * 1.0e6)
    return randomness.step_key(x, y)


@wp.func
def has_heard(w: int, i: int, observation: Observation) -> bool:
    """Return whether the row contains a message of a ring neighbour, of any age; that of a removed robot has none."""
    return observation[w, i, OWN + HEARD] > 0.5 or observation[w, i, OWN + LINK + HEARD] > 0.5


@wp.func
def hears(w: int, i: int, side: int, observation: Observation) -> bool:
    """Return whether a recent enough message from a ring neighbour is known."""
    start = OWN + LINK * side
    return observation[w, i, start + HEARD] > 0.5 and observation[w, i, start + AGE] < 1.0


@wp.func
def message_age(w: int, i: int, side: int, unit: float, observation: Observation) -> float:
    """Return the time since a ring neighbour sent its message [s]; `unit` is `Scenario.time_unit` [s]."""
    return observation[w, i, OWN + LINK * side + AGE] * unit


@wp.func
def lead(w: int, i: int, side: int, observation: Observation) -> float:
    """Return the phase of a ring neighbour relative to the robot's own, theta_j - theta_i in [-pi, pi] [rad]."""
    start = OWN + LINK * side
    return wp.atan2(observation[w, i, start + SIN_LEAD], observation[w, i, start + COS_LEAD])


@wp.func
def sine_ahead(w: int, i: int, side: int, rate: float, unit: float, observation: Observation) -> float:
    """Return sin(theta_j - theta_i) of a ring neighbour, its phase extrapolated at `rate` [rad/s] since it was sent.

    Zero for a neighbour that was never heard, or too long ago; `unit` is `Scenario.time_unit` [s].
    """
    if not hears(w, i, side, observation):
        return 0.0
    start = OWN + LINK * side
    ahead = rate * message_age(w, i, side, unit, observation)
    return observation[w, i, start + SIN_LEAD] * wp.cos(ahead) + observation[w, i, start + COS_LEAD] * wp.sin(ahead)


@wp.func
def offset_heard(w: int, i: int, side: int, curve: CurveStruct, observation: Observation) -> wp.vec2:
    """Return the place that a ring neighbour sent, relative to the robot's own x, y [m]."""
    start = OWN + LINK * side
    x = 2.0 * curve.half_width * observation[w, i, start + X_AWAY]
    y = 2.0 * curve.half_height * observation[w, i, start + Y_AWAY]
    return wp.vec2(x, y)


@wp.func
def message_heard(w: int, i: int, side: int, m: int, start: int, size: int, observation: Observation) -> float:
    """Return component `m` of a ring neighbour's last message of `size` numbers; 0 if none was received.

    `start` is `lissajous_env.world.observation.message_start` of the scenario.
    """
    return observation[w, i, start + size * side + m]


@wp.func
def sees(w: int, i: int, k: int, observation: Observation) -> bool:
    """Return whether there is a k-th nearest robot in the sensing disc."""
    return observation[w, i, OWN + 2 * LINK + ROBOT * k + PRESENT] > 0.5


@wp.func
def offset_seen(w: int, i: int, k: int, radius: float, observation: Observation) -> wp.vec2:
    """Return the place of the k-th nearest robot in the disc, of `radius` [m], relative to the robot's own x, y [m]."""
    start = OWN + 2 * LINK + ROBOT * k
    return wp.vec2(radius * observation[w, i, start + X_SEEN], radius * observation[w, i, start + Y_SEEN])


@wp.func
def velocity_seen(w: int, i: int, k: int, speed_unit: float, observation: Observation) -> wp.vec2:
    """Return the relative velocity of the k-th nearest robot in the disc [m/s]; `speed_unit` as for `own_speed`."""
    start = OWN + 2 * LINK + ROBOT * k
    relative = wp.vec2(observation[w, i, start + X_VELOCITY], observation[w, i, start + Y_VELOCITY])
    return relative * (2.0 * speed_unit)
