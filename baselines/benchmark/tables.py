"""The tables that a benchmark prints: scores of each policy, and comparisons with a reference seed by seed."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.text import Text

from baselines.benchmark import clairvoyant
from baselines.benchmark.bounds import Bounds
from baselines.benchmark.comparison import Comparisons
from baselines.benchmark.rows import numbers_of
from baselines.benchmark.shown_columns import COMPARED, OVER_LOWER_BOUND, OVERALL, shown_columns
from baselines.benchmark.statistics import Paired, Statistics
from baselines.benchmark.types import Outcome
from lissajous_env.console import terminal
from lissajous_env.console.terminal import print_left_out, print_line, print_table
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.columns import LARGEST, RECOVERY, WORST_CASE, Column

_DASH = "\N{EM DASH}"
BEST_KNOWN = "best known"
"""Name of the row of the best known plan."""
_TO = "\N{EN DASH}"
_MOST_NAMED = 12
"""Limit on the scenarios that the heading of a table names."""


def print_tables(console: Console, outcome: Outcome, comparisons: Comparisons, said: str = "") -> None:
    """Print tables of each scenario and over all scenarios of a robot kind, failures, and a line about replays."""
    scenarios, settings, cells = outcome.scenarios, outcome.settings, comparisons.cells
    left_out: list[str] = []
    for name, scenario in scenarios.items():
        failed = {failure.policy for failure in outcome.failures if failure.scenario == name}
        shown = shown_columns(scenario, cells.get(name, {}))
        title = _title(scenario, comparisons.bounds[name])
        best_known = comparisons.bounds[name].best_known
        left_out += print_policies(console, title, cells.get(name, {}), shown, failed, best_known)
        left_out += _print_against(console, name, *comparisons.against.get(name, ("", {})))
    for names, policies in comparisons.overall.items():
        count = names.count(",") + 1
        over = names if count <= _MOST_NAMED else f"all {count} scenarios"
        left_out += print_policies(console, Text(f"over {over}", "bold"), policies, OVERALL)
    print_left_out(console, left_out, f"They are in {settings.out}/summary.json, and a wider terminal shows them.")
    for words in _legend(cells, comparisons.bounds, settings.episodes):
        print_line(console, words, "dim")
    shown_here = {name: outcome.theorem[name] for name in scenarios if name in outcome.theorem}
    print_theorem(console, shown_here)
    for refusal in outcome.left_out:
        print_line(console, f"{refusal.policy} is left out on {refusal.scenario}: {refusal.error}", "dim")
    for failure in outcome.failures:
        print_line(console, f"{failure.policy} failed on {failure.scenario}: {failure.error}", "bold red")
    if outcome.failures:
        print_line(console, "Tracebacks are in summary.json.", "red")
    if outcome.kept:
        words = (
            f"{outcome.kept} of {len(outcome.rows)} episodes were already in {settings.out} and were not played "
            "again; to replay them all, delete that folder or choose another --out."
        )
        print_line(console, words, "yellow")
    words = f"{len(outcome.rows)} episodes"
    if len(outcome.held_rows) > len(outcome.rows):
        words += f" requested, {len(outcome.held_rows)} with those of earlier calls,"
    words += f" in {settings.out} (report.html, table.md, episodes.csv, summary.json), {outcome.elapsed:.1f} s"
    print_line(console, words)
    if said:
        print_line(console, said)


def print_policies(
    console: Console,
    title: Text,
    policies: Mapping[str, Mapping[str, Statistics]],
    shown: Sequence[Column],
    failed: Iterable[str] = (),
    best_known: float = math.nan,
) -> list[str]:
    """Print a table with a row for each policy; return the columns for which there was no room.

    Columns without a number of any policy are left out, except for the recovery time, which may never be reached. The
    references are printed below a rule: the clairvoyant, and the best known worst-case undetected time [s].
    """
    shown = [each for each in shown if each is RECOVERY or _has_numbers(policies, each.name)]
    rivals = {name: of for name, of in policies.items() if name != clairvoyant.NAME}
    best = [best_of(list(rivals.values()), each) for each in shown]
    names = [*rivals, *(name for name in failed if name not in rivals and name != clairvoyant.NAME)]
    names += [clairvoyant.NAME] * (clairvoyant.NAME in policies or clairvoyant.NAME in failed)
    rows = []
    for name in names:
        of, marks = policies.get(name), best if name in rivals else [""] * len(shown)
        cells = ["" if of is None else _cell(of, each, mark) for each, mark in zip(shown, marks, strict=True)]
        label = Text(shown_name(name), "" if name != clairvoyant.NAME else "italic")
        rows.append([Text.assemble(label, ("\nfailed", "red")) if name in failed else label, *cells])
    columns = [terminal.Column(_in_two_lines(each.heading), name=each.name) for each in shown]
    references = int(names[-1:] == [clairvoyant.NAME])
    if math.isfinite(best_known) and WORST_CASE in shown:
        rows.append([Text(BEST_KNOWN, "italic"), *(best_known_cell(each, best_known) for each in shown)])
        references += 1
    sections = [len(rows) - references - 1] if 0 < references < len(rows) else []
    _print_title(console, title)
    left_out = print_table(console, [terminal.Column("policy", left=True, style="cyan"), *columns], rows, sections)
    console.print()
    return left_out


def best_known_cell(column: Column, best_known: float) -> str:
    """Return what the row `BEST_KNOWN` has in a column: only its worst-case undetected time is stored [s]."""
    return number(best_known) if column is WORST_CASE else ""


def print_scores(console: Console, policy: str, scenario: str, columns: dict[str, Statistics]) -> list[str]:
    """Print every score of one policy on one scenario as a row; return the columns for which there was no room."""
    _print_title(console, Text.assemble((policy, "bold"), " on ", (scenario, "bold")))
    names = ("summary", "value", "95 % interval", "n", "median", "min", "max", "mean", "std")
    rows = []
    for name, of in columns.items():
        others = (number(value) for value in (of.median, of.min, of.max, of.mean, of.std))
        counted = str(of.n) if of.n_finite == of.n else f"{of.n_finite}/{of.n}"
        counted += f", {of.open} open" if of.open else ""
        interval = between(*of.interval) if of.n_finite > 1 and of.summary != LARGEST else _DASH
        rows.append([name, of.summary, Text(in_words(of)[0], "bold"), interval, counted, *others])
    left_out = print_table(
        console, [terminal.Column("score", left=True, style="cyan"), *map(terminal.Column, names)], rows
    )
    console.print()
    return left_out


def print_row(console: Console, row: dict[str, Any]) -> None:
    """Print one score row as a table."""
    _print_title(
        console, Text.assemble((row["policy"], "bold"), " on ", (row["scenario"], "bold"), f", seed {row['seed']}")
    )
    rows = [[name, number(row[name])] for name in numbers_of(row)]
    print_table(console, [terminal.Column("score", left=True, style="cyan"), terminal.Column("value")], rows)


def print_theorem(console: Console, sentences: Mapping[str, Sequence[str]]) -> None:
    """Print by scenario whether the theorem of the proved filter applies: the result of `theorem.about_theorem`."""
    for scenario, said in sentences.items():
        for words in said:
            print_line(console, f"{scenario}: {words}", "dim" if "not apply" not in words else "yellow")


def shown_name(policy: str) -> str:
    """Return the name of a policy as tables and pictures show it; the clairvoyant reference is put in brackets."""
    return f"({policy})" if policy == clairvoyant.NAME else policy


def number(value: float) -> str:
    """Format a number with three significant digits and at most three decimals; an em dash for NaN."""
    if value != value:
        return _DASH
    if value == math.inf:
        return "infinite"
    if abs(value) >= 1e7:
        return f"{value:.3g}"
    if float(value).is_integer() or abs(value) >= 100:
        return f"{value:.0f}"
    return f"{value:#.3g}" if abs(value) >= 0.9995 else f"{value:.3f}"


def in_words(of: Statistics) -> tuple[str, str]:
    """Return the number that stands for the episodes as tables show it, and its interval ("" if both ends agree).

    Beside a largest value is the median instead, with the number of episodes and of those that are open. A lower bound
    is written `> 59.9`.
    """
    if not of.n_finite:
        return _DASH, ""
    if of.summary != LARGEST:
        return number(of.value), between(*of.interval)
    value = ("> " if of.at_least else "") + number(of.value) if math.isfinite(of.value) else "no bound"
    middle = "open" if math.isinf(of.median) else number(of.median)
    return value, f"median {middle}, n = {of.n_finite}" + (f", {of.open} open" if of.open else "")


def bounds_in_words(bounds: Bounds) -> str:
    """Return the bounds of a scenario in words, each after a comma."""
    words = f", lower bound {number(bounds.mean_time)} s" if math.isfinite(bounds.mean_time) else ""
    words += f", guaranteed at least {number(bounds.worst_case)} s" if math.isfinite(bounds.worst_case) else ""
    if math.isfinite(bounds.best_known):
        words += f", best known {number(bounds.best_known)} s (second halves {number(bounds.best_known_settled)} s)"
    if math.isnan(bounds.in_formation):
        return words
    return f"{words}, in formation " + (
        f"{number(bounds.in_formation)} s" if bounds.in_formation < math.inf else "never"
    )


def _title(scenario: Scenario, bounds: Bounds) -> Text:
    words = f"  N = {scenario.num_robots}, {scenario.detection_time_label} = {scenario.detection_time_bound:.3g} s"
    return Text.assemble((scenario.name, "bold"), words, bounds_in_words(bounds))


def _in_two_lines(title: str) -> str:
    """Break a title where the longer of its two lines is shortest."""
    breaks = [k for k, letter in enumerate(title) if letter == " "]
    if not breaks:
        return title
    at = min(breaks, key=lambda k: max(k, len(title) - k - 1))
    return f"{title[:at]}\n{title[at + 1 :]}"


def _has_numbers(policies: Mapping[str, Mapping[str, Statistics]], column: str) -> bool:
    return any(column in of and of[column].n_finite for of in policies.values())


def _print_against(
    console: Console, scenario: str, reference: str, policies: Mapping[str, Mapping[str, Paired]]
) -> list[str]:
    """Print comparisons with a reference on the same seeds; return the columns for which there was no room."""
    if not policies:
        return []
    columns = [column for column in COMPARED if any(of[column.name].n for of in policies.values())]
    head = [terminal.Column("policy", left=True, style="cyan")]
    for column in columns:
        head.append(terminal.Column(f"{column.heading}\nbetter", name=f"{column.name} better"))
        head.append(terminal.Column("differ-\nence", name=f"{column.name} difference"))
    rows = []
    for name, of in policies.items():
        cells: list[Text | str] = [Text(shown_name(name), "italic" if name == clairvoyant.NAME else "")]
        for column in columns:
            pair = of[column.name]
            share = _two_lines(f"{100 * pair.better:.0f} %", between(pair.better_low, pair.better_high, 100))
            cells.append(share if pair.n else _DASH)
            off = number(pair.difference)
            off = off if off.startswith(("-", _DASH)) or not pair.difference else f"+{off}"
            cells.append(_two_lines(off, between(pair.difference_low, pair.difference_high)))
        rows.append(cells)
    _print_title(console, Text.assemble((scenario, "bold"), " against ", (reference, "bold"), ", seed by seed"))
    left_out = print_table(console, head, rows)
    console.print()
    return left_out


def _legend(cells: Mapping[str, Any], bounds: Mapping[str, Bounds], episodes: int) -> list[str]:
    counted = "1 episode, below it" if episodes == 1 else f"{episodes} episodes, below it"
    of = [of for policies in cells.values() for of in policies.values()]
    words = [
        f"Interquartile mean over {counted} the 95 % bootstrap interval; for collisions and over lower bound, "
        "the mean. * best; (k/n): k of n episodes had a number. Better: share of seeds on which the policy "
        "beats the reference; ties count half."
    ]
    if any(each[WORST_CASE.name].n_finite for each in of):
        words.append(
            "Guaranteed: worst-case undetected time, the largest of n episodes; >: a lower bound, because the worst "
            "case was still growing at the end of open episodes. Difference: of the largest values."
        )
    if any(each[OVER_LOWER_BOUND.name].n_finite for each in of):
        words.append(f"Over lower bound: {OVER_LOWER_BOUND.meaning}.")
    if len(cells) > 1:
        words.append(
            "Detection and guarantee / best: over the best policy on the same scenario and seed. The first is an "
            "interquartile mean over scenarios; those of guarantees are the largest over all episodes of n scenarios, "
            "of which the open ones show no bound."
        )
    if any(math.isfinite(of.best_known) for of in bounds.values()):
        words.append(
            "Best known: the shortest worst-case undetected time of a stored plan without collisions, of 4 episodes; "
            "`lissajous plan` plays these plans."
        )
    if any(clairvoyant.NAME in policies for policies in cells.values()):
        words.append(f"({clairvoyant.NAME}) knows where all targets are; it is a reference, not a competitor.")
    return words


def _print_title(console: Console, title: Text) -> None:
    console.print(title, soft_wrap=True, highlight=False)


def best_of(candidates: Sequence[Mapping[str, Statistics]], column: Column) -> str:
    """Return the best number, as shown, of the policies with most episodes that have one; "" if all agree."""
    known = [of for of in candidates if column.name in of]
    most = max((of[column.name].n_finite / of[column.name].n for of in known), default=0)
    words = {in_words(of[column.name])[0] for of in known}
    if not most or not column.better or len(words) == 1:
        return ""
    eligible = [of for of in known if of[column.name].n_finite == most * of[column.name].n]
    values = [of[column.name].value for of in eligible if not of[column.name].at_least]
    return number(column.better * max(column.better * value for value in values)) if values else ""


def _cell(columns: Mapping[str, Statistics], column: Column, best: str) -> Text:
    of = columns.get(column.name)
    if of is None:
        return Text(_DASH)
    value, beside = in_words(of)
    if not of.n_finite:
        return Text.assemble(value, (f"\n(0/{of.n})", "dim"))
    beside = beside.replace(f", {of.open} open", f",\n{of.open} open") + (
        "" if of.n_finite == of.n else f" ({of.n_finite}/{of.n})"
    )
    is_best = value == best
    return _two_lines(f"{value}{'*' if is_best else ' '}", beside, "bold green" if is_best else "")


def _two_lines(value: str, below: str, style: str = "") -> Text:
    return Text.assemble((value, style), (f"\n{below} ", "dim") if below else "")


def between(low: float, high: float, times: float = 1.0) -> str:
    """Return both ends of an interval as tables show them; "" for NaN, or if both read the same.

    Without an upper end it is `at least` the lower one; without either it is "".

    Args:
        low: lower end.
        high: upper end.
        times: factor by which both ends are shown, as 100 for a percentage.
    """
    if low != low or low == math.inf:
        return ""
    if high == math.inf:
        return f"at least {number(low)}"
    ends = (f"{times * low:.0f}", f"{times * high:.0f}") if times != 1 else (number(low), number(high))
    return "" if ends[0] == ends[1] else (" to " if low < 0 else _TO).join(ends)
