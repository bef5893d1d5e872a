"""Scores of the classical policies after tuning: `python benchmarks/tuning.py --out FOLDER`.

Learned policies are trained on a scenario, so the classical ones that they are compared with are tuned on it, only on
training seeds (0, 1 ...). Each policy has the same number of trials, and those without a model predictive controller
have four times as many, at a tenth of the cost. A setting is scored by the interquartile mean of the detection time
over episodes, and by collisions per episode. Two settings are chosen for each policy:

* `fast`: the shortest detection time of those that collide no more than the default does;
* `careful`, where the default collides: the fewest collisions of those that detect no later than the default does.

Both, and the default, then play the held-out seeds once. A trial changes only the policy, never the simulated scenario:
the policy is made from it with another `formation.phase_rate` and `coupling`, and with parameters of its own. `alpha`
and `ring` belong to the simulation (they define the observed phase and the communication graph), and `p` permutes the
robots over the same places, so these are not tuned.

The search begins with the settings that were chosen for earlier policies, as far as they apply, and random settings
around the default. Then follow generations of changed copies of the best ones. All play the first quarter of the
training seeds, and the best of them all training seeds. A setting that a policy refuses, such as loops without room,
is a trial without episodes, and the worst one. The paper's method is tuned after the policies with the same
controller, and `-safe` after the policy under it. FOLDER contains every trial (`trials.jsonl`, `trials.csv`), the
chosen settings (`tuned.json`) and the table (`tuned.md`). If the command is interrupted and called again with the same
FOLDER and options, it resumes. Use another FOLDER after a change of the code.
"""

import argparse
import csv
import io
import json
import math
import time
import zlib
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import lissajous_env
from baselines.benchmark.statistics import bootstrap_interval, interquartile_mean
from baselines.mpcc.solver import MpccParameters
from baselines.policies import registry
from baselines.policies.base import Filtered, Policy, UnsuitableScenarioError
from baselines.policies.coordinators import ArcParameters, ground_speed
from baselines.policies.line_abreast import LineAbreast
from baselines.policies.line_path import LineParameters, lines_of
from baselines.policies.loops import SweepParameters, cruising_speed
from baselines.policies.partition import Partition, PartitionRepair
from baselines.policies.patrol import Laps, Sweep
from baselines.policies.safety.safe import Safe, SafetyParameters
from baselines.policies.trackers import FieldParameters, WithVectorField
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.folder import Folder, Journal

POLICIES = (
    "open-loop-mpcc", "tracked-reference-mpcc", "kuramoto-mpcc", "kuramoto-mpcc-safe", "arc-mpcc",
    "arc-mpcc-safe", "consensus-gvf", "consensus-gvf-safe", "sweep", "sweep-safe", "laps", "laps-safe",
    "partition", "partition-safe", "partition-repair", "partition-repair-safe",
    "line-abreast", "line-abreast-safe",
)  # fmt: skip
HELD_OUT = range(10_000, 10_064)
BATCH = 64
COLUMNS = ("detection_time_mean", "detection_time_p95", "collisions", "return_mean")
SLACK = 0.05
"""Difference in collisions per episode that is ignored: one in twenty minutes."""
ELITE = 3
"""Number of settings that are changed in the next generation, by each goal."""
NAMES = ("trials.jsonl", "trials.csv", "tuned.json", "tuned.md")
"""Files of the results."""
PATROLS = {"sweep": Sweep, "laps": Laps}
PARTITIONS = {"partition": Partition, "partition-repair": PartitionRepair}

Settings = dict[str, float | int]
"""Differences from the default, as `part.name`; part is `formation` or the parameters of a piece of the policy."""


def make(name: str, scenario: Scenario, settings: Settings, num_worlds: int = 1, device: Any = "cpu") -> Policy:
    """Make a policy by name with some of its parameters changed."""
    parts: dict[str, dict[str, Any]] = {}
    for key, value in settings.items():
        part, field = key.split(".")
        parts.setdefault(part, {})[field] = value
    if name.endswith("-safe"):
        under = {key: value for key, value in settings.items() if not key.startswith("safety.")}
        wanted = make(name.removesuffix("-safe"), scenario, under, num_worlds, device)
        return Filtered(wanted, Safe, SafetyParameters(**parts.get("safety", {})))
    planned = lissajous_env.scenario(scenario, formation=parts.get("formation", {}))
    if name in PATROLS:
        policy = PATROLS[name](planned, num_worlds, device, SweepParameters(**parts.get("sweep", {})))
    elif name in PARTITIONS:
        kind, parameters = PARTITIONS[name], parts.get("partition", {}) | parts.get("repair", {})
        policy = kind(planned, num_worlds, device, kind.Parameters(**parameters))
    elif name == "line-abreast":
        policy = LineAbreast(planned, num_worlds, device, LineParameters(**parts.get("line", {})))
    else:
        factory = registry.resolve(name).factory
        tracker, coordinator = factory.func, factory.args[0]
        if name.startswith("arc"):
            coordinator = partial(coordinator, parameters=ArcParameters(**parts.get("arc", {})))
        parameters: Any = MpccParameters.of(scenario, **parts.get("mpcc", {}))
        if tracker is WithVectorField:
            parameters = FieldParameters(**parts.get("field", {}))
        policy = tracker(coordinator, planned, num_worlds, device, parameters)
    policy.name = name
    return policy


