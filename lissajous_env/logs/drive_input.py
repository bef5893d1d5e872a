"""Actions of differential drives as speeds and yaw rates, and the way back, for whole logs."""

import numpy as np

from lissajous_env.settings.robot import Robot

DRIVE_INPUTS = ("speed", "yaw rate")
"""Names of the commands [m/s], [rad/s], which are those of the action's components."""


def twists_of(robot: Robot, actions: np.ndarray) -> np.ndarray:
    """Return speeds [m/s] and yaw rates [rad/s] (..., 2) of actions (..., 2)."""
    end = np.where(actions[..., 0] < 0, -robot.lowest_speed, robot.top_speed)
    return np.stack([actions[..., 0] * end, actions[..., 1] * robot.top_yaw_rate], axis=-1)


def actions_of_twists(robot: Robot, twists: np.ndarray) -> np.ndarray:
    """Return the actions (..., 2) in [-1, 1] of speeds and yaw rates (..., 2), clipped to what a drive can do."""
    end = np.where(twists[..., 0] < 0, -robot.lowest_speed, robot.top_speed)
    speed = np.divide(twists[..., 0], end, out=np.zeros(end.shape), where=end > 0)
    return np.clip(np.stack([speed, twists[..., 1] / robot.top_yaw_rate], axis=-1), -1.0, 1.0)
