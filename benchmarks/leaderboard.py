"""The leaderboard of tasks with feedback: `python benchmarks/leaderboard.py [ENTRY ...] [--store]`.

An entry is a file docs/leaderboard/ENTRY.toml with the policies of each task, one for each training, and how they were
made. Every policy plays four episodes of each of the first 32 scenarios of the split `test` of the task's space, which
no training and no tuning may use. Without names, all entries are played. Episodes that were played are kept in the
folder `--out`: the same command goes on after an interruption, and plays nothing twice. Modules of policies are
searched in docs/leaderboard.

The score of a task is 0 for the best patrol and 1 for the best tuned rule (`REFERENCES`); the score of an entry is the
interquartile mean over its trainings and tasks, with a 95 % interval from 2,000 bootstrap resamples of the trainings
and of the scenarios of each task (Agarwal et al., 2021). Collisions are the mean over all episodes.

`--store` puts the table into docs/figures.json; `--check` plays entries and references again in an empty folder, from
the beginning, and ends with status 1 if a row differs from the stored one.
"""

import sys
import tempfile
import tomllib
import warnings
from pathlib import Path

import figures
import numpy as np
from rich.console import Console

import lissajous_env
from baselines.benchmark.running import measure
from baselines.benchmark.statistics import RESAMPLES, interquartile_mean
from baselines.benchmark.types import Benchmark
from baselines.policies import registry
from lissajous_env.wording import nearest
from lissajous_env.world.columns import task_score

REFERENCES = {
    "watch-v1": ("lanes", "greedy-herd"),
    "intercept-v1": ("lanes", "divided-pursuit"),
    "hotspots-v1": ("lanes", "index-learned"),
}
"""Policies of each task whose scores are 0 and 1; the score of a task is `task_score`."""
SCENARIOS, EPISODES = 32, 4
FOLDER = figures.ROOT / "docs" / "leaderboard"
COLUMNS = ["entry", "score", "watch", "intercept", "hotspots", "collisions", "trainings", "by"]


def read(path):
    """Return an entry.

    Raises:
        ValueError: there is no such entry, a key is missing or unknown, the tasks are not those of the leaderboard, or
            a policy cannot be loaded.
    """
    if not path.exists():
        names = sorted(other.stem for other in FOLDER.glob("*.toml"))
        rule = f"must be a file docs/leaderboard/ENTRY.toml, such as {', '.join(names)}"
        raise ValueError(f"entry {rule}, got {path.stem}{nearest(path.stem, names)}")
    try:
        entry = tomllib.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path.name} must be a TOML file that can be read: {error}") from error
    _check_keys(f"{path.name}", entry, ("name", "by", "command", "machine", "policies"))
    _check_keys(f"policies of {path.name}", entry["policies"], REFERENCES)
    for task, policies in entry["policies"].items():
        if not isinstance(policies, list) or not policies or not all(isinstance(name, str) for name in policies):
            raise ValueError(f"{task} of {path.name} must be a list of policies, one for each training, got {policies}")
        scenario = lissajous_env.scenario_space(task).sample(0)
        for policy in policies:
            registry.as_factory(policy)(scenario, 1, "cpu")
    counts = {task: len(policies) for task, policies in entry["policies"].items()}
    if len(set(counts.values())) != 1:
        raise ValueError(f"policies of {path.name} must have as many trainings for each task, got {counts}")
    return entry


def _check_keys(what, table, keys):
    for key in table:
        if key not in keys:
            raise ValueError(f"{what} must have the keys {', '.join(keys)}, got {key}{nearest(key, keys)}")
    for key in keys:
        if key not in table:
            raise ValueError(f"{what} must have the keys {', '.join(keys)}, {key} is missing")


