"""The results table in lines, and in the terminal."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from rich.console import Console
from rich.text import Text

from baselines.benchmark.best_known import BEST_KNOWN
from baselines.benchmark.results_folder import CSV, MARKDOWN, REPORT, SUMMARY
from baselines.benchmark.statistics import (
    DASH,
    OVER_LOWER_BOUND,
    OVERALL,
    SCORE_OVER_BEST,
    WORST_CASE_OVER_BEST,
    Estimate,
    best_of,
    between,
    columns_of,
    in_words,
    number,
    score_names,
    with_numbers,
)
from baselines.benchmark.table import Table
from baselines.benchmark.theorem import DOES_NOT_APPLY
from baselines.benchmark.types import BenchmarkOutcome
from lissajous_env.console import terminal
from lissajous_env.console.terminal import print_line, print_table
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import counted
from lissajous_env.world.columns import LARGEST, WORST_CASE, Column, task_score

_MOST_NAMED = 12
"""Limit on the scenarios that the heading of a table names."""


class Entry(NamedTuple):
    """Entry of a table: an estimate in words."""

    value: str = ""
    beside: str = ""
    """Interval, or median and counts, in brackets after the value."""
    is_best: bool = False

    def __str__(self) -> str:
        return f"{self.value} ({self.beside})" if self.beside else self.value


class Line(NamedTuple):
    """A line of a table: a policy, or the best known worst-case time, which does not compete."""

    name: str
    entries: list[Entry]
    is_best_known: bool = False


def lines_of(
    policies: Mapping[str, Mapping[str, Estimate]],
    columns: Sequence[Column],
    best_known: float = math.nan,
) -> list[Line]:
    """Return the lines of a table: the policies, then the best known worst-case time [s].

    Args:
        policies: Estimates by policy and column.
        columns: Columns of the table.
        best_known: `Bounds.best_known`.
    """
    best = {column: best_of(policies, column) for column in columns}
    lines = [
        Line(name, [_entry(estimates.get(column.name), name in best[column]) for column in columns])
        for name, estimates in policies.items()
    ]
    if math.isfinite(best_known) and WORST_CASE in columns:
        known = [Entry(number(best_known)) if column is WORST_CASE else Entry() for column in columns]
        lines.append(Line(BEST_KNOWN, known, True))
    return lines


def _entry(estimate: Estimate | None, is_best: bool) -> Entry:
    if estimate is None:
        return Entry(DASH)
    value, beside = in_words(estimate)
    count = f"{estimate.known}/{estimate.n}" if 0 < estimate.known < estimate.n else ""
    return Entry(value, ", ".join(filter(None, (beside, count))), is_best)


def print_outcome(console: Console, outcome: BenchmarkOutcome, note: str = "") -> None:
    """Print tables of each scenario and over all scenarios of a robot kind, failures, and a line about replays."""
    out, table = outcome.settings.out, outcome.table
    where = f"They are in {out}/{SUMMARY}"
    for name, policies in table.estimates.items():
        scenario, bounds = table.scenarios[name], table.bounds[name]
        columns = columns_of(scenario, policies)
        bound = f", {scenario.detection_time_label} = {scenario.detection_time_bound:.3g} s"
        words = f"  N = {scenario.num_robots}{bound if scenario.has_formation else ''}"
        title = Text.assemble((name, "bold"), words, bounds.in_words())
        print_lines(console, title, columns, lines_of(policies, columns, bounds.best_known), where)
    for overall in table.overall:
        count, columns = len(overall.scenarios), with_numbers(overall.policies, OVERALL)
        names = ", ".join(overall.scenarios) if count <= _MOST_NAMED else f"all {count} scenarios"
        print_lines(console, Text(f"over {names}", "bold"), columns, lines_of(overall.policies, columns), where)
    for words in legend(table):
        print_line(console, words, "dim")
    print_theorem(console, outcome.theorem)
    for refusal in outcome.left_out:
        print_line(console, f"{refusal.policy} is left out on {refusal.scenario}: {refusal.error}", "dim")
    for failure in outcome.failures:
        verb = "refused" if failure.is_refusal else "failed on"
        print_line(console, f"{failure.policy} {verb} {failure.scenario}: {failure.error}", "bold red")
    if outcome.failures:
        print_line(console, f"Tracebacks are in {SUMMARY}.", "red")
    if outcome.resumed:
        played = f"{outcome.resumed} of {len(outcome.rows)} episodes were already in {out} and were not played again"
        print_line(console, f"{played}; to replay them all, delete that folder or choose another --out.", "yellow")
    files = ", ".join((REPORT, MARKDOWN, CSV, SUMMARY))
    print_line(console, f"{counted(len(table.rows), 'episode')} in {out} ({files}), {outcome.elapsed:.1f} s")
    if note:
        print_line(console, note)


def print_lines(
    console: Console, title: Text, columns: Sequence[Column], lines: Sequence[Line], where: str = "--json has them"
) -> None:
    """Print a table, the best known time below a rule; `where` names the place of the columns that do not fit."""
    rows = []
    for line in lines:
        label = Text(line.name, "italic" if line.is_best_known else "")
        rows.append([label, *(_in_two_lines(entry) for entry in line.entries)])
    head = [terminal.Column("policy", left=True, style="cyan")]
    head += [terminal.Column(_broken(column.heading), name=column.name) for column in columns]
    rivals = sum(not line.is_best_known for line in lines)
    print_line(console, title)
    print_table(console, head, rows, [rivals - 1] if 0 < rivals < len(rows) else [], where)
    console.print()


def _in_two_lines(entry: Entry) -> Text:
    value = (f"{entry.value}{'*' if entry.is_best else ' '}", "bold green" if entry.is_best else "")
    return Text.assemble(value, (f"\n{entry.beside} ", "dim") if entry.beside else "")


def print_scores(console: Console, policy: str, scenario: Scenario, columns: Mapping[str, Estimate]) -> None:
    """Print a row for every column of one policy on one scenario that has numbers, the score of the task first."""
    print_line(console, Text.assemble((policy, "bold"), " on ", (scenario.name, "bold")))
    names = ("value", "95 % interval", "n", "worst seed", "median", "min", "max")
    rows = []
    # A policy that is alone is the best one.
    alone = {SCORE_OVER_BEST.name, WORST_CASE_OVER_BEST.name}
    for name in dict.fromkeys((task_score(scenario).name, *columns)):
        estimate = columns[name]
        if not estimate.known or name in alone:
            continue
        count = str(estimate.n) if estimate.known == estimate.n else f"{estimate.known}/{estimate.n}"
        count += f", {estimate.open} open" if estimate.open else ""
        is_equal = estimate.n > 1 and estimate.min == estimate.max
        worst = DASH if estimate.worst is None or is_equal else str(estimate.worst)
        infinite = "no bound" if estimate.summary == LARGEST else "infinite"
        spread = [number(end).replace("infinite", infinite) for end in (estimate.median, estimate.min, estimate.max)]
        others = (between(estimate.low, estimate.high) or DASH, count, worst, *spread)
        rows.append([name, estimate.summary, Text(in_words(estimate)[0], "bold"), *others])
    first = terminal.Column("score", left=True, style="cyan"), terminal.Column("summary", rank=1)
    print_table(console, [*first, *names], rows)
    console.print()


def print_row(console: Console, row: dict[str, Any], scenario: Scenario) -> None:
    """Print the numbers of one score row as a table, the score of the task first."""
    title = Text.assemble((row["policy"], "bold"), " on ", (row["scenario"], "bold"), f", seed {row['seed']}")
    print_line(console, title)
    names = dict.fromkeys((task_score(scenario).name, *score_names(row)))
    rows = [[name, number(row[name])] for name in names if row[name] == row[name]]
    print_table(console, [terminal.Column("score", left=True, style="cyan"), "value"], rows)


def print_theorem(console: Console, sentences: Mapping[str, Sequence[str]]) -> None:
    """Print by scenario whether the theorem of the proved filter applies: the result of `about_theorem`."""
    for scenario, of_scenario in sentences.items():
        for words in of_scenario:
            print_line(console, f"{scenario}: {words}", "yellow" if DOES_NOT_APPLY in words else "dim")


def _broken(title: str) -> str:
    """Break a title where the longer of its two lines is shortest."""
    words = title.split(" ")
    in_two = [(" ".join(words[:k]), " ".join(words[k:])) for k in range(1, len(words))]
    return "\n".join(min(in_two, key=lambda lines: max(map(len, lines)), default=(title,)))


def legend(table: Table) -> list[str]:
    """Return sentences that explain the numbers of a table."""
    of_policies = [estimates for policies in table.estimates.values() for estimates in policies.values()]
    counts = sorted({estimates[WORST_CASE.name].n for estimates in of_policies})
    episodes = f"{counts[0]:,} to {counts[-1]:,} episodes" if len(counts) > 1 else counted(sum(counts), "episode")
    words = [
        f"Interquartile mean over {episodes}, below it the 95 % bootstrap interval, which is too narrow for fewer than "
        "8; for collisions and over lower bound, the mean. * best; k/n: k of n episodes had a number."
    ]
    if table.references:
        names = ", ".join(dict.fromkeys(table.references.values()))
        words.append(f"Better: share of seeds on which the first column is better than with {names}; ties count half.")
    if any(estimates[WORST_CASE.name].known for estimates in of_policies):
        words.append(
            "Guaranteed: worst-case undetected time, the largest of n episodes; >: a lower bound, because the worst "
            "case was still growing at the end of open episodes."
        )
    if any(estimates[OVER_LOWER_BOUND.name].known for estimates in of_policies):
        words.append(f"Over lower bound: {OVER_LOWER_BOUND.meaning}.")
    if table.overall:
        words.append(
            "Over scenarios: n is a number of scenarios, each with the mean of its episodes or its largest guarantee; "
            "score and guarantee / best: over the best policy on the same scenario and seed."
        )
    if any(math.isfinite(bounds.best_known) for bounds in table.bounds.values()):
        words.append(
            "Best known: the shortest worst-case undetected time of a stored plan without collisions, of 4 episodes; "
            "`lissajous plan` plays these plans."
        )
    return words
