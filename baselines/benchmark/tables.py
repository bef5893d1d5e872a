"""The tables that a benchmark prints: what each policy scored, and how it compares with a reference seed by seed."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.text import Text

from baselines.benchmark import clairvoyant
from baselines.benchmark.comparison import COMPARED, OVER_LIMIT, Comparisons, guarantee_of, limit_of
from baselines.benchmark.measures import OVERALL_MEASURES, Measure, measures_of, title_of
from baselines.benchmark.rows import numbers_of
from baselines.benchmark.statistics import Paired, Statistics
from baselines.benchmark.types import Outcome
from lissajous_env.console.terminal import Column, print_left_out, print_table
from lissajous_env.parameters.scenario import Scenario

_DASH = "\N{EM DASH}"
_TO = "\N{EN DASH}"


def print_tables(console: Console, outcome: Outcome, comparisons: Comparisons, said: str = "") -> None:
    """Print the tables of each scenario, one over all scenarios of a kind of robot, what failed, and what is said."""
    scenarios, settings, cells = outcome.scenarios, outcome.settings, comparisons.cells
    left_out: list[str] = []
    for name, scenario in scenarios.items():
        failed = {failure.policy for failure in outcome.failures if failure.scenario == name}
        measures = measures_of(scenario, cells.get(name, {}))
        left_out += print_policies(console, _title(scenario), cells.get(name, {}), measures, failed)
        left_out += _print_against(console, name, *comparisons.against.get(name, ("", {})))
    for names, policies in comparisons.overall.items():
        left_out += print_policies(console, Text(f"over {names}", "bold"), policies, OVERALL_MEASURES)
    print_left_out(console, left_out, f"episodes.csv in {settings.out} has them, and a wider terminal shows them.")
    for words in _legend(cells, settings.episodes):
        _say(console, words, "dim")
    for failure in outcome.failures:
        _say(console, f"{failure.policy} failed on {failure.scenario}: {failure.error}", "bold red")
    if outcome.failures:
        _say(console, "Tracebacks are in summary.json.", "red")
    if outcome.kept:
        words = (
            f"{outcome.kept} of {len(outcome.rows)} episodes were in {settings.out} already, not played "
            "again; to play them anew, delete that folder or take another --out."
        )
        _say(console, words, "yellow")
    words = f"{len(outcome.rows)} episodes"
    if len(outcome.held_rows) > len(outcome.rows):
        words += f" asked for, {len(outcome.held_rows)} with those of earlier calls,"
    _say(
        console,
        f"{words} in {settings.out} (report.html, table.md, episodes.csv, summary.json), {outcome.elapsed:.1f} s",
        "",
    )
    if said:
        _say(console, said, "")


def print_policies(
    console: Console,
    title: Text,
    policies: Mapping[str, Mapping[str, Statistics]],
    shown: Sequence[Measure],
    failed: Iterable[str] = (),
) -> list[str]:
    """Print a table with a row for each policy; return the columns there was no room for.

    Columns that no policy has a number for are left out, but for those of what may never come. What is no policy stands
    below a rule.
    """
    shown = [each for each in shown if each.column == "recovery_time" or _has_numbers(policies, each.column)]
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
    columns = [Column(_in_two_lines(each.title), name=each.column) for each in shown]
    sections = [len(names) - 2] if names[-1:] == [clairvoyant.NAME] and len(names) > 1 else []
    _print_title(console, title)
    left_out = print_table(console, [Column("policy", left=True, style="cyan"), *columns], rows, sections)
    console.print()
    return left_out


def print_scores(console: Console, policy: str, scenario: str, columns: dict[str, Statistics]) -> list[str]:
    """Print every score of one policy on one scenario as a row; return the columns there was no room for."""
    _print_title(console, Text.assemble((policy, "bold"), " on ", (scenario, "bold")))
    names = ("interquartile mean", "95 % interval", "n", "mean", "std", "min", "max")
    rows = []
    for name, of in columns.items():
        mean, std, least, most = (number(value) for value in (of.mean, of.std, of.min, of.max))
        counted = str(of.n) if of.n_finite == of.n else f"{of.n_finite}/{of.n}"
        value, ends = in_words(columns, Measure(name, name, 0))
        interval = ends if of.n_finite > 1 else _DASH
        rows.append([name, Text(value, "bold"), interval, counted, mean, std, least, most])
    left_out = print_table(console, [Column("score", left=True, style="cyan"), *map(Column, names)], rows)
    console.print()
    return left_out


def print_row(console: Console, row: dict[str, Any]) -> None:
    """Print one score row as a table."""
    _print_title(
        console, Text.assemble((row["policy"], "bold"), " on ", (row["scenario"], "bold"), f", seed {row['seed']}")
    )
    rows = [[name, number(row[name])] for name in numbers_of(row)]
    print_table(console, [Column("score", left=True, style="cyan"), Column("value")], rows)


def shown_name(policy: str) -> str:
    """Name of a policy as tables and pictures show it; of what is none, in brackets."""
    return f"({policy})" if policy == clairvoyant.NAME else policy


def number(value: float) -> str:
    """Three significant digits, but no more than three decimals; an em dash for NaN."""
    if value != value:
        return _DASH
    if abs(value) >= 1e7:
        return f"{value:.3g}"
    if float(value).is_integer() or abs(value) >= 100:
        return f"{value:.0f}"
    return f"{value:#.3g}" if abs(value) >= 0.9995 else f"{value:.3f}"


def in_words(of: Mapping[str, Statistics], shown: Measure) -> tuple[str, str]:
    """A number as tables show it, and its interval ("" for one that is a single number).

    A lower bound, as of a guarantee that is open in many episodes, is written `> 59.7`.
    """
    cell = of[shown.column]
    if not cell.n_finite:
        return _DASH, ""
    if shown.mean:
        return number(cell.mean), between(cell.mean_low, cell.mean_high)
    value, interval = number(cell.iqm), between(cell.low, cell.high)
    if cell.at_least:
        return f"> {value}", "" if number(cell.low) == value else interval
    return value, interval


def _title(scenario: Scenario) -> Text:
    words = f"  N = {scenario.num_robots}, {scenario.detection_time_label} = {scenario.detection_time_bound:.3g} s"
    limit, (least, formation) = limit_of(scenario), guarantee_of(scenario)
    words += f", limit {number(limit)} s" if math.isfinite(limit) else ""
    words += f", guarantee at least {number(least)} s" if math.isfinite(least) else ""
    words += f", in formation {number(formation)} s" if math.isfinite(formation) else ""
    return Text.assemble((scenario.name, "bold"), words)


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
    """Print how the policies compare with a reference on the same seeds; return what there was no room for."""
    if not policies:
        return []
    columns = [column for column in COMPARED if any(of[column].n for of in policies.values())]
    head = [Column("policy", left=True, style="cyan")]
    for column in columns:
        title = title_of(column)
        head += [Column(f"{title}\nbetter", name=f"{column} better"), Column("differ-\nence", name=f"{column} less")]
    rows = []
    for name, of in policies.items():
        cells: list[Text | str] = [Text(shown_name(name), "italic" if name == clairvoyant.NAME else "")]
        for column in columns:
            pair = of[column]
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


def _legend(cells: Mapping[str, Any], episodes: int) -> list[str]:
    counted = "1 episode, below it" if episodes == 1 else f"{episodes} episodes, below it"
    words = [
        f"Interquartile mean over {counted} the 95 % bootstrap interval; collisions and what is over the limit: mean. "
        "* best; (k/n): k of n episodes had a number. Better: share of the seeds on which a policy is, ties half."
    ]
    of = [of for policies in cells.values() for of in policies.values()]
    if any(each[OVER_LIMIT].n_finite for each in of):
        words.append(
            "Over limit: mean detection time over a lower bound, which no policy beats that sees no rogue afar."
        )
    if any(
        each["guaranteed_detection_time"].at_least or each["guaranteed_detection_time"].high == math.inf for each in of
    ):
        words.append(
            "Guaranteed: no rogue stays unseen longer, whatever it does; >: a lower bound, as too many episodes ended "
            "while that time was still growing; at least: the interval has no upper end."
        )
    if any(clairvoyant.NAME in policies for policies in cells.values()):
        words.append(f"({clairvoyant.NAME}) is no policy: it sees every rogue from the moment it appears.")
    return words


def _print_title(console: Console, title: Text) -> None:
    console.print(title, soft_wrap=True, highlight=False)


def _say(console: Console, words: str, style: str) -> None:
    console.print(words, style=style, markup=False, highlight=False, soft_wrap=True)


def best_of(candidates: Sequence[Mapping[str, Statistics]], shown: Measure) -> str:
    """Return the best number, as shown, of the policies with most episodes that have one; "" if all agree."""
    counted = [of[shown.column] for of in candidates if shown.column in of]
    most = max((of.n_finite / of.n for of in counted), default=0)
    eligible = [
        of for of in candidates if shown.column in of and of[shown.column].n_finite == most * of[shown.column].n
    ]
    words = {in_words(of, shown)[0] for of in candidates if shown.column in of}
    if not most or not shown.better or len(words) == 1:
        return ""
    closed = [of for of in eligible if not in_words(of, shown)[0].startswith(">")]
    values = [of[shown.column].mean if shown.mean else of[shown.column].iqm for of in closed]
    return number(shown.better * max(shown.better * value for value in values)) if values else ""


def _cell(columns: Mapping[str, Statistics], shown: Measure, best: str) -> Text:
    of = columns.get(shown.column)
    if of is None:
        return Text(_DASH)
    value, interval = in_words(columns, shown)
    if not of.n_finite:
        return Text.assemble(value, (f"\n(0/{of.n})", "dim"))
    counted = "" if of.n_finite == of.n else f" ({of.n_finite}/{of.n})"
    is_best = value == best
    return _two_lines(f"{value}{'*' if is_best else ' '}", f"{interval}{counted}", "bold green" if is_best else "")


def _two_lines(value: str, below: str, style: str = "") -> Text:
    return Text.assemble((value, style), (f"\n{below} ", "dim") if below else "")


def between(low: float, high: float, times: float = 1.0) -> str:
    """Both ends as tables show them, in units of 1 / `times`; "" for NaN and where both read the same.

    Without an upper end it is `at least` the lower one.
    """
    if low != low:
        return ""
    if high == math.inf:
        return f"at least {number(low)}"
    ends = (f"{times * low:.0f}", f"{times * high:.0f}") if times != 1 else (number(low), number(high))
    return "" if ends[0] == ends[1] else (" to " if low < 0 else _TO).join(ends)
