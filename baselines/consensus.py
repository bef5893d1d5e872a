"""Yao et al. [16], the coordination: linear consensus on the path parameter, with the spacing given.
"""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env.compilation import OPTIONS
from lissajous_env.curve import wrap
from lissajous_env.observation import LINK, OWN
from lissajous_env.scenario import Scenario

wp.set_module_options(OPTIONS)


@wp.func
def hears(w: int, i: int, side: int, observation: wp.array3d(dtype=float)) -> bool:
    """Whether a ring neighbour was heard within the last second."""
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
