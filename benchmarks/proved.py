"""Guarantee, cost and limits of the proved filter: `python benchmarks/proved.py`.

Prints the worst-case undetected time and collisions of the paper's method on `evaders` under each filter, the time of
the filter per robot and step, and the collisions of cars that all drive towards their nearest neighbour while each
condition in turn is violated. `--seeds 16 --worlds 50` makes it short, and `--store` puts the tables into
docs/figures.json.
"""

import math
import time
from typing import Any

import figures
import numpy as np
import warp as wp

import baselines
import lissajous_env
from baselines.benchmark.statistics import in_words, number, summarize_largest
from baselines.policies.base import Filtered, Policy
from baselines.policies.safety.proved import Proved, ProvedParameters

FILTERS = ("", "-safe", "-proved")
TIMED = (
    ("kuramoto-mpcc", "evaders"), ("kuramoto-mpcc", "team"), ("kuramoto-mpcc", "evaders-failure"),
    ("sweep", "experiment"), ("random", "evaders"), ("random", "experiment"),
)  # fmt: skip
QUIET = {"targets.count": 0, "targets.arrival_rate": 0.0, "task.grid": None, "task.duration": 20.0}
CHASE = lissajous_env.scenario("experiment", **{**QUIET, "faults.schedule": (), "formation.start": "random"})
FAILING = {"faults.rate": 0.1, "faults.mean_duration": 2.0}
NOISY = {"noise.position": 0.01, "noise.heading": 0.01, "noise.speed": 0.02}


class Chasing(Policy):
    """Policy whose cars drive at full throttle towards the nearest robot that they sense."""

    kind = "car"

    def decide(self, observation):
        """Steer towards the nearest robot, or in a circle without one."""
        rows = baselines.Rows(observation, self.scenario)
        away = rows.robot_offset[..., 0, :]
        angle = np.arctan2(away[..., 1], away[..., 0]) - rows.heading
        steering = np.where(rows.robots_seen[..., 0], 4 * np.arctan2(np.sin(angle), np.cos(angle)), 0.5)
        return np.stack([np.clip(steering, -1, 1), np.ones_like(steering)], axis=-1)


class Alone:
    """The filter without its messages: each robot assumes that the others continue as it observes them."""

    def __init__(self, scenario, worlds):
        self.chasing = Chasing(scenario, worlds)
        self.filters = [Proved(scenario, worlds) for _ in range(self.chasing.num_robots)]

    @property
    def tails_compatible(self):
        """Return the worlds (W,) in which all assumed tails are compatible."""
        return np.all([filter.tails_compatible for filter in self.filters], axis=0)

    def act(self, observation):
        """Let robot i decide in the i-th filter, in which the others continue their tails."""
        wanted, action = self.chasing.act(observation.numpy()), np.zeros(self.chasing.action.shape, np.float32)
        for i, filter in enumerate(self.filters):
            own = np.full_like(wanted, np.nan)
            own[:, i] = wanted[:, i]
            action[:, i] = filter(observation, wp.array(own, device="cpu")).numpy()[:, i]
        return action


class OneUnfiltered(Filtered):
    """The filter under all robots except robot 0."""

    def decide(self, observation):
        """Return the filtered actions, with the unfiltered one of robot 0."""
        wanted = self.policy.act(observation)
        filtered = self.filter(observation, wanted).numpy()
        filtered[:, 0] = wanted.numpy()[:, 0]


def with_wrong_drag(scenario, worlds, factor):
    """Return the filter for cars whose drag is a factor of the assumed one."""
    policy = Filtered(Chasing(scenario, worlds), Proved)
    filter: Any = policy.filter
    filter._terms.robot.drag = scenario.robot.drag / factor
    filter._terms.decay = math.exp(-filter._terms.robot.drag * scenario.task.step)
    return policy


def case_of(changes=None, believed=None, **parameters):
    """Return scenario and filter; the filter may be made for another scenario."""
    scenario = lissajous_env.scenario(CHASE, **(changes or {}))
    filter_scenario = lissajous_env.scenario(scenario, **(believed or {}))
    return scenario, lambda w: Filtered(
        Chasing(filter_scenario, w), Proved, ProvedParameters(**parameters) if parameters else None
    )