def play(task, policy, out):
    """Return the scores and the collisions (scenarios,) of a policy on the split, each the mean of its episodes.

    Raises:
        ValueError: the policy refuses a scenario or fails; the message names the scenario and the reason.
    """
    print(f"{task}: {policy}", file=sys.stderr)
    settings = Benchmark(
        scenarios=(f"{task}:test:{SCENARIOS}",),
        policies=(policy,),
        episodes=EPISODES,
        out=out / task / policy.replace("/", "_"),
        replays=0,
    )
    outcome = measure(settings, console=Console(quiet=True))
    if outcome.failures:
        failure = outcome.failures[0]
        raise ValueError(f"{policy} must play every scenario of {task}, but on {failure.scenario}: {failure.error}")
    by_scenario = [[row for row in outcome.rows if row["scenario"] == name] for name in outcome.table.scenarios]
    score = task_score(lissajous_env.scenario_space(task).base).name
    return np.array([
        [np.mean([row[column] for row in chosen]) for chosen in by_scenario] for column in (score, "collisions")
    ])  # fmt: skip


def scored(entry, out):
    """Return the row of an entry in the table."""
    normalised, collisions = {}, []
    draw = np.random.default_rng(0)
    for task, (patrol, rule) in REFERENCES.items():
        zero, one = play(task, patrol, out)[0], play(task, rule, out)[0]
        played = np.stack([play(task, policy, out) for policy in entry["policies"][task]])
        collisions.append(played[:, 1].mean())
        # The first resample is the sample itself.
        scenarios = draw.integers(0, SCENARIOS, (RESAMPLES + 1, SCENARIOS))
        trainings = draw.integers(0, len(played), (RESAMPLES + 1, len(played)))
        scenarios[0], trainings[0] = np.arange(SCENARIOS), np.arange(len(played))
        low, high = zero[scenarios].mean(axis=1), one[scenarios].mean(axis=1)
        means = np.stack([scores[scenarios].mean(axis=1) for scores in played[:, 0]], axis=1)
        means = np.take_along_axis(means, trainings, axis=1)
        normalised[task] = (means - low[:, None]) / (high - low)[:, None]
    together = np.concatenate(list(normalised.values()), axis=1)
    score, *resampled = map(interquartile_mean, together)
    low, high = np.percentile(resampled, [2.5, 97.5])
    cells = [f"{values[0].mean():.2f}" for values in normalised.values()]
    trainings = str(together.shape[1] // len(REFERENCES)) if entry["command"] else "-"
    return [
        entry["name"],
        f"{score:.2f} ({low:.2f} to {high:.2f})",
        *cells,
        f"{np.mean(collisions):.1f}",
        trainings,
        entry["by"],
    ]


def main():
    """Play the entries, print and store their rows, or compare them with the stored ones."""
    parser = figures.parser(__doc__)
    parser.add_argument(
        "entries", nargs="*", metavar="ENTRY", help="names of files in docs/leaderboard; all by default"
    )
    parser.add_argument("--check", action="store_true", help="play again, and compare with the stored rows")
    parser.add_argument("--out", type=Path, default=Path("build/leaderboard"), help="folder of the episodes")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    names = options.entries or sorted(path.stem for path in FOLDER.glob("*.toml"))
    sys.path.append(str(FOLDER))
    try:
        entries = [read(FOLDER / f"{name}.toml") for name in names]
        with tempfile.TemporaryDirectory() as empty:
            rows = [scored(entry, Path(empty) if options.check else options.out) for entry in entries]
    except ValueError as error:
        parser.error(str(error))
    if options.check:
        stored = figures.load()["leaderboard"]["rows"]
        differing = [row for row in rows if row not in stored]
        print(f"{len(rows) - len(differing)} of {len(rows)} rows are as stored", *differing, sep="\n")
        sys.exit(1 if differing else 0)
    together = figures.merged("leaderboard", {"columns": COLUMNS, "rows": rows})["rows"]
    table = {"columns": COLUMNS, "rows": sorted(together, key=lambda row: -float(row[1].split()[0]))}
    figures.publish("leaderboard", "tasks with feedback", table, options.store)


if __name__ == "__main__":
    main()
