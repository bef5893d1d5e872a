"""Plans that no other plan dominates."""

from collections.abc import Sequence

from baselines.planning.plans import Planned


def dominates(one: Sequence[float], other: Sequence[float]) -> bool:
    """Return whether the objectives of one are nowhere worse than those of another, and somewhere better."""
    return all(a <= b for a, b in zip(one, other, strict=True)) and tuple(one) != tuple(other)


def pareto_optimal(planned: Sequence[Planned]) -> list[Planned]:
    """Return the plans without collisions that none of these dominates, by their worst-case undetected time.

    Of plans with equal objectives the first is returned.
    """
    safe = [each for each in planned if each.figures.collisions == 0]
    of = [_objectives(each) for each in safe]
    kept = [
        each for k, each in enumerate(safe) if not any(dominates(other, of[k]) for other in of) and of[k] not in of[:k]
    ]
    return sorted(kept, key=_objectives)


def _objectives(each: Planned) -> tuple[float, ...]:
    """Return the objectives of a plan; where plans differ in their number of robots, fewer are better."""
    return (*each.figures.objectives, float(each.plan.scenario.num_robots))
