"""Comparison of included learned policies with the classical ones, default and tuned: `python benchmarks/learned.py`.

Every policy plays the same 64 held-out seeds, which neither the training nor the tuning saw, in one run. The tuned
classical policies are those of `benchmarks/tuned.json`, which `python benchmarks/tuning.py` writes. `--touches` counts
rare collisions of the included networks over many more episodes. `--store` puts the tables into docs/figures.json.
"""

import json
from pathlib import Path
from typing import Any

import figures
import numpy as np
from rich.console import Console
from tuning import HELD_OUT, make

import baselines
import lissajous_env
import training
from baselines.benchmark.shown import SHOWN, in_words, number
from baselines.benchmark.statistics import Estimate, interquartile_mean, summarize
from baselines.policies.base import Policy
from baselines.policies.registry import unwrapped
from baselines.policies.settings import PolicySettings
from training.learned import checkpoint
from training.learned.policy import find

TUNED = Path(__file__).parent / "tuned.json"
LEARNED = {"intruders": "learned-intruders", "rough-lost": "portfolio"}
OTHERS = {
    "intruders": (
        "learned-intruders-proved",
        "learned-intruders-safe",
        "kuramoto-mpcc",
        "arc-mpcc",
        "sweep",
        "sweep-safe",
        "laps",
    ),
    "rough-lost": ("kuramoto-mpcc", "kuramoto-mpcc-safe", "arc-mpcc-safe", "sweep-safe"),
}
COLUMNS = {"detection_time_mean": "detection [s]", "collisions": "collisions", "recovery_time": "recovery [s]"}
SUMMARIES = {each.name: each.summary for each in SHOWN if each.name in COLUMNS}


def candidates(scenario: str, worlds: int) -> dict[str, Policy]:
    """Return the policies that play a scenario, by their names in the table."""
    made = lissajous_env.scenario(scenario)
    found = {LEARNED[scenario]: baselines.make(LEARNED[scenario], made, worlds)}
    found |= {name: baselines.make(name, made, worlds) for name in OTHERS[scenario]}
    if LEARNED[scenario] in training.names():
        card = checkpoint.read(find(LEARNED[scenario]))[1]
        for name in (card.base, f"{unwrapped(card.base)[0]}-proved"):
            policy = PolicySettings(name, card.base_parameters).make(made, worlds)
            found[f"{name}, with the parameters of the base"] = policy
    tuned: dict[str, Any] = json.loads(TUNED.read_text()).get(scenario, {})
    for name, by_goal in tuned.items():
        played: list[Any] = [{}]
        for goal, settings in by_goal.items():
            if settings not in played:
                found[f"{name}, tuned ({goal})"] = make(name, made, settings, worlds)
                played.append(settings)
    return found


def compare(scenario: str, episodes: int) -> dict[str, dict[str, Estimate]]:
    """Play, and return the statistics of each policy."""
    seeds = HELD_OUT[:episodes]
    scores: dict[str, dict[str, Estimate]] = {}
    for label, policy in candidates(scenario, len(seeds)).items():
        rows = lissajous_env.evaluate(policy, scenario, seeds)
        scores[label] = {
            column: summarize([row[column] for row in rows], summary=summary) for column, summary in SUMMARIES.items()
        }
    return scores


def as_table(scores: dict[str, dict[str, dict[str, Estimate]]]) -> figures.Table:
    """Return each policy's scores by scenario, and the relative detection time of the learned one without a filter."""
    rows = []
    for scenario, policies in scores.items():
        own = policies[LEARNED[scenario]]["detection_time_mean"].value
        for label, of in policies.items():
            words = (in_words(of[column]) for column in SUMMARIES)
            cells = [f"{value} ({ends})" if ends else value for value, ends in words]
            name, *tuned = label.partition(",")
            rows.append(
                [f"{scenario}, `{name}`{''.join(tuned)}", *cells, number(own / of["detection_time_mean"].value)]
            )
    return {"columns": ["policy", *COLUMNS.values(), "the learned one's detection time, as a share"], "rows": rows}


def ratios(scenario: str, scores: dict[str, dict[str, Estimate]], console: Console) -> None:
    """Print the learned policy's numbers as shares of those of the others."""
    own = scores[LEARNED[scenario]]
    console.print(f"{LEARNED[scenario]} on {scenario}")
    for label, other in scores.items():
        if other is own:
            continue
        parts = []
        for column in COLUMNS:
            a, b = own[column].value, other[column].value
            share = "equal" if a == b else f"{a / b:.3f}" if b else "none there"
            parts.append(f"{column} {share}" if np.isfinite(a) and np.isfinite(b) else "")
        mine, theirs = own["detection_time_mean"], other["detection_time_mean"]
        apart = mine.high < theirs.low or theirs.high < mine.low
        console.print(f"  of {label}: {', '.join(filter(None, parts))}; intervals {'apart' if apart else 'overlap'}")


def touches(scenario: str, seeds: range) -> list[list[str]]:
    """Return a row for the learned policy without and with each filter: the number of episodes with collisions."""
    rows = []
    for name in (LEARNED[scenario] + suffix for suffix in ("", "-safe", "-proved")):
        policy = baselines.make(name, scenario, len(seeds))
        played = lissajous_env.evaluate(policy, scenario, seeds)
        touched = [row["seed"] for row in played if row["collisions"] > 0]
        detection = interquartile_mean([row["detection_time_mean"] for row in played])
        rows.append([f"`{name}`", f"{len(touched)}", f"{len(seeds):,}", f"{detection:.3f}"])
    return rows


def main() -> None:
    parser = figures.parser("Shipped policies against the classical ones.")
    parser.add_argument("--scenarios", nargs="+", default=list(LEARNED), choices=list(LEARNED))
    parser.add_argument("--episodes", type=int, default=len(HELD_OUT))
    parser.add_argument("--touches", type=int, default=0, help="episodes to count collisions in, seeds 3000 ...")
    options = parser.parse_args()
    scores = {scenario: compare(scenario, options.episodes) for scenario in options.scenarios}
    tables = {"learned": as_table(scores)}
    figures.show(f"{options.episodes} held-out episodes", tables["learned"])
    for scenario in options.scenarios:
        ratios(scenario, scores[scenario], Console(width=140))
    if options.touches:
        seeds = range(3000, 3000 + options.touches)
        networks = [scenario for scenario in options.scenarios if LEARNED[scenario] in training.names()]
        rows = [row for scenario in networks for row in touches(scenario, seeds)]
        columns = ["policy", "episodes with a collision", "of", "detection [s]"]
        tables["learned-touches"] = {"columns": columns, "rows": rows}
        figures.show("collisions", tables["learned-touches"])
    if options.store:
        figures.store(tables)


if __name__ == "__main__":
    main()