def space(name: str, scenario: Scenario) -> dict[str, tuple[float, float] | list[int]]:
    """Return the values that a trial may change: a range with logarithmic draws, or a list of choices.

    They include rates and speeds that the cars cannot reach; a car then drives as fast as it can.
    """
    rate, top = scenario.formation.phase_rate, scenario.robot.top_speed
    ranges: dict[str, tuple[float, float] | list[int]] = {}
    if name.endswith("-safe"):
        ranges |= space(name.removesuffix("-safe"), scenario)
        ranges |= {"safety.clearance": (0.02, 0.3), "safety.growth": (0.05, 0.6), "safety.effort": (0.02, 0.4),
                   "safety.horizon": [5, 8, 12, 16], "safety.speed_max": (0.3, top)}  # fmt: skip
        return ranges
    if name in PATROLS:
        cruise = cruising_speed(scenario)
        deepest = 0.9 * scenario.curve.half_height
        return {"sweep.cruise": (0.3 * cruise, min(2.5 * cruise, top)), "sweep.inset": (0.02, deepest),
                "sweep.lanes": [2, 4, 6], "sweep.lookahead": (0.3, 2.0)}  # fmt: skip
    if name in PARTITIONS:
        rows = list(range(1, min(scenario.num_robots, 3) + 1))
        ranges |= {"partition.speed": (0.1 * top, 0.95 * top), "partition.rows": rows,
                   "partition.extent_x": (0.02, 1.0), "partition.extent_y": (0.02, 1.0)}  # fmt: skip
        if name == "partition-repair":
            ranges |= {"repair.patience": [1, 2, 3], "repair.reserve": (1.0, 2.0)}
        return ranges
    if name == "line-abreast":
        resolved = scenario.resolve()
        lines = [count for count in range(1, resolved.num_robots + 1) if lines_of(resolved, LineParameters(), count)[0]]
        return {"line.speed": (0.3 * top, top), "line.lines": lines}
    if name.startswith("arc"):
        speed = ground_speed(scenario)
        ranges |= {"arc.speed": (0.3 * speed, 2.5 * speed), "arc.preview": (0.2, 1.5)}
    else:
        ranges |= {"formation.phase_rate": (0.3 * rate, 4.0 * rate)}
    if name.startswith(("kuramoto", "arc", "consensus")):
        ranges |= {"formation.coupling": (0.05, 4.0)}
    if name == "consensus-gvf":
        return ranges | {"field.pull": (0.5, 10.0), "field.turn": (2.0, 20.0), "field.speed": (1.0, 20.0),
                        "field.slowest": (0.1, 1.0)}  # fmt: skip
    return ranges | {"mpcc.weight_lateral": (0.001, 1.0), "mpcc.weight_lag": (0.001, 1.0),
                    "mpcc.weight_steering": (3e-4, 0.1), "mpcc.weight_throttle": (3e-4, 0.1),
                    "mpcc.stages": [10, 15, 20]}  # fmt: skip


def drawn(bounds: Any, random: np.random.Generator, near: float | None = None) -> float | int:
    """Draw a value within bounds; if `near` is given, within a factor of about 1.3 of it."""
    if isinstance(bounds, list):
        return int(random.choice(bounds))
    low, high = bounds
    wide = random.uniform(math.log(low), math.log(high))
    value = math.exp(wide if near is None else math.log(near) + 0.3 * random.standard_normal())
    return float(f"{min(max(value, low), high):.3g}")


def changed(settings: Settings, bounds: dict[str, Any], random: np.random.Generator) -> Settings:
    """Return a copy of settings with about a third of the values changed, a tenth of these to the default."""
    child = dict(settings)
    for key in random.permutation(list(bounds))[: 1 + random.binomial(len(bounds) - 1, 0.33)]:
        if key in child and random.random() < 0.1:
            del child[key]
        else:
            child[key] = drawn(bounds[key], random, near=child.get(key))
    return child


