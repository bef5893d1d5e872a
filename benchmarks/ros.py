"""Compare runs over ROS 2 with the simulation: `python benchmarks/ros.py --seeds 0 1 2 3 --store`.

Each run over ROS 2 is of a world and all robots as nodes on this machine. Its scores are divided by those of the
simulation of the same seed, as are those of a simulation with actions disturbed by 1e-6: where cars cannot follow the
curve, as in `experiment`, such a disturbance grows until the episode is another one, and only means over seeds can be
compared. With losses, all sides lose this fraction of the messages, each at random. `--store` puts the table into
docs/figures.json.
"""

import argparse
import json
import subprocess
import sys

import figures
import numpy as np

import baselines
import lissajous_env
from lissajous_env.console.terminal import parse_overrides

SCORES = ("spacing_factor", "phase_error", "min_separation")
CARS = {"0.48 m": (), "0.17 m": ("robot.steering_max=0.8", "robot.model_offset=None")}
"""Changes of the scenario, by the tightest turn of its cars."""
LOSSES = {"none": 0.0, "10 %": 0.1}
RUNS = ("ROS 2", "simulation with disturbed actions", "simulation")


class Disturbed:
    """A policy whose actions are disturbed by 1e-6."""

    num_worlds = 1

    def __init__(self, policy, seed):
        self._policy, self._draw = policy, np.random.default_rng(seed)

    def reset(self, worlds=None):
        """Reset the policy."""
        self._policy.reset(worlds)

    def act(self, observation):
        """Return the policy's actions, disturbed."""
        action = self._policy.act(observation).numpy()
        return action + 1e-6 * self._draw.normal(size=action.shape).astype(np.float32)


def over_ros(options: argparse.Namespace, changes: list[str], seed: int) -> dict:
    """Return the score row of a run over ROS 2, with the number of `stops` by a limit or a jump of the clock."""
    arguments = ["--scenario", options.scenario, "--policy", options.policy, "--seed", str(seed), "--json"]
    arguments += ["--pace", str(options.pace)]
    command = [sys.executable, "-m", "lissajous_env", "ros", "launch", *arguments, "--set", *changes]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    stops = [line for line in done.stderr.splitlines() if "limit is" in line or "clock jumped" in line]
    return json.loads(done.stdout) | {"stops": len(stops)}


def simulated(options: argparse.Namespace, changes: list[str], seed: int, disturbs: bool) -> dict:
    """Return the score row of a simulation."""
    scenario = lissajous_env.scenario(options.scenario, **parse_overrides((tuple(changes),)))
    policy = baselines.make(options.policy, scenario)
    return lissajous_env.evaluate(Disturbed(policy, seed) if disturbs else policy, scenario, seeds=[seed])[0]


def rows_of(options: argparse.Namespace, cars: str, loss: str) -> list[list[str]]:
    """Return the rows of the table for one kind of cars and one loss of messages."""
    changes = [*CARS[cars], f"task.duration={options.duration}", f"noise.message_loss={LOSSES[loss]}"]
    played = [
        (over_ros(options, changes, seed), *(simulated(options, changes, seed, disturbs) for disturbs in (True, False)))
        for seed in options.seeds
    ]
    scores = np.array([[[row[name] for name in SCORES] for row in rows] for rows in played])  # (seeds, runs, scores)
    ratios = scores.mean(axis=0) / scores.mean(axis=0)[-1]
    least, most = scores[..., -1].min(axis=0), scores[..., -1].max(axis=0)
    stops = str(sum(rows[0]["stops"] for rows in played)), "", ""
    return [
        [cars, loss, run, *(f"{ratio:.2f}" for ratio in ratios[k, :-1]), f"{least[k]:.2f} to {most[k]:.2f}", stops[k]]
        for k, run in enumerate(RUNS)
    ]


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--scenario", default="experiment")
    parser.add_argument("--policy", default="kuramoto-mpcc")
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--pace", type=float, default=1000.0, help="largest number of simulated seconds per second")
    options = parser.parse_args()
    rows = [row for cars in CARS for loss in LOSSES for row in rows_of(options, cars, loss)]
    columns = [
        "tightest turn",
        "messages lost",
        "run",
        "spacing factor",
        "phase error",
        "smallest separation [m]",
        "stops",
    ]
    figures.publish("ros", "runs over ROS 2 and the simulation", {"columns": columns, "rows": rows}, options.store)


if __name__ == "__main__":
    main()
