"""Policies inside walls: `python benchmarks/walls.py --store`, and with `--kind differential` those of drives.

Each policy of a scenario is played with `task.boundary = wall`. A cell shows the longest worst-case undetected time of
all seeds where there are rogues, `>` if it was still growing at the end of one of them, and the collisions per episode.
What this program counts itself from the positions of the robots is added if there is any: contacts with a wall per
episode (a body comes within `NEAR` of a wall), and robots that stand at one when the episode ends, having moved less
than their radius in the last `WHILE`.
"""

import warnings
from typing import Any

import figures
import numpy as np

import baselines
import lissajous_env
from baselines.policies.base import UnsuitableScenarioError
from lissajous_env import Scenario, Simulation
from lissajous_env.episodes.evaluation import episodes
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.world.columns import COLLISIONS, OPEN, WORST_CASE
from lissajous_env.world.state import WORKING

SCENARIOS = "evaders", "intruders", "hall", "experiment", "rough"
FILTERED = "kuramoto-mpcc", "partition", "line-abreast", "sweep", "random"
"""Policies that are also played with each filter."""
LEFT_OUT = "still", "periodic-paths", "portfolio", "portfolio-guarantee"
NEAR = 1e-4
"""Distance of a body from a wall that counts as a contact [m]."""
WHILE = 5.0
"""Time in which a robot that is not stuck moves by its radius [s]."""


class Contacts:
    """Contacts of working robots with walls in one batch of episodes, counted after each step."""

    def __init__(self, scenario: Scenario, worlds: int):
        curve, radius = scenario.curve, scenario.robot.radius
        self.radius, self.window = radius, max(round(WHILE / scenario.task.step), 1)
        self.room = np.array([curve.half_width, curve.half_height]) - radius
        self.touches = np.zeros((worlds, scenario.num_robots), dtype=bool)
        self.count, self.standing = np.zeros(worlds), np.zeros(worlds)
        self._places: list[np.ndarray] = []

    def update(self, simulation: Simulation) -> None:
        """Count what began in the latest step."""
        place = simulation.robots.position.numpy()[:, :, :2].copy()
        works = simulation.robots.status.numpy() == WORKING
        now = ((self.room - np.abs(place)).min(axis=2) < NEAR) & works
        self.count += (now & ~self.touches).sum(axis=1)
        self.touches = now
        self._places = [*self._places[-self.window :], place]
        moved = np.linalg.norm(place - self._places[0], axis=2)
        self.standing = (now & (moved < self.radius)).sum(axis=1)


def cell_of(name: str, scenario: Scenario, seeds: range) -> str:
    """Return the content of a cell: the score of a policy in a scenario with walls."""
    contacts = Contacts(scenario, len(seeds))
    policy = baselines.make(name, scenario, len(seeds))
    rows: list[dict[str, Any]] = next(iter(episodes(policy, scenario, seeds, on_step=contacts.update)))
    parts = []
    if not np.isnan(worst := max(row[WORST_CASE.name] for row in rows)):
        parts.append(f"{'> ' if any(row[OPEN.name] for row in rows) else ''}{worst:.3g} s")
    collisions = np.mean([row[COLLISIONS.name] for row in rows])
    parts.append(f"{collisions:.2g} collisions" if collisions < 99.5 else f"{collisions:.0f} collisions")
    if contacts.count.any():
        parts.append(f"{contacts.count.mean():.2g} contacts")
    if contacts.standing.any():
        parts.append(f"{contacts.standing.mean():.2g} stuck")
    return ", ".join(parts)


def policies_of(scenario: Scenario) -> list[str]:
    """Return the included policies that are played in a scenario, with the filters of some of them."""
    every = baselines.names(scenario)
    plain = [name for name in every if not name.endswith(("-safe", "-proved")) and name not in LEFT_OUT]
    filtered = [name + suffix for name in FILTERED for suffix in ("-safe", "-proved")]
    return [*plain, *(name for name in filtered if name in every)]


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--scenarios", nargs="*", default=list(SCENARIOS), help="names")
    parser.add_argument("--policies", nargs="*", help="names; by default all of a scenario")
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--seed", type=int, default=30_000)
    parser.add_argument("--kind", default="car", help="car, or differential, which is stored as a table of its own")
    parser.add_argument("--start", help="formation.start, if not that of the scenario, for a table of its own")
    parser.add_argument("--boundary", default="wall", help="wall, or open for comparison")
    options = parser.parse_args()
    warnings.simplefilter("ignore", AssumptionWarning)
    seeds = range(options.seed, options.seed + options.episodes)
    cells: dict[str, dict[str, str]] = {}
    for name in options.scenarios:
        fields = {"task.boundary": options.boundary, "robot.kind": options.kind, "formation.start": options.start}
        scenario = lissajous_env.scenario(name, **{field: value for field, value in fields.items() if value})
        for policy in options.policies or policies_of(scenario):
            try:
                cell = cell_of(policy, scenario, seeds)
            except UnsuitableScenarioError:
                cell = "refused"
            cells.setdefault(policy, {})[name] = cell
            print(name, policy, cell, sep="\t", flush=True)
    rows = [[f"`{policy}`", *(row.get(name, "") for name in options.scenarios)] for policy, row in cells.items()]
    table = {"columns": ["policy", *(f"`{name}`" for name in options.scenarios)], "rows": rows}
    parts = ["walls", "drives" if options.kind == "differential" else "", options.start]
    table_name = "-".join(filter(None, parts))
    figures.publish(table_name, f"{options.boundary}, {len(seeds)} episodes each", table, options.store)


if __name__ == "__main__":
    main()
