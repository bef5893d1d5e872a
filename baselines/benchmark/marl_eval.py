"""Results in the form that marl-eval reads, so that its tables and pictures can be made of them.

R. Gorsane et al., "Towards a Standardised Performance Evaluation Protocol for Cooperative MARL" (NeurIPS 2022). A
policy that is not trained has one evaluation, `step_0`, and its runs are its episodes, each named by its seed.

marl-eval wants the same policies, runs and metrics throughout an environment. So each scenario is an environment of its
own, with all its policies; and where there is more than one scenario of a kind of robot, these are an environment too,
of the policies that played all of them.
"""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from baselines.benchmark.rows import numbers_of
from lissajous_env.parameters.scenario import Scenario

NAME = "marl-eval.json"
_DIGITS = 6

_Episodes = Mapping[str, Mapping[str, Mapping[int, Mapping[str, Any]]]]
"""Score rows by scenario, policy and seed."""


def as_marl_eval(rows: Sequence[Mapping[str, Any]], scenarios: Mapping[str, Scenario]) -> str:
    """Put score rows into that form, as JSON; metrics without a number in some episode are left out."""
    episodes: dict[str, dict[str, dict[int, Mapping[str, Any]]]] = {}
    for row in rows:
        episodes.setdefault(row["scenario"], {}).setdefault(row["policy"], {})[row["seed"]] = row
    told = {}
    for kind in dict.fromkeys(scenarios[name].robot.kind for name in episodes):
        group = {name: of for name, of in episodes.items() if scenarios[name].robot.kind == kind}
        if len(group) > 1:
            told[f"lissajous {kind}".lower()] = _environment(group)
    return json.dumps(told | {f"lissajous {name}".lower(): _environment({name: of}) for name, of in episodes.items()})


def _environment(episodes: _Episodes) -> dict[str, Any]:
    """An environment of the policies and seeds that all of some scenarios have."""
    policies = [p for p in next(iter(episodes.values())) if all(p in of for of in episodes.values())]
    runs = [set(by_seed) for of in episodes.values() for policy, by_seed in of.items() if policy in policies]
    seeds = sorted(set.intersection(*runs)) if runs else []
    played = [by_policy[policy][seed] for by_policy in episodes.values() for policy in policies for seed in seeds]
    columns = (
        [c for c in numbers_of(played[0]) if all(math.isfinite(r.get(c, math.nan)) for r in played)] if played else []
    )
    return {
        # Names are looked up in small letters there.
        scenario.lower(): {
            policy: {f"seed_{seed}": _run(by_policy[policy][seed], columns) for seed in seeds} for policy in policies
        }
        for scenario, by_policy in episodes.items()
    }


def _run(row: Mapping[str, Any], columns: Sequence[str]) -> dict[str, Any]:
    metrics = {column: [float(f"{row[column]:.{_DIGITS}g}")] for column in columns}
    return {"step_0": {"step_count": 0, **metrics}, "absolute_metrics": metrics}
