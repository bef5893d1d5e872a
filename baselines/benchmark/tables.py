"""The results table in the terminal."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.text import Text

from baselines.benchmark.shown import (
    DASH,
    OVER_LOWER_BOUND,
    OVERALL,
    SCORE_OVER_BEST,
    WORST_CASE_OVER_BEST,
    Entry,
    Line,
    between,
    bounds_in_words,
    in_words,
    lines_of,
    number,
    numbers_of,
    shown_columns,
    with_numbers,
)
from baselines.benchmark.statistics import Estimate
from baselines.benchmark.table import Table
from baselines.benchmark.types import Outcome
from lissajous_env.console import terminal
from lissajous_env.console.terminal import print_line, print_table
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import WORST_CASE, Column, task_score

_MOST_NAMED = 12
"""Limit on the scenarios that the heading of a table names."""


def print_tables(console: Console, outcome: Outcome, table: Table, said: str = "") -> None:
    """Print tables of each scenario and over all scenarios of a robot kind, failures, and a line about replays.

    Args:
        console: The console.
        outcome: Result of the benchmark.
        table: Table of the rows that this call requested.
        said: Line about replays.
    """
    out = outcome.settings.out
    where = f"They are in {out}/summary.json"
    for name, scenario in outcome.scenarios.items():
        policies, bounds = table.estimates.get(name, {}), table.bounds[name]
        shown = shown_columns(scenario, policies)
        failed = [failure.policy for failure in outcome.failures if failure.scenario == name]
        words = f"  N = {scenario.num_robots}, {scenario.detection_time_label} = {scenario.detection_time_bound:.3g} s"
        title = Text.assemble((name, "bold"), words, bounds_in_words(bounds))
        print_lines(console, title, shown, lines_of(policies, shown, bounds.best_known, failed), where)
    for of in table.overall:
        count, shown = len(of.scenarios), with_numbers(of.policies, OVERALL)
        title = Text(f"over {', '.join(of.scenarios) if count <= _MOST_NAMED else f'all {count} scenarios'}", "bold")
        print_lines(console, title, shown, lines_of(of.policies, shown), where)
    for words in legend(table, outcome.settings.episodes):
        print_line(console, words, "dim")
    print_theorem(console, {name: outcome.theorem.get(name, []) for name in outcome.scenarios})
    for refusal in outcome.left_out:
        print_line(console, f"{refusal.policy} is left out on {refusal.scenario}: {refusal.error}", "dim")
    for failure in outcome.failures:
        print_line(console, f"{failure.policy} failed on {failure.scenario}: {failure.error}", "bold red")
    if outcome.failures:
        print_line(console, "Tracebacks are in summary.json.", "red")
    if outcome.resumed:
        words = (
            f"{outcome.resumed} of {len(outcome.rows)} episodes were already in {out} and were not played again; "
            "to replay them all, delete that folder or choose another --out."
        )
        print_line(console, words, "yellow")
    words = f"{len(outcome.rows)} episodes"
    if len(outcome.table.rows) > len(outcome.rows):
        words += f" requested, {len(outcome.table.rows)} with those of earlier calls,"
    files = "report.html, table.md, episodes.csv, summary.json"
    print_line(console, f"{words} in {out} ({files}), {outcome.elapsed:.1f} s")
    if said:
        print_line(console, said)


def print_lines(
    console: Console, title: Text, columns: Sequence[Column], lines: Sequence[Line], where: str = "--json has them"
) -> None:
    """Print a table, the references below a rule; `where` tells the place of columns for which there is no room."""
    rows = []
    for line in lines:
        label = Text(line.name, "italic" if line.is_reference else "")
        label = Text.assemble(label, ("\nfailed", "red")) if line.has_failed else label
        rows.append([label, *(_in_two_lines(entry) for entry in line.entries)])
    head = [terminal.Column("policy", left=True, style="cyan")]
    head += [terminal.Column(_broken(column.heading), name=column.name) for column in columns]
    rivals = sum(not line.is_reference for line in lines)
    _print_title(console, title)
    print_table(console, head, rows, [rivals - 1] if 0 < rivals < len(rows) else [], where)
    console.print()


def _in_two_lines(entry: Entry) -> Text:
    value = (f"{entry.value}{'*' if entry.is_best else ' '}", "bold green" if entry.is_best else "")
    return Text.assemble(value, (f"\n{entry.beside} ", "dim") if entry.beside else "")


def print_scores(console: Console, policy: str, scenario: Scenario, columns: Mapping[str, Estimate]) -> None:
    """Print a row for every column of one policy on one scenario that has numbers, the score of the task first."""
    _print_title(console, Text.assemble((policy, "bold"), " on ", (scenario.name, "bold")))
    names = ("summary", "value", "95 % interval", "n", "worst seed", "median", "min", "max")
    rows = []
    # A policy that is alone is the best one.
    alone = {SCORE_OVER_BEST.name, WORST_CASE_OVER_BEST.name}
    for name in dict.fromkeys((task_score(scenario).name, *columns)):
        of = columns[name]
        if not of.known or name in alone:
            continue
        counted = str(of.n) if of.known == of.n else f"{of.known}/{of.n}"
        counted += f", {of.open} open" if of.open else ""
        worst = DASH if of.worst is None else str(of.worst)
        others = (between(of.low, of.high) or DASH, counted, worst, *map(number, (of.median, of.min, of.max)))
        rows.append([name, of.summary, Text(in_words(of)[0], "bold"), *others])
    print_table(console, [terminal.Column("score", left=True, style="cyan"), *map(terminal.Column, names)], rows)
    console.print()


def print_row(console: Console, row: dict[str, Any], scenario: Scenario) -> None:
    """Print the numbers of one score row as a table, the score of the task first."""
    _print_title(
        console, Text.assemble((row["policy"], "bold"), " on ", (row["scenario"], "bold"), f", seed {row['seed']}")
    )
    names = dict.fromkeys((task_score(scenario).name, *numbers_of(row)))
    rows = [[name, number(row[name])] for name in names if row[name] == row[name]]
    print_table(console, [terminal.Column("score", left=True, style="cyan"), terminal.Column("value")], rows)


def print_theorem(console: Console, sentences: Mapping[str, Sequence[str]]) -> None:
    """Print by scenario whether the theorem of the proved filter applies: the result of `about_theorem`."""
    for scenario, said in sentences.items():
        for words in said:
            print_line(console, f"{scenario}: {words}", "dim" if "not apply" not in words else "yellow")


def _broken(title: str) -> str:
    """Break a title where the longer of its two lines is shortest."""
    breaks = [k for k, letter in enumerate(title) if letter == " "]
    if not breaks:
        return title
    at = min(breaks, key=lambda k: max(k, len(title) - k - 1))
    return f"{title[:at]}\n{title[at + 1 :]}"


def legend(table: Table, episodes: int) -> list[str]:
    """Return sentences that explain the numbers of a table."""
    counted = "1 episode, below it" if episodes == 1 else f"{episodes} episodes, below it"
    of = [of for policies in table.estimates.values() for of in policies.values()]
    words = [
        f"Interquartile mean over {counted} the 95 % bootstrap interval; for collisions and over lower bound, "
        "the mean. * best; k/n: k of n episodes had a number."
    ]
    if table.references:
        names = ", ".join(dict.fromkeys(table.references.values()))
        words.append(f"Better: share of seeds on which the first column is better than with {names}; ties count half.")
    if any(estimates[WORST_CASE.name].known for estimates in of):
        words.append(
            "Guaranteed: worst-case undetected time, the largest of n episodes; >: a lower bound, because the worst "
            "case was still growing at the end of open episodes."
        )
    if any(estimates[OVER_LOWER_BOUND.name].known for estimates in of):
        words.append(f"Over lower bound: {OVER_LOWER_BOUND.meaning}.")
    if table.overall:
        words.append(
            "Over scenarios: a scenario counts once, with the mean of its episodes or its largest guarantee; score and "
            "guarantee / best: over the best policy on the same scenario and seed."
        )
    if any(math.isfinite(bounds.best_known) for bounds in table.bounds.values()):
        words.append(
            "Best known: the shortest worst-case undetected time of a stored plan without collisions, of 4 episodes; "
            "`lissajous plan` plays these plans."
        )
    return words


def _print_title(console: Console, title: Text) -> None:
    console.print(title, soft_wrap=True, highlight=False)
