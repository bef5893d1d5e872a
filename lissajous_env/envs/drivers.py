"""Policies that drive the robots of a batch in which only the rogues act."""

import os
from typing import Any

from lissajous_env.episodes.evaluation import ActingPolicy, FunctionPolicy
from lissajous_env.episodes.policies import policy
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import shown


def driver_of(robots: Any, scenario: Scenario, num_worlds: int, device: Any = "cpu") -> ActingPolicy:
    """Return the policy that drives the robots of some worlds.

    Args:
        robots: Name of a policy, or folder of a checkpoint; a policy for so many worlds; or a function
            `act(observation) -> action` on NumPy arrays (W, N, D) and (W, N, action_size).
        scenario: The scenario.
        num_worlds: W.
        device: Warp device.

    Raises:
        ValueError: the policy is unknown, or is for another number of worlds.
    """
    if isinstance(robots, (str, os.PathLike)):
        return policy(robots, scenario, num_worlds, device)
    if hasattr(robots, "act"):
        if robots.num_worlds != num_worlds:
            raise ValueError(f"robots must be driven by a policy for {num_worlds} worlds, got {robots.num_worlds}")
        return robots
    if isinstance(robots, type) or not callable(robots):
        raise ValueError(f"robots must be the name of a policy, a policy or a function, got {shown(robots)}")
    return FunctionPolicy(robots, num_worlds)
