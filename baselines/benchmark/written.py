"""The results table as files: CSV of its rows, JSON, Markdown for the README, and LaTeX for papers."""

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from baselines.benchmark.results_folder import CSV, MARKDOWN, SUMMARY
from baselines.benchmark.shown import Entry, lines_of
from baselines.benchmark.statistics import MAIN, added_columns, columns_of, with_numbers
from baselines.benchmark.table import Table
from baselines.benchmark.types import BenchmarkOutcome
from lissajous_env.console.terminal import plain
from lissajous_env.identity import command, machine, versions
from lissajous_env.storage.folder import Folder
from lissajous_env.world.columns import NAMES, task_score

_SPECIAL = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": "$<$", ">": "$>$", "\N{EN DASH}": "--",
    "\N{EM DASH}": "---", "[": "{[}",
}  # fmt: skip
"""Characters that LaTeX interprets as commands, or after a row as its option, or prints as another letter."""


def write_files(folder: Folder, outcome: BenchmarkOutcome, rows: Sequence[dict[str, Any]]) -> None:
    """Write episodes.csv, summary.json and table.md of all episodes in the folder, of which `rows` are the scores."""
    folder.write(CSV, as_csv(rows))
    folder.write(SUMMARY, json.dumps(plain(summarized(outcome)), indent=2, allow_nan=False) + "\n")
    folder.write(MARKDOWN, markdown(table_of(outcome.table)))


def summarized(outcome: BenchmarkOutcome) -> dict[str, Any]:
    """Return the content of summary.json; the failures are those of this call.

    `statistics` has the estimates by scenario, policy and column, `overall` those over the scenarios of a kind of
    robots, and `references` the policy of each scenario with which the others are compared.
    """
    stored, table = outcome.stored, outcome.table
    return {
        "machine": machine(stored["device"]),
        "versions": versions(),
        "command": command(),
        "elapsed_s": outcome.elapsed,
        "seeds": sorted({row["seed"] for row in table.rows}),
        "settings": stored,
        "bounds": {name: bounds._asdict() for name, bounds in table.bounds.items()},
        "references": table.references,
        "statistics": table.estimates,
        "overall": table.overall,
        "failures": outcome.failures,
        "left_out": outcome.left_out,
    }


def as_csv(rows: Iterable[dict[str, Any]]) -> str:
    """Return score rows as CSV: `lissajous_env.world.columns.NAMES`, then columns of scenarios; NaN is empty."""
    rows, text = list(rows), io.StringIO()
    columns = dict.fromkeys((*NAMES, *(name for row in rows for name in row)))
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: "" if value != value else value for name, value in row.items()} for row in rows)
    return text.getvalue()


def table_of(table: Table) -> dict[str, list]:
    """Return titles and rows of text: a row for each policy, the scenario and its bounds in the first of its rows.

    `baselines.benchmark.statistics.in_words` describes the numbers.
    """
    rows: list[list[str]] = []
    scores = map(task_score, table.scenarios.values())
    of_policies = dict(enumerate(of for policies in table.estimates.values() for of in policies.values()))
    columns = with_numbers(of_policies, dict.fromkeys((*scores, *MAIN, *added_columns(of_policies.values()))))
    for name, policies in table.estimates.items():
        where = f"`{name}`{table.bounds[name].in_words()}"
        for line in lines_of(policies, columns, table.bounds[name].best_known):
            label = f"*{line.name}*" if line.is_best_known else f"`{line.name}`"
            rows.append([where, label, *map(str, line.entries)])
            where = ""
    return {"columns": ["scenario", "policy", *(column.heading for column in columns)], "rows": rows}


def markdown(table: Mapping[str, Sequence[Any]]) -> str:
    """Return a table in Markdown."""
    lines = [table["columns"], ["---"] * len(table["columns"]), *table["rows"]]
    return "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |\n" for line in lines)


def latex(table: Table) -> str:
    r"""Return a table of each scenario in LaTeX for both columns of a paper; it needs `\usepackage{booktabs}`.

    The best of each column is bold, and intervals are below; columns without any number are left out.
    """
    return "\n".join(["% Needs \\usepackage{booktabs}.", *(_paper_table(table, name) for name in table.estimates)])


def _paper_table(table: Table, scenario: str) -> str:
    policies, bounds = table.estimates[scenario], table.bounds[scenario]
    columns = columns_of(table.scenarios[scenario], policies, only_main=True)
    lines = [
        r"\begin{table*}[t]",
        r"\centering\footnotesize\setlength{\tabcolsep}{4pt}",
        rf"\caption{{\texttt{{{_escaped(scenario)}}}{_escaped(bounds.in_words())}. {_CAPTION}}}",
        rf"\label{{tab:{scenario}}}",
        rf"\begin{{tabular}}{{@{{}}l{'r' * len(columns)}@{{}}}}",
        r"\toprule",
        f"policy & {' & '.join(_escaped(column.heading) for column in columns)} \\\\",
        r"\midrule",
    ]
    for line in lines_of(policies, columns, bounds.best_known):
        lines.append(f"{_escaped(line.name)} & {' & '.join(map(_paper_entry, line.entries))} \\\\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table*}", ""])


_CAPTION = (
    r"Interquartile mean over the seeds and 95\,\% bootstrap interval; for collisions and over lower bound, the "
    r"mean; for the worst-case undetected time (guaranteed), the largest of the episodes and their median. Bold: the "
    r"best. $>$: a lower bound, as in open episodes the time was still growing at the end."
)


def _paper_entry(entry: Entry) -> str:
    words = rf"\textbf{{{_escaped(entry.value)}}}" if entry.is_best else _escaped(entry.value)
    below = rf"\begin{{tabular}}[t]{{@{{}}r@{{}}}}{words}\\{{\scriptsize({_escaped(entry.beside)})}}\end{{tabular}}"
    return below if entry.beside else words


def _escaped(words: str) -> str:
    return "".join(_SPECIAL.get(letter, letter) for letter in words)
