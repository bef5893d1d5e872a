"""The table of a comparison as text: in Markdown for the README and `table.md`, in LaTeX for papers."""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from baselines.benchmark import clairvoyant
from baselines.benchmark.comparison import Comparisons, guarantee_of, limit_of
from baselines.benchmark.measures import MEASURES, Measure, measures_of
from baselines.benchmark.statistics import Paired, Statistics
from baselines.benchmark.tables import best_of, between, in_words, number, shown_name
from lissajous_env.parameters.scenario import Scenario

MARKDOWN = "table.md"
MAIN = tuple(each for each in MEASURES if each.main)
_SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": "$<$", ">": "$>$", "\N{EN DASH}": "--",
    "\N{EM DASH}": "---",
}  # fmt: skip
"""What LaTeX would take for a command, or prints as another letter."""


def table_of(comparisons: Comparisons, scenarios: Mapping[str, Scenario]) -> dict[str, list]:
    """Return titles and rows of text: a row for each policy, a scenario's name and limits in the first of its rows.

    A number is an interquartile mean with its 95 % bootstrap interval; of collisions and of what is over the limit, the
    mean. `sooner` is the share of the seeds on which a policy's mean detection time is below that of the reference.
    """
    lines: list[list[str]] = []
    for name, policies in comparisons.cells.items():
        _, against = comparisons.against.get(name, ("", {}))
        where = f"`{name}`{_limits(scenarios[name])}"
        for policy, of in policies.items():
            label = f"*{shown_name(policy)}*" if policy == clairvoyant.NAME else f"`{policy}`"
            sooner = _sooner(against[policy]["detection_time_mean"]) if policy in against else ""
            lines.append([where, label, *(_cell(of, each) for each in MAIN), sooner])
            where = ""
    return {"columns": ["scenario", "policy", *(each.title for each in MAIN), "sooner"], "rows": lines}


def markdown(table: Mapping[str, Sequence[Any]]) -> str:
    """Return a table as Markdown has it."""
    lines = [table["columns"], ["---"] * len(table["columns"]), *table["rows"]]
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |\n" for line in lines)


def latex(comparisons: Comparisons, scenarios: Mapping[str, Scenario]) -> str:
    r"""Return a table of each scenario in LaTeX, over both columns of a paper; they need `\usepackage{booktabs}`.

    The best of each column is bold; columns without any number are left out.
    """
    tables = [_paper_table(scenarios[name], policies) for name, policies in comparisons.cells.items()]
    return "\n".join(["% Needs \\usepackage{booktabs}.", *tables])


def _paper_table(scenario: Scenario, policies: Mapping[str, Mapping[str, Statistics]]) -> str:
    columns = [each for each in measures_of(scenario, policies) if each.main or each not in MEASURES]
    columns = [m for m in columns if any(m.column in of and of[m.column].n_finite for of in policies.values())]
    best = [best_of([of for name, of in policies.items() if name != clairvoyant.NAME], each) for each in columns]
    name = _escaped(scenario.name)
    lines = [
        r"\begin{table*}[t]",
        r"\centering\footnotesize\setlength{\tabcolsep}{4pt}",
        rf"\caption{{\texttt{{{name}}}{_escaped(_limits(scenario))}. {_CAPTION}}}",
        rf"\label{{tab:{re.sub(r'[^A-Za-z0-9-]', '-', scenario.name)}}}",
        rf"\begin{{tabular}}{{@{{}}l{'r' * len(columns)}@{{}}}}",
        r"\toprule",
        f"policy & {' & '.join(_escaped(each.title) for each in columns)} \\\\",
        r"\midrule",
    ]
    for policy, of in policies.items():
        marks = best if policy != clairvoyant.NAME else [""] * len(columns)
        shown = [_paper_cell(of, each, mark) for each, mark in zip(columns, marks, strict=True)]
        lines.append(f"{_escaped(shown_name(policy))} & {' & '.join(shown)} \\\\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table*}", ""])


_CAPTION = (
    r"Interquartile mean over the seeds and 95\,\% bootstrap interval; of collisions and of what is over the limit the "
    r"mean. Bold: the best. $>$: a lower bound."
)


def _paper_cell(of: Mapping[str, Statistics], measure: Measure, best: str) -> str:
    if measure.column not in of or not of[measure.column].n_finite:
        return "---"
    value, interval = in_words(of, measure)
    words = rf"\textbf{{{_escaped(value)}}}" if value == best else _escaped(value)
    return words + (rf" {{\scriptsize({_escaped(interval)})}}" if interval else "")


def _escaped(words: str) -> str:
    return "".join(_SPECIAL.get(letter, letter) for letter in words)


def _cell(of: Mapping[str, Statistics], measure: Measure) -> str:
    if measure.column not in of or not of[measure.column].n_finite:
        return ""
    value, interval = in_words(of, measure)
    return f"{value} ({interval})" if interval else value


def _sooner(pair: Paired) -> str:
    if not pair.n:
        return ""
    share, ends = f"{100 * pair.better:.0f} %", between(pair.better_low, pair.better_high, 100)
    return f"{share} ({ends})" if ends else share


def _limits(scenario: Scenario) -> str:
    limit, (least, formation) = limit_of(scenario), guarantee_of(scenario)
    words = f", limit {number(limit)} s" if limit == limit else ""
    words += f", guarantee at least {number(least)} s" if least > scenario.task.step else ""
    if math.isnan(formation):
        return words
    return words + (f", in formation {number(formation)} s" if formation < math.inf else ", in formation never")
