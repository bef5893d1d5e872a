"""Compare runs over ROS 2 with the simulation: `python benchmarks/ros.py --seeds 0 1 2 3 --loss 0 0.1`.

Each run over ROS 2 is of a world and all robots as nodes on this machine. Beside its scores are those of the
simulation of the same seed, and of the simulation with actions disturbed by 1e-6: where cars cannot follow the curve,
as in `experiment`, such a disturbance grows until the episode is another one, and only means over seeds can be
compared. `--set robot.steering_max=0.8` makes cars that can. With losses, all sides lose this fraction of the messages,
each at random.
"""

import argparse
import json
import subprocess
import sys

import numpy as np

import baselines
import lissajous_env
from lissajous_env.console.terminal import parse_overrides

SCORES = ("spacing_factor", "min_separation", "phase_error")


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


def over_ros(given: argparse.Namespace, changes: list[str], seed: int) -> dict:
    arguments = ["--scenario", given.scenario, "--policy", given.policy, "--seed", str(seed), "--json"]
    arguments += ["--pace", str(given.pace)]
    command = [sys.executable, "-m", "lissajous_env", "ros", "launch", *arguments, "--set", *changes]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    stops = [line for line in done.stderr.splitlines() if "limit is" in line or "clock jumped" in line]
    return json.loads(done.stdout) | {"stops": len(stops)}


def simulated(given: argparse.Namespace, changes: list[str], seed: int, disturbs: bool) -> dict:
    made = lissajous_env.scenario(given.scenario, **parse_overrides((tuple(changes),)))
    policy = baselines.make(given.policy, made)
    return lissajous_env.evaluate(Disturbed(policy, seed) if disturbs else policy, made, seeds=[seed])[0]


def print_row(loss: float, seed: str, name: str, sides: list[float]) -> None:
    ros, simulation, disturbed = sides
    ratios = f"{ros / simulation:9.3f} {disturbed / simulation:9.3f}"
    print(f"{loss:5g} {seed:>5} {name:<15} {ros:8.4f} {simulation:10.4f} {disturbed:10.4f} {ratios}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="experiment")
    parser.add_argument("--policy", default="kuramoto-mpcc")
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--loss", type=float, nargs="+", default=[0.0, 0.1])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--pace", type=float, default=1000.0, help="largest number of simulated seconds per second")
    parser.add_argument("--set", nargs="+", default=[])
    given = parser.parse_args()
    titles = f"{'ROS 2':>8} {'simulation':>10} {'disturbed':>10} {'ROS 2':>9} {'disturbed':>9}"
    print(f"{'loss':>5} {'seed':>5} {'score':<15} {titles}")
    for loss in given.loss:
        changes = [*given.set, f"task.duration={given.duration}", f"noise.message_loss={loss}"]
        played, stops = [], 0
        for seed in given.seeds:
            rows = [over_ros(given, changes, seed), *(simulated(given, changes, seed, each) for each in (False, True))]
            stops += rows[0]["stops"]
            played.append([[row[name] for row in rows] for name in SCORES])
            for name, sides in zip(SCORES, played[-1], strict=True):
                print_row(loss, str(seed), name, sides)
        for name, sides in zip(SCORES, np.mean(played, axis=0).tolist(), strict=True):
            print_row(loss, "mean", name, sides)
        print(f"{loss:5g} robots that stopped by a rule: {stops}", flush=True)


if __name__ == "__main__":
    main()