class Trials:
    """Plays settings, and stores the results in a journal."""

    def __init__(self, journal: Journal, device: Any):
        self.journal, self.device = journal, device
        self.entries = {self._key(entry): entry for entry in journal.entries}

    def play(self, name: str, scenario: Scenario, settings: Settings, seeds: range) -> dict[str, Any]:
        """Return the scores of a setting on some seeds, an episode each; none if the policy refuses the setting."""
        entry: dict[str, Any] = {"scenario": scenario.name, "digest": scenario.digest(), "policy": name,
                                 "settings": settings, "first_seed": seeds[0], "seeds": len(seeds)}  # fmt: skip
        if self._key(entry) not in self.entries:
            begin = time.perf_counter()
            try:
                policy = make(name, scenario, settings, min(len(seeds), BATCH), self.device)
                rows = lissajous_env.evaluate(policy, scenario, seeds, self.device)
            except UnsuitableScenarioError:
                rows = []
            entry["seconds"] = round(time.perf_counter() - begin, 2)
            # An episode without targets has no detection time.
            entry |= {column: [row[column] for row in rows if math.isfinite(row[column])] for column in COLUMNS}
            self.journal.append([entry])
            self.entries[self._key(entry)] = entry
        return self.entries[self._key(entry)]

    @staticmethod
    def _key(entry: dict[str, Any]) -> str:
        return json.dumps([entry[k] for k in ("digest", "policy", "settings", "first_seed", "seeds")], sort_keys=True)


def detection(entry: dict[str, Any]) -> float:
    """Return the interquartile mean of the detection time [s]; infinity for a refused setting."""
    return interquartile_mean(entry["detection_time_mean"]) if entry["detection_time_mean"] else math.inf


def collisions(entry: dict[str, Any]) -> float:
    """Return the mean number of collisions per episode; infinity for a refused setting."""
    return float(np.mean(entry["collisions"] or math.inf))


def ranked(entries: list[dict[str, Any]], default: dict[str, Any], goal: str) -> list[dict[str, Any]]:
    """Return entries sorted, the best first, by a goal relative to the default's entry on the same seeds."""
    if goal == "fast":
        allowed = max(collisions(default), SLACK)
        return sorted(entries, key=lambda entry: (max(collisions(entry) - allowed, 0.0), detection(entry)))
    allowed = detection(default)
    return sorted(entries, key=lambda entry: (max(detection(entry) - allowed, 0.0), collisions(entry)))


