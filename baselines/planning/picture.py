"""A picture of plans: the paths of the robots, the sensing discs at the end, and the figures."""

from collections.abc import Sequence
from itertools import cycle

import numpy as np
from matplotlib.patches import Circle

from baselines.planning.plans import Planned
from baselines.planning.playing import quietly
from baselines.planning.tables import worst_in_words
from baselines.reproduce.drawing import GREY, SERIES, Sheet
from lissajous_env.world.simulation import Simulation

MOST = 3
"""Plans in a picture."""
_SHARE = 0.3
"""Share of an episode whose paths are drawn, its end."""


def draw(plans: Sequence[Planned], seed: int) -> bytes:
    """Return a PNG of the first plans: the first episode of each."""
    shown = plans[:MOST]
    with Sheet("plans", "The best plans", 3.4 * max(len(shown), 1) + 0.6, 3.1) as sheet:
        for k, each in enumerate(shown):
            axes = sheet.figure.add_subplot(1, len(shown), k + 1)
            _draw_plan(axes, each, seed)
            words = f"worst case in {len(each.rows)} episodes [s]: {worst_in_words(each.figures.worst_case, each.rows)}"
            axes.set_title(f"{k + 1}: {each.plan.settings.policy}\n{words}", fontsize=8)
        return sheet.picture(
            "Paths of the robots in the last third of an episode; discs: bodies and sensing ranges at its end."
        ).content


def _draw_plan(axes, each: Planned, seed: int) -> None:
    scenario = each.plan.scenario
    path = _paths(each, seed)
    A, B = scenario.curve.half_width, scenario.curve.half_height
    axes.plot([-A, A, A, -A, -A], [-B, -B, B, B, -B], color=GREY, lw=0.8)
    for robot, colour in zip(range(scenario.num_robots), cycle(SERIES)):
        axes.plot(*path[:, robot].T, color=colour, lw=1)
        at = tuple(path[-1, robot])
        axes.add_patch(Circle(at, scenario.sensing_radius, color=colour, alpha=0.12, lw=0))
        axes.add_patch(Circle(at, scenario.robot.radius, color=colour))
    axes.set_aspect("equal")
    axes.set_xlim(-1.05 * A, 1.05 * A)
    axes.set_ylim(-1.08 * B, 1.08 * B)
    axes.set_axis_off()


def _paths(each: Planned, seed: int) -> np.ndarray:
    """Return the positions (steps, N, 2) of the robots in the last part of the first episode [m]."""
    scenario = each.plan.scenario
    with quietly():
        policy, simulation = each.plan.settings.make(scenario), Simulation(scenario, seed=seed, threads=1)
    steps = scenario.task.steps
    first = steps - max(round(_SHARE * steps), 1)
    found = []
    for step in range(steps):
        simulation.step(policy.act(simulation.observation))
        if step >= first:
            found.append(simulation.robots.position.numpy()[0, :, :2].copy())
    return np.array(found)
