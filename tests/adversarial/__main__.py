"""Attack the package with misuse, and write a table of the results: `python -m tests.adversarial`.

Every try is drawn from the seed, the attack and its number, so that a failure can be repeated alone:
`python -m tests.adversarial --only NAME --seed S`.
"""

import importlib
import pkgutil
import sys
import time
import traceback
import zlib
from pathlib import Path

import numpy as np
import tyro
from rich.console import Console
from rich.progress import Progress

from lissajous_env.storage.files import write_atomically
from tests import adversarial

_SHOWN = 3
"""Number of failures that are printed per attack."""


def attack(only: str = "", share: float = 1.0, seed: int = 0, out: Path | None = None) -> int:
    """Run every attack and print how many tries the package withstood.

    Args:
        only: run only attacks whose names contain these words.
        share: fraction of the tries of each attack; at least one is run.
        seed: seed of the tries.
        out: Markdown file whose table is replaced.
    """
    console, rows, failed = Console(), [], 0
    for each in _attacks(console):
        if only not in each.name:
            continue
        began, seen = time.monotonic(), []
        tries = max(round(share * each.tries), 1)
        with Progress(console=console, transient=True) as progress:
            for k in progress.track(range(tries), description=each.name):
                words = _tried(each, np.random.default_rng([seed, zlib.crc32(each.name.encode()), k]))
                if words is not None:
                    seen.append(f"try {k}: {words}")
        failed += len(seen)
        rows.append((each.name, each.promise, tries, tries - len(seen)))
        console.print(
            f"{each.name}: {tries - len(seen)} of {tries} held, {time.monotonic() - began:.1f} s", markup=False
        )
        for words in seen[:_SHOWN]:
            console.print(f"  {words}", style="red", markup=False)
    if out is not None:
        _replace_table(out, rows, seed)
    total = sum(row[2] for row in rows)
    console.print(f"{total - failed} of {total} tries held")
    return 1 if failed else 0


def _attacks(console: Console) -> list[adversarial.Attack]:
    """Return all attacks; a module whose library is not installed is skipped with a message."""
    found = []
    for name in sorted({module.name for module in pkgutil.iter_modules(adversarial.__path__)} - {"__main__"}):
        try:
            found += getattr(importlib.import_module(f"tests.adversarial.{name}"), "ATTACKS", [])
        except ImportError as error:
            console.print(f"{name} is skipped: {error}", style="yellow", markup=False)
    return found


def _tried(each: adversarial.Attack, draw: np.random.Generator) -> str | None:
    try:
        return each.attempt(draw)
    except Exception as error:
        return "".join(traceback.format_exception(error)[-3:])


def _replace_table(path: Path, rows: list[tuple[str, str, int, int]], seed: int) -> None:
    """Replace the text between the two marks of the table."""
    begin, end = "<!-- table: begin -->", "<!-- table: end -->"
    before, _, rest = path.read_text(encoding="utf-8").partition(begin)
    lines = ["| attack | required behaviour | tries | passed |", "|---|---|---:|---:|"]
    lines += [f"| {name} | {promise} | {tries:,} | {held:,} |" for name, promise, tries, held in rows]
    tries, held = sum(row[2] for row in rows), sum(row[3] for row in rows)
    table = "\n".join([*lines, f"| **all**, seed {seed} | | **{tries:,}** | **{held:,}** |"])
    write_atomically(path, f"{before}{begin}\n{table}\n{end}{rest.partition(end)[2]}")


if __name__ == "__main__":
    sys.exit(tyro.cli(attack))
