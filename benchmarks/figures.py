"""Numbers of the documentation, which the programs that compute them store in docs/figures.json.

    python benchmarks/figures.py            writes the tables of docs/figures.json into README.md and docs/*.md
    python benchmarks/figures.py --paper    simulates the paper first, seed 0, and stores the table of its claims

The text between two marks of a page is replaced:

    <!-- figures: NAME --> ... <!-- end -->                  the table NAME
    <!-- figures: NAME, NAME ... --> ... <!-- end -->        tables with the same columns, one below the other
    <!-- figures: NAME / ROW / COLUMN --> ... <!-- end -->   one cell, in a line of text

ROW is the first cell of a row, or a beginning that only one row has. Other programs add their tables by `store`. The
tables that are made from the code (`observation`, `reward`, `score`) or picked from another one (`gist`) are not
stored, but made when the pages are written.
"""

import argparse
import json
import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table as Printed
from rich.text import Text

ROOT = Path(__file__).resolve().parent.parent
STORE = ROOT / "docs" / "figures.json"
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
_PLACE = re.compile(r"<!-- figures: (.+?) -->(.*?)<!-- end -->", re.DOTALL)

GIST = (
    ("evaders", "guaranteed [s]"),
    ("evaders", "collisions"),
    ("evaders-lost", "guaranteed [s]"),
    ("intruders", "guaranteed [s]"),
    ("intruders", "detection [s]"),
    ("rough", "collisions"),
)
"""Scenario and column of each number that the README shows of the table of the policies."""
GIST_POLICIES = (
    "kuramoto-mpcc",
    "kuramoto-mpcc-safe",
    "open-loop-mpcc",
    "partition-repair",
    "line-abreast",
    "sweep",
    "portfolio",
    "portfolio-guarantee",
)
"""Policies that the README shows of the table of the policies."""

Table = Mapping[str, Sequence[Any]]
"""A table: `columns`, the titles, and `rows` with as many cells; all are text."""


def load() -> dict[str, Table]:
    """Return the stored tables by name."""
    return json.loads(STORE.read_text(encoding="utf-8")) if STORE.exists() else {}


def computed_tables() -> dict[str, Table]:
    """Return the tables that are not stored: observation entries, reward terms, score columns, and the gist."""
    from lissajous_env.parameters.scenario import Task
    from lissajous_env.settings.checks import meanings
    from lissajous_env.world import columns, observation, tally

    parts = {
        "{j}": ("", observation.OWN_ENTRIES),
        "8 + 6 k + {j}": ("neighbour_k_", observation.NEIGHBOUR_ENTRIES),
        "20 + 5 k + {j}": ("robot_k_", observation.ROBOT_ENTRIES),
        "20 + 5 R + 3 k + {j}": ("target_k_", observation.TARGET_ENTRIES),
    }
    entries = [
        [place.format(j=j).removesuffix(" + 0"), f"`{prefix}{name}`", meaning, f"[{low}, {high}]"]
        for place, (prefix, part) in parts.items()
        for j, (name, low, high, meaning) in enumerate(part)
    ]
    ((_, low, high, meaning),) = observation.message_entries(1)
    message = ["20 + 5 R + 3 T + M k + m", "`neighbour_k_message_m`", meaning.replace("component 0", "component m")]
    entries.append([*message, f"[{low}, {high}]"])
    known = {
        "{start} + 9 k + {j}": ("track_k_", observation.TRACK_ENTRIES),
        "{start} + 9 S + 4 k + {j}": ("teammate_k_", observation.TEAMMATE_ENTRIES),
        "{start} + 9 S + 4 U + k + {j}": ("cell_k_", observation.CELL_ENTRIES),
    }
    entries += [
        [place.format(start="20 + 5 R + 3 T + 2 M", j=j).removesuffix(" + 0"), f"`{prefix}{name}`", meaning,
         f"[{low}, {high}]"]
        for place, (prefix, part) in known.items()
        for j, (name, low, high, meaning) in enumerate(part)
    ]  # fmt: skip
    words = {name: text.replace("\n", " ") for name, text in meanings(Task).items()}
    terms = [[f"`{term}`", f"`{formula}`", f"{getattr(Task(), f'reward_{term}'):g}", words[f"reward_{term}"]]
             for term, formula in tally.FORMULAS.items()]  # fmt: skip
    return {
        "gist": gist_of(load()["policies"]),
        "observation": {"columns": ["index", "name", "what [unit]", "range"], "rows": entries},
        "reward": {"columns": ["term", "formula", "default weight", "what the weight is"], "rows": terms},
        "score": {
            "columns": ["column", "what"],
            "rows": [[f"`{name}`", what] for name, what in columns.MEANINGS.items()],
        },
    }


