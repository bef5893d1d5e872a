"""Policies inside walls: `python benchmarks/walls.py --store`.

Each policy of a scenario is played with `task.boundary = wall`. A row shows the longest worst-case undetected time of
all seeds, `>` if it was still growing at the end of one of them, the collisions per episode, and what this program
counts itself from the positions of the robots: contacts with a wall per episode (a body comes within `NEAR` of a wall),
and robots that stand at one when the episode ends, having moved less than their radius in the last `WHILE`.
"""

import warnings
from typing import Any

import figures
import numpy as np

import baselines
import lissajous_env
from lissajous_env import Scenario, Simulation
from lissajous_env.episodes.evaluation import episodes
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.world.columns import COLLISIONS, OPEN, WORST_CASE
from lissajous_env.world.state import WORKING

SCENARIOS = "evaders", "intruders", "hall", "experiment"
FILTERED = "kuramoto-mpcc", "partition", "line-abreast", "sweep", "random"
"""Policies that are also played with each filter."""
LEFT_OUT = "still", "portfolio", "portfolio-guarantee"
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

    def look(self, simulation: Simulation) -> None:
        """Count what began in the latest step."""
        place = simulation.robots.position.numpy()[:, :, :2].copy()
        works = simulation.robots.status.numpy() == WORKING
        now = ((self.room - np.abs(place)).min(axis=2) < NEAR) & works
        self.count += (now & ~self.touches).sum(axis=1)
        self.touches = now
        self._places = [*self._places[-self.window :], place]
        moved = np.linalg.norm(place - self._places[0], axis=2)
        self.standing = (now & (moved < self.radius)).sum(axis=1)


def row_of(name: str, scenario: Scenario, seeds: range) -> list[str]:
    """Return the cells of a policy in a scenario with walls."""
    contacts = Contacts(scenario, len(seeds))
    policy = baselines.make(name, scenario, len(seeds))
    rows: list[dict[str, Any]] = next(iter(episodes(policy, scenario, seeds, on_step=contacts.look)))
    worst = max(row[WORST_CASE.name] for row in rows)
    is_open = any(row[OPEN.name] for row in rows)
    collisions = np.mean([row[COLLISIONS.name] for row in rows])
    time = "" if np.isnan(worst) else f"{'> ' if is_open else ''}{worst:.3g}"
    return [time, f"{collisions:.3g}", f"{contacts.count.mean():.3g}", f"{contacts.standing.mean():.3g}"]


def policies_of(scenario: str) -> list[str]:
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
    parser.add_argument("--boundary", default="wall", help="wall, or open for comparison")
    options = parser.parse_args()
    warnings.simplefilter("ignore", AssumptionWarning)
    seeds = range(options.seed, options.seed + options.episodes)
    titles = ["worst case [s]", "collisions", "contacts with a wall", "robots stuck at the end"]
    for name in options.scenarios:
        scenario = lissajous_env.scenario(name, **{"task.boundary": options.boundary})
        rows = []
        for policy in options.policies or policies_of(name):
            try:
                rows.append([f"`{policy}`", *row_of(policy, scenario, seeds)])
            except ValueError as error:
                rows.append([f"`{policy}`", "refused", *[""] * (len(titles) - 1)])
                print(f"{policy}: {error}")
            print(name, *rows[-1], sep="\t", flush=True)
        title = f"{name} with walls, {len(seeds)} episodes each"
        figures.publish(f"walls {name}", title, {"columns": ["policy", *titles], "rows": rows}, options.store)


if __name__ == "__main__":
    main()
