"""Value of feedback in the scenarios where reacting to targets matters: `python benchmarks/feedback.py [--store]`.

Each scenario has a patrol that observes no target, simple policies that react, and the best rule, all with the same
driver. `--tune` plays a grid of settings of each on the 256 worlds of seeds 4,242 and up, and prints the best ones; the
settings below are those. Without it, the policies play them on the 256 worlds of seeds 10,000 and up, which tuning
never opens. The value of feedback is the ratio of a score to that of the patrol, so that more than 1 is better.

`--store` puts the table into docs/figures.json, from which `python benchmarks/figures.py` writes docs/feedback.md, and
the values into the file from which `lissajous scenarios` prints them. `--prototypes` plays the settings of the
programs in NumPy with which these tasks began instead, beside the scores of those programs.
"""

import itertools
import json
import re
import warnings
from pathlib import Path

import figures
import numpy as np

import lissajous_env
from baselines.policies.dividing import Cover, DividedPursuit, Herd
from baselines.policies.index_rule import Index
from baselines.policies.reacting import Chase, Follow, Force, Lanes, VoronoiPursuit
from lissajous_env.world.columns import task_score
from lissajous_env.world.state import DETECTED, PRESENT

WORLDS, TUNED_ON, PLAYED_ON = 256, 4242, 10_000
PATROL = "patrol in lanes"
KEPT = Path(lissajous_env.__file__).parent / "parameters" / "feedback.json"
"""The values of feedback that `lissajous scenarios` prints."""
CLAIRVOYANT = "sees all targets"


class SeesAll:
    """Mixed into a policy: every robot knows where every target of a simulation is and how it moves; no bound.

    `watch` is called after each step and reset, with the simulation.
    """

    def watch(self, simulation):
        """Remember where the targets are; a velocity is that of the latest step."""
        targets = simulation.targets
        status, place = targets.status.numpy(), targets.position.numpy().astype(float)
        self.present = (status == PRESENT) | ((status == DETECTED) & (not self.scenario.targets.leave))
        moved = place - getattr(self, "place", place)
        near = np.linalg.norm(moved, axis=-1, keepdims=True) <= 2 * self.top * self.step
        self.velocity, self.place = np.where(near, moved, 0.0) / self.step, place

    def rows(self, observation):
        """Return the rows with a track of every target that is there."""
        rows = super().rows(observation)
        offset = self.place[:, None] - rows.position[:, :, None]
        shape = offset.shape[:3]
        rows.tracks = np.broadcast_to(self.present[:, None], shape)
        rows.track_offset, rows.track_velocity = offset, np.broadcast_to(self.velocity[:, None], offset.shape)
        rows.track_age, rows.track_leaves = np.zeros(shape), np.zeros(shape, bool)
        return rows


class HerdAll(SeesAll, Herd):
    """Greedy herding of all targets."""


class DividedAll(SeesAll, DividedPursuit):
    """Divided pursuit of all targets."""


class IndexAll(SeesAll, Index):
    """Index rule with the numbers of undetected targets in the cells."""

    def rows(self, observation):
        """Return the rows with the tracks of the robots: what counts are the numbers."""
        return Index.rows(self, observation)

    def expected(self):
        """Return the numbers of undetected targets in the cells (W, N, cells)."""
        column, line = np.moveaxis(((self.place + self.half) / (2 * self.half) * self.counts).astype(int), -1, 0)
        cells = np.clip(column, 0, self.counts[0] - 1) * self.counts[1] + np.clip(line, 0, self.counts[1] - 1)
        numbers = np.zeros((self.num_worlds, len(self.cells)))
        world, target = np.nonzero(self.present)
        np.add.at(numbers, (world, cells[world, target]), 1.0)
        return np.broadcast_to(numbers[:, None], self._idle.shape)