def cases():
    """Return name, scenario and filter of every violation, after those without one."""
    uneven = {"noise.wheelbase_spread": 0.1, "noise.drive_spread": 0.1}
    return [
        ("none", *case_of()),
        ("none; 30 % of the messages are lost, each is sent once", *case_of({"noise.message_loss": 0.3}, repeats=1)),
        ("none; motors fail at 0.1/s, cars coast", *case_of({**FAILING, "faults.stop": "coast"})),
        ("none; robots fail at 0.1/s and stop dead", *case_of(FAILING)),
        ("1: drag 20 % lower than assumed", CHASE, lambda w: with_wrong_drag(CHASE, w, 0.8)),
        ("1: actuator noise of 5 %", *case_of({"noise.actuator": 0.05})),
        ("2: normal noise of 1 cm, 0.01 rad, 2 cm/s; the filter assumes a bound of 4 deviations", *case_of(NOISY)),
        ("2: the same noise; the filter assumes none", *case_of(NOISY, dict.fromkeys(NOISY, 0.0))),
        ("2: cars that differ by 10 %; the filter assumes 2 %", *case_of(uneven, dict.fromkeys(uneven, 0.02))),
        ("3: tails are not exchanged, each decides alone", CHASE, lambda w: Alone(CHASE, w)),
        ("4: one robot without the filter", CHASE, lambda w: OneUnfiltered(Chasing(CHASE, w), Proved)),
        ("5: robots that fail stop dead, assumed to coast", *case_of(FAILING, {"faults.stop": "coast"})),
    ]


def violated(scenario, make, worlds):
    """Return the share of episodes with a proof, collisions per episode after it, and the share of revoked proofs."""
    policy, simulation = make(worlds), lissajous_env.Simulation(scenario, worlds, seed=1)
    judge = policy if isinstance(policy, Alone) else policy.filter
    proved, revoked, collisions = np.zeros(worlds, bool), np.zeros(worlds, bool), np.zeros(worlds)
    for _ in range(simulation.scenario.task.steps):
        action = policy.act(simulation.observation)
        revoked |= proved & ~judge.tails_compatible
        proved |= judge.tails_compatible
        simulation.step(action)
        collisions += proved * simulation.latest.collisions.numpy().sum(axis=1) / 2
    return [proved.mean(), collisions.sum() / max(proved.sum(), 1), revoked.sum() / max(proved.sum(), 1)]


def guarantees(seeds):
    """Return the scores of the paper's method on `evaders` under each filter."""
    rows, plain = [], np.ones(seeds)
    for suffix in FILTERS:
        policy = baselines.make(f"kuramoto-mpcc{suffix}", "evaders", seeds)
        scores = lissajous_env.evaluate(policy, "evaders", range(seeds))
        columns = ("guaranteed_detection_time", "detection_time_mean", "collisions", "min_separation")
        worst, detection, collisions, least = (np.array([row[name] for row in scores]) for name in columns)
        plain = worst if not suffix else plain
        value, beside = in_words(summarize_largest(worst, [row["guarantee_open"] == 1 for row in scores]))
        cells = [np.median(worst / plain), np.max(worst / plain), np.nanmean(detection), collisions.mean(), least.min()]
        rows.append([f"`kuramoto-mpcc{suffix}`", f"{value} ({beside})", *map(number, cells)])
    names = ["worst-case undetected time, largest [s]", "ratio to that without, median", "maximum"]
    columns = ["policy", *names, "detection time [s]", "collisions", "smallest distance [m]"]
    return {"columns": columns, "rows": rows}


def times(worlds=64, steps=300):
    """Return the time of the filter per robot and step [us] on one thread, and the share of actions that it changed."""
    rows = []
    for name, scenario in TIMED:
        policy, simulation = (
            Filtered(baselines.make(name, scenario, worlds), Proved),
            lissajous_env.Simulation(scenario, worlds),
        )
        policy.act(simulation.observation)
        policy.reset()
        took, changed = [], []
        for _ in range(steps):
            wanted = policy.policy.act(simulation.observation)
            begin = time.perf_counter()
            action = policy.filter(simulation.observation, wanted)
            took.append((time.perf_counter() - begin) / worlds / policy.num_robots * 1e6)
            changed.append(np.mean(np.abs(action.numpy() - wanted.numpy()).max(axis=-1) > 1e-6))
            simulation.step(action)
        rows.append(
            [
                f"{scenario}, `{name}`",
                *(number(float(figure)) for figure in (np.mean(took), np.median(took), 100 * np.mean(changed))),
            ]
        )
    return {"columns": ["filter", "a robot and step [us]", "median [us]", "actions it changed [%]"], "rows": rows}


def main():
    parser = figures.parser(__doc__)
    parser.add_argument("--seeds", type=int, default=96, help="episodes on `evaders` under each filter")
    parser.add_argument("--worlds", type=int, default=400, help="episodes with each condition violated")
    options = parser.parse_args()
    figures.show("what it costs", times())
    rows = [[name, *map(number, violated(scenario, make, options.worlds))] for name, scenario, make in cases()]
    columns = ["violated condition", "episodes with a proof", "collisions after it", "proofs that the filter revokes"]
    chases: figures.Table = {"columns": columns, "rows": rows}
    figures.publish("violated", f"chases of 20 s, five cars, {options.worlds} episodes", chases, options.store)
    table = guarantees(options.seeds)
    figures.publish("filtered", f"`evaders`, {options.seeds} seeds", table, options.store)


if __name__ == "__main__":
    main()
