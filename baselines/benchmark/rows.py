"""Score rows, grouped, and checked column by column, by the same rules when they are read and when they are written."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import COLUMNS, FINITE, IDENTITY, NAMES, WHOLE, Column

Rows = Sequence[dict[str, Any]]


def grouped(rows: Iterable[dict[str, Any]]) -> dict[str, dict[str, Rows]]:
    """Return score rows by scenario and policy."""
    found: dict[str, dict[str, Any]] = {}
    for row in rows:
        found.setdefault(row["scenario"], {}).setdefault(row["policy"], []).append(row)
    return found


def by_kind(rows: Iterable[dict[str, Any]], scenarios: Mapping[str, Scenario]) -> dict[str, dict[str, dict[str, Rows]]]:
    """Return score rows by kind of robots, policy and scenario, of the policies that played all scenarios of the kind.

    The scenarios are those of which there are rows, in the order of `scenarios`. Kinds without such a policy are left
    out.
    """
    played, found = grouped(rows), {}
    for kind in dict.fromkeys(scenario.robot.kind for scenario in scenarios.values()):
        names = [name for name, scenario in scenarios.items() if name in played and scenario.robot.kind == kind]
        policies = [p for p in played[names[0]] if all(p in played[name] for name in names)] if names else []
        if policies:
            found[kind] = {policy: {name: played[name][policy] for name in names} for policy in policies}
    return found


def column_of(name: str) -> Column:
    """Return the column of a score row with this name, or one that describes a column of a scenario's own."""
    return COLUMNS.get(name) or Column(name, "a score column that the scenario adds", rule=FINITE, empty="none")


def numbers_of(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the numbers of a score row, those that its scenario adds among them."""
    return tuple(name for name in row if name not in IDENTITY)


def refusal_of(row: Any, brought: Sequence[str] = ()) -> str | None:
    """Return the rule that a score row violates, as JSON represents one; None for a valid row.

    Args:
        row: the row to check.
        brought: names of the columns that the scenario adds, in their order.
    """
    if tuple(row) != (*NAMES, *brought):
        return "must have the columns of a score row"
    for name in ("scenario", "policy"):
        if not isinstance(row[name], str):
            return f"{name} must be a text, got {row[name]!r}"
    for name in ("episode", "seed"):
        if not WHOLE.accepts(row[name]):
            return f"{name} must be {WHOLE.words}, got {short(row[name])}"
    for name in (*COLUMNS, *brought):
        if wrong := column_of(name).refusal(row[name]):
            return f"{name} {wrong}, got {short(row[name])}"
    return None


def short(value: Any) -> str:
    """Return a value in a few words, however large it is."""
    try:
        words = repr(value)
    except (ValueError, RecursionError):  # a whole number of more digits than Python prints, or deep nesting
        return f"a {type(value).__name__} too long to print"
    return words if len(words) <= 60 else f"{words[:60]}..."
