"""The best plans of random halls with walls, played and computed anew: `python benchmarks/halls.py --store`.

Halls of 2 m to 100 m, two to twelve cars or differential drives, their sensors, bodies and rogues are drawn by seed,
and planned with few plans. The best plan of a hall is played in 64 episodes. This program computes itself, from the
places of the robots alone: the least distances of bodies from walls and from one another, the longest time for which a
robot does not move by its radius, and the worst-case undetected time of the episode with the longest one, on a grid of
its own in float64. The table names every hall that violates a law: a body at or beyond a wall, a collision, a robot
that is stuck, a printed worst case that is not the largest of the episodes, or one that differs from the computed one
by more than two steps and the time in which a rogue crosses a cell of the simulation; for targets at rest, twice the
time in which a robot crosses its diagonal.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import figures
import numpy as np
from planning import drawn, in_words

from baselines.planning.plans import Planned
from baselines.planning.rehearse import BEST_EPISODES
from baselines.planning.request import Request
from baselines.planning.search import PlanOutcome
from lissajous_env.episodes.evaluation import EpisodeRunner
from lissajous_env.parameters.assumptions import quietly
from lissajous_env.world.columns import COLLISIONS, WORST_CASE
from lissajous_env.world.simulation import Simulation

KINDS = "car", "differential"
COLUMNS = ["robots", "halls", "episodes", "with a bound", "wall [radius]", "gap [radius]", "standing [radius]",
           "computed over printed", "violations"]  # fmt: skip
SLOW = 20.0
"""Time in which a robot that is not stuck moves by its radius, in which it drives one at its top speed."""
CELLS = 200_000
"""Cells of the grid of the computed worst case, at most about so many."""


def request_of(seed: int, kind: str) -> dict[str, Any]:
    """Return the request of a hall with robots of a kind, of the same lengths for both kinds."""
    request: dict[str, Any] = {name: float(f"{value:.3g}") for name, value in drawn(seed).items()}
    request["robots"] = int(request["robots"])
    turning = request["turning_radius"]
    if kind == "differential":
        # A drive of this acceleration turns as tightly as the car where its body is as wide as the turn.
        del request["turning_radius"]
        request |= {"robot": kind, "acceleration": float(f"{request['speed'] ** 2 / (2 * turning):.3g}")}
    return request


def played(best: Planned) -> tuple[list[dict[str, Any]], np.ndarray]:
    """Return the score rows of a plan's episodes, and the places (T + 1, W, N, 2) of the robots [m]."""
    scenario, places = best.plan.scenario, []
    simulation = Simulation(scenario, len(best.rows))
    runner = EpisodeRunner(best.plan.settings.make(scenario, len(best.rows)), simulation)
    runner.play(range(len(best.rows)), lambda _: places.append(simulation.robots.position.numpy()[..., :2].copy()))
    return simulation.score(), np.array(places, dtype=float)


def longest_standstill(places: np.ndarray, radius: float) -> int:
    """Return the largest number of steps in which a robot does not move by a radius [m]."""
    longest, since = 0, np.zeros(places.shape[1:3], dtype=int)
    anchor = places[0].copy()
    for place in places[1:]:
        moved = np.linalg.norm(place - anchor, axis=-1) >= radius
        anchor[moved] = place[moved]
        since = np.where(moved, 0, since + 1)
        longest = max(longest, int(since.max()))
    return longest


def worst_time(places: np.ndarray, half: np.ndarray, radius: float, moved: float) -> float:
    """Return the worst-case undetected time of an episode [step], on a grid of this program.

    A rogue hops at the middle of a tick, which has as many steps as let it move by three to five cells along an axis.

    Args:
        places: (T + 1, N, 2) places of the robots [m].
        half: Half width and half height of the hall [m].
        radius: Sensing radius [m].
        moved: Way of a rogue in a step [m].
    """
    side = max(moved / 5, math.sqrt(4 * half.prod() / CELLS))
    ticks = max(math.ceil(3 * side / moved), 1) if moved > 0 else 1
    side = ticks * moved / math.floor(ticks * moved / side) if moved > 0 else side
    shape = np.ceil(2 * half / side).astype(int)
    x, y = ((np.arange(n) + 0.5) * 2 * h / n - h for n, h in zip(shape, half, strict=True))
    reach = ticks * moved / (2 * half / shape) + 1e-9
    away = [(j, i) for j in range(-int(reach[1]), int(reach[1]) + 1) for i in range(-int(reach[0]), int(reach[0]) + 1)
            if (i / max(reach[0], 1)) ** 2 + (j / max(reach[1], 1)) ** 2 <= 1 + 1e-9]  # fmt: skip
    rows, columns, edge = len(y), len(x), np.abs(away).max(axis=0)
    field, longest = np.zeros((rows, columns)), 0.0
    for now in range(len(places)):
        if now > 0 and now % ticks == ticks // 2:
            wide = np.pad(field, [(n, n) for n in edge], constant_values=np.inf)
            for j, i in away:
                part = wide[edge[0] + j : edge[0] + j + rows, edge[1] + i : edge[1] + i + columns]
                np.minimum(field, part, out=field)
        np.minimum(field, now, out=field)
        for sensor in (*(0.5 * (places[now - 1] + places[now]) if now else ()), *places[now]):
            low = [np.searchsorted(at, sensor[k] - radius) for k, at in enumerate((x, y))]
            high = [np.searchsorted(at, sensor[k] + radius) for k, at in enumerate((x, y))]
            near = field[low[1] : high[1], low[0] : high[0]]
            square = (x[low[0] : high[0]] - sensor[0]) ** 2 + (y[low[1] : high[1], None] - sensor[1]) ** 2
            near[square < radius**2] = np.inf
        oldest = field.min()
        longest = max(longest, now - oldest if oldest < math.inf else 0.0)
    return longest


