"""Exploitability of teams that learned against rogues or ordinary targets: `python benchmarks/teams.py --out FOLDER`.

On `evaders`, teams are trained with `sweep` as their base: against the ordinary targets of the scenario, or against
the mixture of a learned rogue and a script. Then rogues are trained against each team, and against `sweep` itself. The
table has, from below, the undetected times of these fresh rogues, of the included rogue and of the best script; from
above, the proved worst-case undetected time; and the collisions. All are means over the seeds of the trainings, in
brackets the least and the greatest. If the command is interrupted and called again, it resumes. `--store` puts the
table into docs/figures.json.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import figures
import numpy as np
from rich.console import Console

import lissajous_env
from baselines.exploitability.bracket import bound_of, bracketed
from baselines.exploitability.survival import survive, with_starts
from training.rogue_settings import RogueTraining
from training.sb3.rogue_trainer import train_rogues
from training.sb3.trainer import train
from training.settings import TrainingSettings

SCENARIO, BASE, SHIPPED = "evaders", "sweep", "hide-from-sweep"
OPPONENTS = f"{SHIPPED}+follow-gap"
TEAMS = {
    BASE: f"`{BASE}`, does not learn",
    "targets": "learned against ordinary targets",
    "rogues": f"learned against `{OPPONENTS}`",
}
SCRIPTS = "wander", "flee", "shadow", "follow-gap"
STARTS = 96
HELD_OUT = range(10_000, 10_016)
TITLES = ("team", "fresh rogue [s], mean", "best start", "`hide-from-sweep`, mean", "best script, mean", "proved bound")
TITLES = (*TITLES, "collisions per episode")


def times_of(kind: str, seed: int, options: argparse.Namespace) -> list[float]:
    """Train a team and a rogue against it, and return the cells of its row."""
    team = BASE if kind == BASE else _trained(kind, seed, options)
    fresh = options.out / f"rogue-{kind}-{seed}"
    settings = RogueTraining(
        SCENARIO, team, options.rounds, seed=seed, starts=STARTS, evaluation_episodes=16, threads=1, out=fresh
    )
    train_rogues(settings, Console())
    scenario = lissajous_env.scenario(SCENARIO)
    bare = lissajous_env.scenario(SCENARIO, **{"task.grid": None, "task.contamination": None})
    found = {each: survive(team, with_starts(bare, each, STARTS), HELD_OUT) for each in (str(fresh), SHIPPED, *SCRIPTS)}
    mean = {each: float(np.mean(of.means)) for each, of in found.items()}
    alone = survive(team, with_starts(bracketed(scenario), "wander", 2), HELD_OUT)
    bound = bound_of(alone)
    assert bound is not None
    collisions = float(np.mean([score["collisions"] for score in alone.scores]))
    longest, script = float(found[str(fresh)].longest.mean()), max(mean[each] for each in SCRIPTS)
    return [mean[str(fresh)], longest, mean[SHIPPED], script, bound.value, collisions]


def _trained(kind: str, seed: int, options: argparse.Namespace) -> str:
    overrides = {"targets.rogues": OPPONENTS} if kind == "rogues" else {}
    out = options.out / f"team-{kind}-{seed}"
    settings = TrainingSettings(
        SCENARIO, steps=options.steps, seed=seed, out=out, base=BASE, rivals=(), evaluation_episodes=16,
        threads=1, overrides=overrides,
    )  # fmt: skip
    train(settings, Console())
    return str(out / "best")


def table_of(results: dict[str, list[list[float]]]) -> figures.Table:
    """Return the table of the cells by kind of team and seed."""
    rows = []
    for kind, of in results.items():
        cells = np.array(of)
        spread = zip(cells.mean(axis=0), cells.min(axis=0), cells.max(axis=0), strict=True)
        shown = [f"{mean:.2f}" + (f" ({low:.2f} to {high:.2f})" if low < high else "") for mean, low, high in spread]
        rows.append([TEAMS[kind], *shown])
    return {"columns": TITLES, "rows": rows}


def main(given: Sequence[str] | None = None) -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=4_000_000, help="robot steps of the training of a team")
    parser.add_argument("--rounds", type=int, default=16, help="rounds of imitation of the training of a rogue")
    parser.add_argument("--out", type=Path, required=True, help="folder of the trainings and results")
    options = parser.parse_args(given)
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "results.json"
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for seed in range(options.seeds):
        for kind in TEAMS:
            name = f"{kind} {seed} {options.steps} {options.rounds}"
            if name not in known:
                known[name] = times_of(kind, seed, options)
                path.write_text(json.dumps(known, indent=1), encoding="utf-8")
    shown = {
        kind: [known[f"{kind} {seed} {options.steps} {options.rounds}"] for seed in range(options.seeds)]
        for kind in TEAMS
    }
    table = table_of(shown)
    figures.publish("teams", "teams", table, options.store)


if __name__ == "__main__":
    main()