def gist_of(policies: Table) -> Table:
    """Return the most informative columns and rows of the table `policies`."""
    at = {title: k for k, title in enumerate(policies["columns"])}
    cells: dict[str, dict[str, str]] = {}
    name = ""
    for row in policies["rows"]:
        name = row[0].split("`")[1] if row[0] else name
        for scenario, column in GIST:
            if scenario == name:
                cells.setdefault(row[1], {})[f"`{scenario}`: {column}"] = row[at[column]]
    titles = [f"`{scenario}`: {column}" for scenario, column in GIST]
    rows = [[f"`{policy}`", *(cells[f"`{policy}`"].get(title, "") for title in titles)] for policy in GIST_POLICIES]
    return {"columns": ["policy", *titles], "rows": rows}


def store(tables: Mapping[str, Table]) -> None:
    """Store tables in docs/figures.json; they replace those of the same names."""
    for name, table in tables.items():
        if any(len(row) != len(table["columns"]) for row in table["rows"]):
            raise ValueError(f"rows of table {name} must have a cell for each of its columns")
    text = json.dumps(load() | dict(tables), indent=1, ensure_ascii=False, sort_keys=True)
    STORE.write_text(text + "\n", encoding="utf-8")


def show(title: str, table: Table) -> None:
    """Print a table."""
    # Cells are passed as text, because rich would interpret brackets, such as those of units, as markup.
    shown = Printed(title=title)
    for k, column in enumerate(table["columns"]):
        shown.add_column(Text(column), no_wrap=not k)
    for row in table["rows"]:
        shown.add_row(*map(Text, row))
    Console(width=160).print(shown)


def publish(name: str, title: str, table: Table, stores: bool) -> None:
    """Print a table, and store it if `stores`."""
    show(title, table)
    if stores:
        store({name: table})


def merged(name: str, table: Table) -> Table:
    """Return a table with the stored rows of the table `name`; new rows replace those with the same first cell."""
    stored, new = load().get(name, table), {row[0]: row for row in table["rows"]}
    if stored["columns"] != table["columns"]:
        raise ValueError(f"columns of {name} must be the stored {stored['columns']}, got {table['columns']}")
    return {"columns": table["columns"], "rows": [*(new.pop(row[0], row) for row in stored["rows"]), *new.values()]}


def parser(about: str | None) -> argparse.ArgumentParser:
    """Return the parser of a program with tables, whose help begins with `about`; it has the option `--store`."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--store", action="store_true", help="put the tables into docs/figures.json, too")
    return parser


def of_claims(claims: Sequence[Any]) -> dict[str, Table]:
    """Return the table of each part of the paper, from the claims that `baselines.reproduce` returns."""
    columns = ["claim", "paper", "ours", "agrees", "why, or what was chosen"]
    tables: dict[str, Table] = {}
    for claim in claims:
        agrees = {True: "yes", False: "**no**", None: "-"}[claim.agrees]
        row = [claim.claim, claim.paper, claim.ours, agrees, claim.why]
        tables.setdefault(claim.part, {"columns": columns, "rows": []})["rows"].append(row)  # type: ignore[attr-defined]
    return tables


def filled(page: str, tables: Mapping[str, Table]) -> str:
    """Return a page with the tables and cells that its marks name; a ValueError names a mark of an unknown one."""
    return _PLACE.sub(lambda match: f"<!-- figures: {match[1]} -->{_content(match[1], tables)}<!-- end -->", page)


def _content(asked: str, tables: Mapping[str, Table]) -> str:
    name, *cell = asked.split(" / ")
    names = name.split(", ")
    for table_name in names:
        if table_name not in tables:
            raise ValueError(f"figures must be of {', '.join(tables)}, got {table_name!r}")
    if cell:
        return _cell(tables[name], *cell)
    columns = tables[names[0]]["columns"]
    lines = [columns, ["---"] * len(columns)]
    for table_name in names:
        if tables[table_name]["columns"] != columns:
            raise ValueError(f"tables that are joined must have the same columns, got {names[0]} and {table_name}")
        lines += tables[table_name]["rows"]
    if len(names) > 1:
        sources = ["", "---", *(table_name for table_name in names for _ in tables[table_name]["rows"])]
        lines = [[first, *line] for first, line in zip(sources, lines, strict=True)]
    written = ("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)
    return "\n\n" + "\n".join(written) + "\n\n"


def _cell(table: Table, row: str, column: str) -> str:
    rows = [line for line in table["rows"] if line[0] == row]
    rows = rows or [line for line in table["rows"] if line[0].startswith(row)]
    if len(rows) != 1 or column not in table["columns"]:
        raise ValueError(f"one row must begin with {row!r} and a column be {column!r}, got {len(rows)} rows")
    return str(rows[0][table["columns"].index(column)])


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the numbers of docs/figures.json into the pages.")
    parser.add_argument("--paper", action="store_true", help="simulate the paper first and store its table")
    if parser.parse_args().paper:
        from baselines.commands.reproduce import reproduce

        with tempfile.TemporaryDirectory() as folder:
            store(of_claims(reproduce(("all",), out=Path(folder))))
    tables = load() | computed_tables()
    for path in PAGES:
        page = path.read_text(encoding="utf-8")
        path.write_text(filled(page, tables), encoding="utf-8")


if __name__ == "__main__":
    main()
