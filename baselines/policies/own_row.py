"""What a robot reads from its observation row, for the classical policies."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.world.observation import LINK, OWN

wp.set_module_options(OPTIONS)


@wp.func
def own_position(w: int, i: int, curve: CurveStruct, observation: wp.array3d(dtype=float)) -> wp.vec2:
    """Measured x, y [m]."""
    return wp.vec2(observation[w, i, 0] * curve.half_width, observation[w, i, 1] * curve.half_height)


@wp.func
def own_heading(w: int, i: int, observation: wp.array3d(dtype=float)) -> float:
    """Measured heading [rad]."""
    return wp.atan2(observation[w, i, 3], observation[w, i, 2])


@wp.func
def own_phase(w: int, i: int, observation: wp.array3d(dtype=float)) -> float:
    """Measured phase theta in [-pi, pi] [rad]."""
    return wp.atan2(observation[w, i, 6], observation[w, i, 5])


@wp.func
def own_works(w: int, i: int, observation: wp.array3d(dtype=float)) -> bool:
    """Whether the robot itself works."""
    return observation[w, i, 7] > 0.5


@wp.func
def hears(w: int, i: int, side: int, observation: wp.array3d(dtype=float)) -> bool:
    """Whether a message that a ring neighbour sent within the last second is known."""
    start = OWN + LINK * side
    return observation[w, i, start] > 0.5 and observation[w, i, start + 1] < 1.0


@wp.func
def message_age(w: int, i: int, side: int, observation: wp.array3d(dtype=float)) -> float:
    """Time since a ring neighbour sent its message [s]."""
    return observation[w, i, OWN + LINK * side + 1]


@wp.func
def lead(w: int, i: int, side: int, observation: wp.array3d(dtype=float)) -> float:
    """Phase that a ring neighbour sent less one's own, theta_j - theta_i in [-pi, pi] [rad]."""
    start = OWN + LINK * side
    return wp.atan2(observation[w, i, start + 3], observation[w, i, start + 2])


@wp.func
def sine_ahead(w: int, i: int, side: int, rate: float, observation: wp.array3d(dtype=float)) -> float:
    """sin(theta_j - theta_i) of a ring neighbour, its phase carried on at `rate` [rad/s] since it was sent.

    Zero for a neighbour that was never heard, or not within the last second.
    """
    if not hears(w, i, side, observation):
        return 0.0
    start = OWN + LINK * side
    ahead = rate * message_age(w, i, side, observation)
    return observation[w, i, start + 3] * wp.cos(ahead) + observation[w, i, start + 2] * wp.sin(ahead)
