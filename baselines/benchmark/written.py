"""The table of a comparison as text: Markdown for the README and `table.md`, LaTeX for papers."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from baselines.benchmark import clairvoyant
from baselines.benchmark.bounds import Bounds
from baselines.benchmark.comparison import Comparisons
from baselines.benchmark.shown_columns import MAIN, brought_in
from baselines.benchmark.statistics import Paired, Statistics
from baselines.benchmark.tables import (
    BEST_KNOWN,
    best_known_cell,
    best_of,
    between,
    bounds_in_words,
    in_words,
    shown_name,
)
from lissajous_env.world.columns import DETECTION_TIME, WORST_CASE, Column

MARKDOWN = "table.md"
_SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": "$<$", ">": "$>$", "\N{EN DASH}": "--",
    "\N{EM DASH}": "---",
}  # fmt: skip
"""Characters that LaTeX interprets as commands, or prints as another letter."""


def table_of(comparisons: Comparisons) -> dict[str, list]:
    """Return titles and rows of text: a row for each policy, the scenario and its bounds in the first of its rows.

    A number is an interquartile mean with its 95 % bootstrap interval; for collisions and over lower bound, the mean;
    for a guarantee, the largest with its median and number of episodes.
    `sooner` is the share of seeds on which a policy's mean detection time is below that of the reference.
    """
    lines: list[list[str]] = []
    for name, policies in comparisons.cells.items():
        _, against = comparisons.against.get(name, ("", {}))
        where = f"`{name}`{bounds_in_words(comparisons.bounds[name])}"
        for policy, of in policies.items():
            label = f"*{shown_name(policy)}*" if policy == clairvoyant.NAME else f"`{policy}`"
            sooner = _sooner(against[policy][DETECTION_TIME.name]) if policy in against else ""
            lines.append([where, label, *(_cell(of, each) for each in MAIN), sooner])
            where = ""
        known = comparisons.bounds[name].best_known
        if math.isfinite(known):
            lines.append([where, f"*{BEST_KNOWN}*", *(best_known_cell(each, known) for each in MAIN), ""])
    return {"columns": ["scenario", "policy", *(each.heading for each in MAIN), "sooner"], "rows": lines}


def markdown(table: Mapping[str, Sequence[Any]]) -> str:
    """Return a table in Markdown."""
    lines = [table["columns"], ["---"] * len(table["columns"]), *table["rows"]]
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |\n" for line in lines)


def latex(comparisons: Comparisons) -> str:
    r"""Return a table of each scenario in LaTeX, as wide as both columns of a paper; it needs `\usepackage{booktabs}`.

    The best of each column is bold; columns without any number are left out.
    """
    tables = [_paper_table(name, comparisons.bounds[name], policies) for name, policies in comparisons.cells.items()]
    return "\n".join(["% Needs \\usepackage{booktabs}.", *tables])


def _paper_table(scenario: str, bounds: Bounds, policies: Mapping[str, Mapping[str, Statistics]]) -> str:
    columns = [*MAIN, *brought_in(policies.values())]
    columns = [each for each in columns if any(each.name in of and of[each.name].n_finite for of in policies.values())]
    best = [best_of([of for name, of in policies.items() if name != clairvoyant.NAME], each) for each in columns]
    lines = [
        r"\begin{table*}[t]",
        r"\centering\footnotesize\setlength{\tabcolsep}{4pt}",
        rf"\caption{{\texttt{{{_escaped(scenario)}}}{_escaped(bounds_in_words(bounds))}. {_CAPTION}}}",
        rf"\label{{tab:{re.sub(r'[^A-Za-z0-9-]', '-', scenario)}}}",
        rf"\begin{{tabular}}{{@{{}}l{'r' * len(columns)}@{{}}}}",
        r"\toprule",
        f"policy & {' & '.join(_escaped(each.heading) for each in columns)} \\\\",
        r"\midrule",
    ]
    for policy, of in policies.items():
        marks = best if policy != clairvoyant.NAME else [""] * len(columns)
        shown = [_paper_cell(of, each, mark) for each, mark in zip(columns, marks, strict=True)]
        lines.append(f"{_escaped(shown_name(policy))} & {' & '.join(shown)} \\\\")
    known = bounds.best_known
    if math.isfinite(known) and WORST_CASE in columns:
        lines += [r"\midrule", f"{BEST_KNOWN} & {' & '.join(best_known_cell(each, known) for each in columns)} \\\\"]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table*}", ""])


_CAPTION = (
    r"Interquartile mean over the seeds and 95\,\% bootstrap interval; for collisions and over lower bound, the "
    r"mean; for the worst-case undetected time (guaranteed), the largest of $n$ episodes and the median. Bold: the "
    r"best. $>$: a lower bound, as in open episodes the time was still growing at the end."
)


def _paper_cell(of: Mapping[str, Statistics], column: Column, best: str) -> str:
    if column.name not in of or not of[column.name].n_finite:
        return "---"
    value, interval = in_words(of[column.name])
    words = rf"\textbf{{{_escaped(value)}}}" if value == best else _escaped(value)
    return words + (rf" {{\scriptsize({_escaped(interval)})}}" if interval else "")


def _escaped(words: str) -> str:
    return "".join(_SPECIAL.get(letter, letter) for letter in words)


def _cell(of: Mapping[str, Statistics], column: Column) -> str:
    if column.name not in of or not of[column.name].n_finite:
        return ""
    value, interval = in_words(of[column.name])
    return f"{value} ({interval})" if interval else value


def _sooner(pair: Paired) -> str:
    if not pair.n:
        return ""
    share, ends = f"{100 * pair.better:.0f} %", between(pair.better_low, pair.better_high, 100)
    return f"{share} ({ends})" if ends else share