POLICIES = {
    "watch": {
        PATROL: (Lanes, {"lanes": 10}),
        "follow the nearest": (Follow, {}),
        "A-CMOMMT, tuned": (Force, {"shared": 0.0, "reach": 2.0, "apart": 3.0, "push": 1.0}),
        "greedy cover, tuned": (Cover, {}),
        "greedy herding, tuned": (Herd, {}),
        CLAIRVOYANT: (HerdAll, {}),
    },
    "intercept": {
        PATROL: (Lanes, {"lanes": 16}),
        "pure pursuit": (Chase, {"lead": 0.0}),
        "lead pursuit, tuned": (Chase, {"lead": 0.8}),
        "Voronoi pursuit, tuned": (VoronoiPursuit, {}),
        "divided pursuit, tuned": (DividedPursuit, {}),
        CLAIRVOYANT: (DividedAll, {}),
    },
    "hotspots": {
        PATROL: (Lanes, {"lanes": 8}),
        "index rule, uniform rates": (Index, {"learns": False}),
        "index rule, learned rates": (Index, {}),
        CLAIRVOYANT: (IndexAll, {}),
    },
}
"""Policies of each scenario, with their settings: the patrol first, the reference that sees all targets last."""
LANES = {"lanes": (2, 4, 6, 8, 10, 12, 14, 16)}
GRIDS = {
    "watch": [
        (Lanes, LANES),
        (Force, {"shared": (0.0, 0.1), "reach": (1.5, 2.0, 3.0), "apart": (2.0, 2.5, 3.0), "push": (0.5, 1.0, 2.0)}),
        (Cover, {"delay": (0.5, 0.75, 1.0), "fade": (1.5, 2.25, 3.0), "margin": (0.5, 0.6, 0.7, 0.8)}),
        (Herd, {"fade": (3.0, 5.0, 8.0), "margin": (0.5, 0.6, 0.7), "behind": (0.3, 0.4), "fleeing": (1.0, 2.0)}),
    ],
    "intercept": [
        (Lanes, LANES),
        (Chase, {"lead": (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)}),
        (DividedPursuit, {"lead": (0.6, 0.7, 0.8, 0.9), "again": (0.0, 0.1, 0.2, 0.3), "delay": (0.1, 0.3)}),
        (VoronoiPursuit, {"near": (0.2, 0.3, 0.4), "width": (0.1, 0.15, 0.2), "fade": (0.15, 0.25, 0.4)}),
    ],
    "hotspots": [(Lanes, LANES), (Index, {"learns": (False, True), "delay": (0.0, 0.25, 0.5, 1.0, 1.5, 3.0)})],
}

PROTOTYPES = {
    "watch": {
        "patrol in 6 lanes": (Lanes, {"lanes": 6}, 0.155),
        "follow the nearest": (Follow, {}, 0.315),
        "A-CMOMMT": (Force, {"shared": 0.0, "reach": 2.0, "apart": 2.5, "push": 2.0}, 0.354),
    },
    "intercept": {
        "patrol in 6 lanes": (Lanes, {"lanes": 6}, 0.05),
        "pure pursuit": (Chase, {"lead": 0.0}, 2.52),
        "lead pursuit": (Chase, {"lead": 0.7}, 4.98),
    },
    "hotspots": {
        "patrol in 8 lanes": (Lanes, {"lanes": 8}, 13.1),
        "index rule, uniform rates": (Index, {"learns": False, "delay": 1.5}, 14.2),
        "index rule, learned rates": (Index, {"learns": True, "delay": 1.5}, 7.59),
    },
}
"""Policies of the prototypes, with their settings and their scores there, on as many worlds."""


def play(name, factory, settings, first):
    """Return the scores and the collisions (W,) of the worlds from a seed on."""
    scenario = lissajous_env.scenario(name)
    policy = factory(scenario, WORLDS, **settings)
    simulation = lissajous_env.Simulation(scenario, WORLDS, seed=first)
    while not simulation.over.all():
        if isinstance(policy, SeesAll):
            policy.watch(simulation)
        simulation.step(policy.act(simulation.observation))
    rows = simulation.score()
    return np.array([[row[task_score(scenario).name], row["collisions"]] for row in rows]).T