def tune(
    trials: Trials, name: str, scenario: Scenario, known: list[Settings], options: argparse.Namespace
) -> tuple[dict[str, Settings], list[dict[str, Any]]]:
    """Return the settings of a policy by goal and `default`, and the finalists' entries on all training seeds."""
    random = np.random.default_rng([options.seed, zlib.crc32(f"{scenario.name}/{name}".encode())])
    bounds, few = space(name, scenario), range(max(options.seeds // 4, 1))
    default = trials.play(name, scenario, {}, few)
    goals = ["fast", "careful"] if collisions(default) > SLACK else ["fast"]
    # The latest settings come first, as those of the most similar policies; at least half of the trials are new.
    begin = _distinct([{key: value for key, value in one.items() if key in bounds} for one in reversed(known)])
    begin = begin[: options.random // 2]
    effort = 1 if "mpcc" in name else 4
    for k in range(effort * options.random - len(begin)):
        # Change a few, some, and all values in turn, because many random values are seldom all good.
        count = (1 + k % 2, math.ceil(0.4 * len(bounds)), len(bounds))[k % 3]
        begin.append({key: drawn(bounds[key], random) for key in random.permutation(list(bounds))[:count]})
    played = [default] + [trials.play(name, scenario, settings, few) for settings in begin]
    for _ in range(options.generations):
        parents = _elite(played, default, goals)
        children = effort * options.children
        for k in range(children):
            settings = changed(parents[k * len(parents) // children], bounds, random)
            played.append(trials.play(name, scenario, settings, few))
    every = range(options.seeds)
    on_all = trials.play(name, scenario, {}, every)
    best = _elite(played, default, goals)
    finalists = [on_all] + [trials.play(name, scenario, settings, every) for settings in _distinct(best)]
    chosen: dict[str, Settings] = {"default": {}}
    chosen |= {goal: ranked(finalists, on_all, goal)[0]["settings"] for goal in goals}
    return chosen, finalists


def _elite(played: list[dict[str, Any]], default: dict[str, Any], goals: list[str]) -> list[Settings]:
    """Return the best settings by each goal, `ELITE` of each."""
    best = [_distinct([entry["settings"] for entry in ranked(played, default, goal)])[:ELITE] for goal in goals]
    return [settings for few in best for settings in few] or [{}]


def _distinct(settings: list[Settings]) -> list[Settings]:
    """Return settings without repetitions and without the default."""
    return [one for k, one in enumerate(settings) if one and one not in settings[:k]]


def front(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the Pareto front of entries in detection time and collisions."""
    pareto: list[dict[str, Any]] = []
    for entry in sorted(entries, key=lambda entry: (detection(entry), collisions(entry))):
        if not pareto or collisions(entry) < collisions(pareto[-1]):
            pareto.append(entry)
    return pareto


def described(settings: Settings) -> str:
    """Return settings as one line."""
    return ", ".join(f"{key} {value:g}" for key, value in sorted(settings.items())) or "-"


def table(results: dict[str, dict[str, dict[str, Any]]]) -> list[str]:
    """Return the table of a scenario's held-out seeds as lines of Markdown; `*` marks the front of all policies."""
    best = front([entry for by_goal in results.values() for entry in by_goal.values()])
    lines = ["| policy | chosen | detection time, IQM [s] | 95 % interval | collisions | return | settings |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for name, by_goal in results.items():
        for entry in {id(entry): entry for entry in by_goal.values()}.values():
            goals = " = ".join(goal for goal, other in by_goal.items() if other is entry)
            low, high = bootstrap_interval(entry["detection_time_mean"])
            star = "*" if any(entry is one for one in best) else ""
            times = f"{detection(entry):.3f} | {low:.3f} to {high:.3f}"
            others = f"{collisions(entry):.2f} | {np.mean(entry['return_mean']):.2f}"
            lines.append(f"| {name} | {goals}{star} | {times} | {others} | {described(entry['settings'])} |")
    return lines


def write_csv(folder: Folder, entries: list[dict[str, Any]]) -> None:
    """Write every trial as one row."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(
        ["scenario", "policy", "first_seed", "seeds", "detection_time_iqm", "collisions", "return_mean", "settings"]
    )
    for entry in entries:
        numbers = [detection(entry), collisions(entry), float(np.mean(entry["return_mean"] or -math.inf))]
        where = [entry[key] for key in ("scenario", "policy", "first_seed", "seeds")]
        writer.writerow([*where, *(f"{number:.5g}" for number in numbers), described(entry["settings"])])
    folder.write("trials.csv", text.getvalue())


def main():
    parser = argparse.ArgumentParser(description="Tune the classical policies on training seeds, test them on others.")
    parser.add_argument("--scenario", nargs="+", default=["intruders", "rough-lost"])
    parser.add_argument("--policies", nargs="+", default=POLICIES, choices=POLICIES)
    parser.add_argument("--seeds", type=int, default=32, help="training seeds, from 0")
    parser.add_argument("--random", type=int, default=32, help="random settings of each policy")
    parser.add_argument("--generations", type=int, default=4)
    parser.add_argument("--children", type=int, default=8, help="settings in a generation")
    parser.add_argument("--seed", type=int, default=0, help="of the search")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--out", type=Path, default=Path("results/tuning"))
    options = parser.parse_args()
    if not 1 <= options.seeds <= HELD_OUT[0]:
        parser.error(f"--seeds must be from 1 to {HELD_OUT[0]}, the first held-out one, got {options.seeds}")
    begin, lines, tuned = time.perf_counter(), [], {}
    with Folder(options.out, NAMES) as folder:
        journal = folder.journal("trials.jsonl")
        trials = Trials(journal, options.device)
        for scenario in map(lissajous_env.scenario, options.scenario):
            chosen: dict[str, dict[str, Settings]] = {}
            finalists: list[dict[str, Any]] = []
            for name in options.policies:
                known = [settings for by_goal in chosen.values() for settings in by_goal.values()]
                chosen[name], entries = tune(trials, name, scenario, known, options)
                finalists += entries
                print(f"{scenario.name:12s}{name:26s}{time.perf_counter() - begin:7.0f} s", flush=True)
            # The held-out seeds are played only once, when everything has been chosen.
            results = {
                name: {goal: trials.play(name, scenario, settings, HELD_OUT) for goal, settings in by_goal.items()}
                for name, by_goal in chosen.items()
            }
            lines += [f"\n`{scenario.name}`, held-out seeds {HELD_OUT[0]} to {HELD_OUT[-1]}\n", *table(results)]
            lines += [f"\n`{scenario.name}`, the trade-off on training seeds: no finalist is better in both\n"]
            lines += ["| detection time, IQM [s] | collisions | policy | settings |", "|---|---|---|---|"]
            for entry in front(finalists):
                numbers = f"| {detection(entry):.3f} | {collisions(entry):.2f} "
                lines.append(f"{numbers}| {entry['policy']} | {described(entry['settings'])} |")
            tuned[scenario.name] = chosen
        write_csv(folder, list(trials.entries.values()))
        folder.write("tuned.json", json.dumps(tuned, indent=2) + "\n")
        folder.write("tuned.md", "\n".join(lines).strip() + "\n")
    print("\n".join(lines))
    print(f"\n{len(trials.entries)} trials, {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
