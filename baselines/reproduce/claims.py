"""The table of claims: the paper's number, ours, and whether the two agree."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from baselines.benchmark.written import markdown
from baselines.reproduce.drawing import Picture
from lissajous_env.console.terminal import Column, print_table

_COLUMNS = [
    Column("", left=True, style="bold cyan"),
    Column("claim", prose=True),
    Column("paper", prose=True, rank=1),
    Column("ours", prose=True),
    Column("tolerance", prose=True, rank=2),
    Column("agrees", left=True),
    Column("why, or what was chosen", prose=True, rank=3),
]
_STYLE = {"yes": "green", "no": "bold red", "-": "dim"}
SILENT = "not stated"
"""Text in place of a number that the paper does not state."""


@dataclass(frozen=True)
class Claim:
    """One row of the table: a statement of the paper, and its test."""

    claim: str
    """The statement."""
    paper: str
    """Value of the paper, with its unit."""
    ours: str
    """Value of this simulation, with its unit."""
    tolerance: str
    """The rule by which the two agree."""
    agrees: bool | None
    """None where the paper has nothing to compare with."""
    why: str = ""
    """Choices where the paper states no value, or the reason for a difference."""
    part: str = ""
    """Name of the part of the paper, filled in by `lissajous reproduce`."""


Part = Iterator[Claim | Picture]
"""Claims and pictures of one part of the paper."""


def near(claim: str, paper: float, result: float, tolerance: float, unit: str = "", why: str = "") -> Claim:
    """Claim that a number, `result`, differs from `paper` by at most the tolerance, all in the same unit."""
    rule, agrees = f"\N{PLUS-MINUS SIGN} {tolerance:g} {unit}".rstrip(), bool(abs(result - paper) <= tolerance)
    return Claim(claim, f"{paper:g} {unit}".rstrip(), f"{result:.4g} {unit}".rstrip(), rule, agrees, why)


def within_range(claim: str, paper: float, result: np.ndarray, unit: str = "", why: str = "") -> Claim:
    """Claim that the paper's number is between the smallest and the largest of our seeds (K,)."""
    agrees, rule = bool(result.min() <= paper <= result.max()), f"inside the range of {len(result)} seeds"
    return Claim(claim, f"{paper:g} {unit}".rstrip(), f"{span(result)} {unit}".rstrip(), rule, agrees, why)


def all_of(claim: str, paper: str, results: Iterable[Any], things: str, why: str = "") -> Claim:
    """Claim that all results, of which the `things` have one each, are true."""
    values = [bool(value) for value in results]
    return Claim(claim, paper, f"{sum(values)} of {len(values)} {things}", "all", all(values), why)


def at_most(
    claim: str, paper: str, result: float, bound: float, unit: str = "", why: str = "", digits: str = ".3g"
) -> Claim:
    """Claim that a number, `result`, does not exceed a bound."""
    ours, rule = f"{result:{digits}} {unit}".rstrip(), f"at most {bound:g} {unit}".rstrip()
    return Claim(claim, paper, ours, rule, bool(result <= bound), why)


def reported(claim: str, paper: str, result: str, why: str = "") -> Claim:
    """Report a quantity for which the paper states no number."""
    return Claim(claim, paper, result, "reported only", None, why)


def span(values: np.ndarray, digits: str = ".3f") -> str:
    """Return the smallest and the largest of some values in words."""
    return f"{values.min():{digits}} to {values.max():{digits}}"


def print_claims(console: Console, claims: Sequence[Claim]) -> None:
    """Print the table, a rule between the parts."""
    rows: list[list[str | Text]] = []
    ends = []
    for _, of_part in itertools.groupby(claims, key=lambda claim: claim.part):
        for k, claim in enumerate(of_part):
            part, *cells, agrees, why = _cells(claim)
            rows.append(["" if k else part, *cells, Text(agrees, style=_STYLE[agrees]), why])
        ends.append(len(rows) - 1)
    print_table(console, _COLUMNS, rows, ends, "README.md has them")


def _cells(claim: Claim) -> list[str]:
    """Return the cells of a claim in the order of `_COLUMNS`."""
    agrees = {True: "yes", False: "no", None: "-"}[claim.agrees]
    return [claim.part, claim.claim, claim.paper, claim.ours, claim.tolerance, agrees, claim.why]


def summary(claims: Sequence[Claim]) -> str:
    """State how many of the claims agree, and which parts contain one that does not."""
    judged = [claim for claim in claims if claim.agrees is not None]
    differ = [claim for claim in judged if not claim.agrees]
    words = f"{len(judged) - len(differ)} of {len(judged)} claims agree"
    if differ:
        words += f"; not: {', '.join(dict.fromkeys(claim.part for claim in differ))}"
    return words


def as_page(claims: Sequence[Claim], pictures: Sequence[Picture], format: str, command: str) -> str:
    """Return a page in Markdown: the table, then every picture with its caption."""
    rows = [["**no**" if cell == "no" else cell for cell in _cells(claim)] for claim in claims]
    parts = [
        "# The paper, simulated again",
        f"Made by `{command}`. {summary(claims)}.",
        markdown({"columns": [column.title for column in _COLUMNS], "rows": rows}),
        *(f"## {drawn.title}\n\n![{drawn.title}]({drawn.name}.{format})\n\n{drawn.caption}\n" for drawn in pictures),
    ]
    return "\n\n".join(parts)
