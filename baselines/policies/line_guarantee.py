"""Worst-case undetected time of ideal lines abreast: a computation in one dimension, along the sweep."""

import math

import numpy as np

from baselines.policies.line_path import LinePlan, line_path, rogue_speed, spacing_of
from lissajous_env.parameters.scenario import Scenario

_CELLS = 540
_PERIODS = 3


def ideal_guarantee(scenario: Scenario, plan: LinePlan, formed: int) -> float:
    """Return the worst-case undetected time [s] of lines that follow their path without error.

    A line that fulfils the spacing law is a barrier: it senses a band of half a width h = sqrt(r^2 - (s / 2)^2) from
    wall to wall. So a rogue is, at worst, as far along as its speed allows between two barriers, and the field of
    `lissajous_env.world.contamination` has one dimension: e, the earliest introduction of an undetected rogue at each
    place along. Lines count as barriers while they are straight and reach from wall to wall, in a turn they do not.

    Args:
        scenario: The scenario; its sensing radius and the speed of its rogues count.
        plan: The lines.
        formed: Steps from the start until the lines have formed; nothing is sensed before.
    """
    speed = rogue_speed(scenario)
    spacing = spacing_of(scenario, int(plan.line_of.max()) + 1)
    half_band = math.sqrt(max(scenario.sensing_radius**2 - (spacing / 2) ** 2, 0.0))
    path = line_path(plan)
    straight = np.abs(path[:, 1]) < 1e-6 * plan.half_span
    spans = (path[:, 3] == 1) & (straight | (np.abs(path[:, 0]) >= plan.half_length))
    cell = 2 * plan.half_length / _CELLS
    places = (np.arange(_CELLS) + 0.5) * cell - plan.half_length
    starts = np.unique(plan.starts)
    introduced = np.zeros(_CELLS)
    worst, moved = 0, 0.0
    for now in range(formed + _PERIODS * plan.period):
        moved += speed * plan.step / cell
        for _ in range(int(moved)):
            wide = np.pad(introduced, 1, constant_values=np.inf)
            introduced = np.minimum(np.minimum(wide[:-2], wide[2:]), introduced)
        moved -= int(moved)
        if scenario.targets.arrival_rate > 0:
            introduced = np.minimum(introduced, now)
        if now >= formed:
            at = (starts + now - formed) % plan.period
            for k in at[spans[at]]:
                before = path[k - 1, 0] if spans[k - 1] and now > formed else path[k, 0]
                low, high = min(before, path[k, 0]), max(before, path[k, 0])
                introduced[(places >= low - half_band) & (places <= high + half_band)] = np.inf
        oldest = introduced.min()
        worst = max(worst, now - oldest if np.isfinite(oldest) else 0)
    return worst * plan.step