class Result(NamedTuple):
    """Result of the episodes of the best plan of a hall; without a plan, `policy` is empty."""

    hall: str
    kind: str
    policy: str = ""
    printed: float = math.inf
    """Printed worst case [s]; infinite for none."""
    computed: float = math.inf
    """Worst case of the episode with the longest one, on the grid of this program [s]."""
    cell: float = math.inf
    """Largest difference of the two that the sizes of cells and steps explain [s]."""
    wall: float = math.inf
    """Least distance of a body from a wall [radius]."""
    bodies: float = math.inf
    """Least distance of two bodies [radius]."""
    stands: float = 0.0
    """Longest time in which a robot does not move by its radius, in which it drives one at its top speed."""
    violates: tuple[str, ...] = ("no plan",)


def result_of(seed: int, kind: str, plans: int) -> Result:
    """Plan a hall and play its best plan."""
    request = request_of(seed, kind)
    with quietly():
        outcome = PlanOutcome.of(Request(**request, plans=plans))
        outcome.search()
        if not outcome.plans:
            return Result(f"{seed}: {in_words(request)}", kind)
        best = outcome.plans[0]
        rows, places = played(best)
    scenario, printed = best.plan.scenario, best.figures.worst_case
    half, radius = np.array([scenario.curve.half_width, scenario.curve.half_height]), scenario.robot.radius
    step, speed = scenario.task.step, scenario.rogue_speed
    first, second = np.triu_indices(scenario.num_robots, 1)
    apart = np.linalg.norm(places[:, :, first] - places[:, :, second], axis=-1).min()
    times = [row[WORST_CASE.name] for row in rows]
    columns, _ = scenario.task.contamination or (1, 1)
    side = 2 * half[0] / columns
    result = Result(
        hall=f"{seed}: {in_words(request)}",
        kind=kind,
        policy=best.plan.settings.policy,
        printed=printed,
        computed=worst_time(places[:, int(np.argmax(times))], half, scenario.sensing_radius, speed * step) * step,
        cell=2 * step + (side / speed if speed else math.sqrt(8) * side / request["speed"]),
        wall=float((half - np.abs(places)).min()) / radius - 1,
        bodies=float(apart) / radius - 2,
        stands=longest_standstill(places, radius) * step * request["speed"] / radius,
    )
    laws = {
        "wall": result.wall <= 1e-3 or any(row["outside_time"] or row["wall_contacts"] for row in rows),
        "collision": result.bodies <= 0 or any(row[COLLISIONS.name] for row in rows),
        "stuck": result.stands > SLOW or any(row["blocked_time"] for row in rows),
        "largest": len(rows) != BEST_EPISODES or (printed < math.inf and printed != max(times)),
        "worst case": printed < math.inf and abs(result.computed - printed) > result.cell,
    }
    return result._replace(violates=tuple(law for law, broken in laws.items() if broken))


def row_of(kind: str, results: Sequence[Result]) -> list[str]:
    """Return the row of the table of a kind of robots."""
    of_kind = [result for result in results if result.kind == kind]
    bound = [result for result in of_kind if result.printed < math.inf]
    more = [result.computed / result.printed - 1 for result in bound]
    broken = [f"{result.hall.split(':')[0]} ({', '.join(result.violates)})" for result in of_kind if result.violates]
    counts = str(len(of_kind)), str(BEST_EPISODES * len(of_kind)), str(len(bound))
    return [kind, *counts, f"{min(result.wall for result in of_kind):.2g}",
            f"{min(result.bodies for result in of_kind):.2g}", f"{max(result.stands for result in of_kind):.2g}",
            f"{min(more):+.0%} to {max(more):+.0%}", ", ".join(broken) or "none"]  # fmt: skip


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--halls", type=int, default=12, help="halls of each kind of robots")
    parser.add_argument("--first", type=int, default=100, help="seed of the first hall")
    parser.add_argument("--kinds", nargs="*", default=list(KINDS))
    parser.add_argument("--plans", type=int, default=16)
    options = parser.parse_args()
    results = []
    for seed in range(options.first, options.first + options.halls):
        for kind in options.kinds:
            results.append(result_of(seed, kind, options.plans))
            print(results[-1], flush=True)
    table = {"columns": COLUMNS, "rows": [row_of(kind, results) for kind in options.kinds]}
    figures.publish("halls", "best plans of random halls", table, options.store)


if __name__ == "__main__":
    main()
