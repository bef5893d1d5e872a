"""Plans of random requests compared with every default policy: `python benchmarks/planning.py --requests 12`.

Draws rectangles, robots, sensors and targets by seed, plans each, then plays every included classical
policy with its default parameters on the same scenario and the same seeds, without a time limit. A row is printed after
each request: the worst-case undetected time of the best plan and of the best default without collisions, and the
duration of the planning. The last line has the number of requests whose best plan is worse than a default; it should
be 0.
"""

import argparse
import math
import time
from typing import Any

import figures
import numpy as np

from baselines.planning.families import defaults
from baselines.planning.rehearse import play
from baselines.planning.request import Request
from baselines.planning.search import PlanOutcome
from lissajous_env.parameters.assumptions import quietly

COLUMNS = ["request", "best plan", "worst [s]", "best default", "worst [s]", "wall [s]", "CPU [s]", "looks"]


def drawn(seed: int) -> dict[str, Any]:
    """Return the request of a seed, which is passed to `baselines.plan`."""
    random = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(f"{math.exp(random.uniform(math.log(low), math.log(high))):.2g}")

    width, robots = between(2.0, 100.0), int(random.integers(2, 13))
    height = float(f"{width / between(1.0, 5.0):.2g}")
    share = math.sqrt(width * height / robots)  # side of a robot's part of the area
    speed = between(0.3, 5.0)
    return {
        "width": width, "height": height, "robots": robots, "robot_radius": between(0.02, 0.06) * share,
        "sensor_radius": between(0.2, 1.0) * share, "speed": speed, "turning_radius": between(0.04, 0.25) * share,
        "rogue_speed": float(f"{random.choice([0.0, 0.05, 0.1, 0.2, 0.4]) * speed:.2g}"),
    }  # fmt: skip


def in_words(request: dict[str, Any]) -> str:
    """Return a request in one line."""
    turns = f"turns {request['turning_radius']:.2g} m" if "turning_radius" in request else "drives"
    return (
        f"{request['width']:g} m x {request['height']:g} m, {request['robots']} of {request['robot_radius']:.2g} m and "
        f"{request['speed']:g} m/s, r_s {request['sensor_radius']:.2g} m, {turns}, "
        f"targets {request['rogue_speed']:g} m/s"
    )


def row_of(seed: int, **extent: Any) -> tuple[list[str], bool]:
    """Plan a request and play its defaults; return the row, and whether the best plan is worse than a default."""
    request: dict[str, Any] = {name: float(f"{value:.3g}") for name, value in drawn(seed).items()}
    request["robots"] = int(request["robots"])
    outcome = PlanOutcome.of(Request(**request, **extent))
    wall, processors = time.monotonic(), time.process_time()
    outcome.search()
    wall, processors = time.monotonic() - wall, time.process_time() - processors
    (scenario,) = outcome.scenarios.values()
    family, worst_cases = defaults(scenario), {}
    with quietly():
        for settings in family.first:
            try:
                played = play(family.plan(settings), outcome.request.episodes)
            except ValueError:  # a policy that does not fit the scenario
                continue
            if not played.figures.collisions:
                worst_cases[settings["policy"]] = played.figures.worst_case
    best = min(worst_cases, key=worst_cases.__getitem__, default="none")
    plan = outcome.plans[0] if outcome.plans else None
    worst = math.inf if plan is None else plan.figures.worst_case
    name = "none" if plan is None else plan.plan.settings.policy
    row = [f"{seed}: {in_words(request)}, {scenario.task.steps} steps", name, f"{worst:.4g}", best,
           f"{worst_cases[best]:.4g}", f"{wall:.0f}", f"{processors:.0f}", str(outcome.looks)]  # fmt: skip
    return row, worst > worst_cases[best]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--requests", type=int, default=12)
    parser.add_argument("--first", type=int, default=0, help="seed of the first request")
    parser.add_argument("--plans", type=int)
    parser.add_argument("--seconds", type=float)
    options = parser.parse_args()
    rows, worse = [], 0
    for seed in range(options.first, options.first + options.requests):
        row, is_worse = row_of(seed, plans=options.plans, seconds=options.seconds)
        rows.append(row)
        worse += is_worse
        print(" | ".join(row), flush=True)
    figures.show("plans of random requests", {"columns": COLUMNS, "rows": rows})
    print(f"{worse} of {len(rows)} best plans are worse than a default")


if __name__ == "__main__":
    main()