def with_interval(values, digits):
    """Return the mean with its 95 % interval."""
    return f"{values.mean():.{digits}f} ± {1.96 * values.std(ddof=1) / len(values) ** 0.5:.{digits}f}"


def value_of(scores, patrol, better):
    """Return the ratio of the means, better ones above 1, with its 95 % interval over worlds by bootstrap."""
    draws = np.random.default_rng(0).integers(0, len(scores), (4000, len(scores)))
    ratios = (scores[draws].mean(axis=1) / patrol[draws].mean(axis=1)) ** better
    low, high = np.percentile(ratios, [2.5, 97.5])
    return f"{(scores.mean() / patrol.mean()) ** better:.3g} ({low:.3g} to {high:.3g})"


def compared():
    """Return the table of all scenarios."""
    rows = []
    for name, policies in POLICIES.items():
        column = task_score(lissajous_env.scenario(name))
        patrol = None
        for words, (policy, settings) in policies.items():
            scores, collisions = play(name, policy, settings, PLAYED_ON)
            patrol = scores if patrol is None else patrol
            value = "1" if words == PATROL else value_of(scores, patrol, column.better)
            unit = f" {column.unit}" if column.unit else ""
            score = with_interval(scores, 3 if column.better > 0 and not unit else 2) + unit
            rows.append([name, words, score, with_interval(collisions, 2), value])
            print(*rows[-1], flush=True)
    return {"columns": ["scenario", "policy", "score", "collisions", "value of feedback"], "rows": rows}


def reproduced():
    """Return the table of the prototypes' policies."""
    rows = []
    for name, policies in PROTOTYPES.items():
        unit = task_score(lissajous_env.scenario(name)).unit
        for words, (policy, settings, before) in policies.items():
            scores, _ = play(name, policy, settings, PLAYED_ON)
            score = with_interval(scores, 2 if unit else 3)
            rows.append([name, words, f"{before} {unit}".strip(), f"{score} {unit}".strip(),
                         f"{100 * (scores.mean() / before - 1):+.0f} %"])  # fmt: skip
            print(*rows[-1], flush=True)
    return {"columns": ["scenario", "policy", "prototype", "here", "difference"], "rows": rows}


def best_values(rows):
    """Return for each scenario the largest value of feedback of a rule, and those of the reference."""
    best = {}
    for name, words, _, _, value in rows:
        numbers = [float(number) for number in re.findall(r"[0-9.]+", value)]
        entry = best.setdefault(name, {"value": 1.0})
        if words == CLAIRVOYANT:
            entry |= dict(zip(("sees_all", "sees_all_low", "sees_all_high"), numbers, strict=True))
        elif len(numbers) == 3 and numbers[0] > entry["value"]:
            entry |= {"value": numbers[0], "low": numbers[1], "high": numbers[2], "policy": words}
    return best


def tune():
    """Print the settings of each grid, best first."""
    for name, grids in GRIDS.items():
        better = task_score(lissajous_env.scenario(name)).better
        for policy, grid in grids:
            played = []
            for values in itertools.product(*grid.values()):
                settings = dict(zip(grid, values, strict=True))
                scores, collisions = play(name, policy, settings, TUNED_ON)
                played.append((better * scores.mean(), settings, with_interval(scores, 3), f"{collisions.mean():.2f}"))
            for _, settings, score, collisions in sorted(played, key=lambda row: -row[0])[:4]:
                print(name, policy.__name__, settings, score, "collisions", collisions, flush=True)


def main():
    parser = figures.parser(__doc__)
    parser.add_argument("--tune", action="store_true", help="print the best settings on the worlds for tuning")
    parser.add_argument("--prototypes", action="store_true", help="play the policies of the prototypes")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.tune:
        tune()
    elif options.prototypes:
        figures.publish("prototypes", "prototypes", reproduced(), options.store)
    else:
        table = compared()
        figures.publish("feedback", "value of feedback", table, options.store)
        if options.store:
            KEPT.write_text(json.dumps(best_values(table["rows"]), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
