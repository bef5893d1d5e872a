"""The results table as text: Markdown for the README and `table.md`, LaTeX for papers."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from baselines.benchmark.shown_columns import MAIN, brought_in
from baselines.benchmark.table import Table
from baselines.benchmark.tables import Cell, bounds_in_words, lines_of, pair_in_words, shown_name, with_numbers
from lissajous_env.world.columns import DETECTION_TIME

MARKDOWN = "table.md"
_SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": "$<$", ">": "$>$", "\N{EN DASH}": "--",
    "\N{EM DASH}": "---",
}  # fmt: skip
"""Characters that LaTeX interprets as commands, or prints as another letter."""


def table_of(table: Table) -> dict[str, list]:
    """Return titles and rows of text: a row for each policy, the scenario and its bounds in the first of its rows.

    A number is an interquartile mean with its 95 % bootstrap interval; for collisions and over lower bound, the mean;
    for a guarantee, the largest with its median and number of episodes, or the number of open ones.
    `sooner` is the share of seeds on which a policy's mean detection time is below that of the reference.
    """
    rows: list[list[str]] = []
    for name, policies in table.estimates.items():
        bounds, against = table.bounds[name], table.against.get(name)
        pairs = against.policies if against is not None else {}
        where = f"`{name}`{bounds_in_words(bounds)}"
        for line in lines_of(policies, MAIN, bounds.best_known):
            label = f"*{shown_name(line.name)}*" if line.is_reference else f"`{line.name}`"
            sooner = pair_in_words(pairs[line.name][DETECTION_TIME.name])[0] if line.name in pairs else ""
            rows.append([where, label, *map(str, line.cells), str(sooner)])
            where = ""
    return {"columns": ["scenario", "policy", *(column.heading for column in MAIN), "sooner"], "rows": rows}


def markdown(table: Mapping[str, Sequence[Any]]) -> str:
    """Return a table in Markdown."""
    lines = [table["columns"], ["---"] * len(table["columns"]), *table["rows"]]
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |\n" for line in lines)


def latex(table: Table) -> str:
    r"""Return a table of each scenario in LaTeX, as wide as both columns of a paper; it needs `\usepackage{booktabs}`.

    The best of each column is bold; columns without any number are left out.
    """
    return "\n".join(["% Needs \\usepackage{booktabs}.", *(_paper_table(table, name) for name in table.estimates)])


def _paper_table(table: Table, scenario: str) -> str:
    policies, bounds = table.estimates[scenario], table.bounds[scenario]
    columns = with_numbers(policies, (*MAIN, *brought_in(policies.values())))
    lines = [
        r"\begin{table*}[t]",
        r"\centering\footnotesize\setlength{\tabcolsep}{4pt}",
        rf"\caption{{\texttt{{{_escaped(scenario)}}}{_escaped(bounds_in_words(bounds))}. {_CAPTION}}}",
        rf"\label{{tab:{re.sub(r'[^A-Za-z0-9-]', '-', scenario)}}}",
        rf"\begin{{tabular}}{{@{{}}l{'r' * len(columns)}@{{}}}}",
        r"\toprule",
        f"policy & {' & '.join(_escaped(column.heading) for column in columns)} \\\\",
        r"\midrule",
    ]
    for line in lines_of(policies, columns, bounds.best_known):
        lines.append(f"{_escaped(shown_name(line.name))} & {' & '.join(map(_paper_cell, line.cells))} \\\\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table*}", ""])


_CAPTION = (
    r"Interquartile mean over the seeds and 95\,\% bootstrap interval; for collisions and over lower bound, the "
    r"mean; for the worst-case undetected time (guaranteed), the largest of the episodes and their median. Bold: the "
    r"best. $>$: a lower bound, as in open episodes the time was still growing at the end."
)


def _paper_cell(cell: Cell) -> str:
    words = rf"\textbf{{{_escaped(cell.value)}}}" if cell.is_best else _escaped(cell.value)
    return words + (rf" {{\scriptsize({_escaped(cell.beside)})}}" if cell.beside else "")


def _escaped(words: str) -> str:
    return "".join(_SPECIAL.get(letter, letter) for letter in words)
