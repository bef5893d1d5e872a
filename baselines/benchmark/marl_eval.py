"""Results in the form that marl-eval reads, so that its tables and pictures can be made of them.

R. Gorsane et al., "Towards a Standardised Performance Evaluation Protocol for Cooperative MARL" (NeurIPS 2022). A
policy that is not trained has one evaluation, `step_0`, and its runs are its episodes, each named by its seed.

marl-eval requires the same policies, runs and metrics throughout an environment. So each scenario is an environment of
its own, with all its policies; and where there is more than one scenario of a kind of robot, these are an environment
too, of the policies that played all of them.
"""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from baselines.benchmark.rows import Rows, by_kind, grouped, numbers_of
from lissajous_env.parameters.scenario import Scenario

NAME = "marl-eval.json"
_DIGITS = 6


def as_marl_eval(rows: Rows, scenarios: Mapping[str, Scenario]) -> str:
    """Put score rows into that form, as JSON; metrics without a number in some episode are left out."""
    kinds = {kind: of for kind, of in by_kind(rows, scenarios).items() if len(next(iter(of.values()))) > 1}
    single = {name: {policy: {name: rows} for policy, rows in of.items()} for name, of in grouped(rows).items()}
    environments = (*kinds.items(), *single.items())
    return json.dumps({f"lissajous {name}".lower(): _environment(played) for name, played in environments})


def _environment(played: Mapping[str, Mapping[str, Rows]]) -> dict[str, Any]:
    """Return an environment of the seeds that all policies played; `played` has rows by policy and scenario."""
    seeds = set.intersection(*({row["seed"] for row in rows} for of in played.values() for rows in of.values()))
    kept = [row for of in played.values() for rows in of.values() for row in rows if row["seed"] in seeds]
    names = numbers_of(kept[0]) if kept else ()
    columns = [name for name in names if all(math.isfinite(row.get(name, math.nan)) for row in kept)]
    environment: dict[str, Any] = {}
    for row in kept:
        # Names are looked up in small letters there.
        runs = environment.setdefault(row["scenario"].lower(), {}).setdefault(row["policy"], {})
        runs[f"seed_{row['seed']}"] = _run(row, columns)
    return environment


def _run(row: Mapping[str, Any], columns: Sequence[str]) -> dict[str, Any]:
    metrics = {column: [float(f"{row[column]:.{_DIGITS}g}")] for column in columns}
    return {"step_0": {"step_count": 0, **metrics}, "absolute_metrics": metrics}
