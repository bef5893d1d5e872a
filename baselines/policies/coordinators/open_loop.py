"""Borkar et al. [14]: the velocity profile of the curve, with no reaction to the other robots.

A. V. Borkar, A. Sinha, L. Vachhani, H. Arya, "Application of Lissajous curves in trajectory planning of multiple
agents", Autonomous Robots 44 (2020). Every robot goes along the curve with gamma' = omega, so its speed is the profile
V(gamma) = omega ||r'(gamma)||. It assumes that the robots start in the formation and that nothing disturbs them.
"""

from typing import Any

import warp as wp

from lissajous_env.parameters.scenario import Scenario


class OpenLoop:
    """Coordinator: the phase rate of every robot is omega / alpha."""

    communicates = "nothing"

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any):
        shape = (num_worlds, scenario.num_robots)
        rate = scenario.formation.phase_rate / scenario.alpha
        self.phase_rate = wp.full(shape, rate, dtype=wp.float32, device=device)

    def coordinate(self, observation: wp.array) -> None:
        """Leave `phase_rate` as it is."""
