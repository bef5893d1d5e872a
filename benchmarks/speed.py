"""All figures of speed, each compared with an alternative or with another checkout in the same run.

    pip install ".[bench,train,cluster]"
    python benchmarks/speed.py --against COMMIT --store
    python benchmarks/speed.py --parts growth --robots 1001 --targets 100000 --against 9bc234e

The sides of a part take turns, so that a slow moment of the machine affects both; a ratio is computed over their pairs,
with its 95 % interval. Each part runs in a process of its own. A part whose alternative is not installed is left out
with a message. `--store` puts the tables into docs/figures.json as soon as their part is done.
"""

import argparse
import atexit
import multiprocessing
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import figures
import warp
from speeds import (
    Options,
    Part,
    cluster,
    contamination,
    controller,
    cuda,
    growth,
    marl,
    memory,
    onboard,
    rogues,
    served,
    step,
)

from lissajous_env import identity
from lissajous_env.device.devices import cores

_MODULES = (step, rogues, memory, contamination, growth, controller, onboard, marl, cluster, cuda)
PARTS = {module.PART.name: module.PART for module in _MODULES}


def machine(parts: Sequence[str], threads: int) -> figures.Table:
    """Return a table with the machine and the versions with which some parts are measured, a row for each part."""
    facts = {
        "processor": identity.machine("cpu")["cpu"],
        "cores": str(os.cpu_count()),
        "threads": str(threads),
        "Python": platform.python_version(),
        "Warp": warp.__version__,
    }
    rows = [[f"`{part}`", *facts.values()] for part in parts]
    for row, part in zip(rows, parts, strict=True):
        if PARTS[part].gpu:
            row[1] += f", {warp.get_device('cuda').name}"
    return {"columns": ["part", *facts], "rows": rows}


def with_rows_of(stored: figures.Table, measured: figures.Table) -> figures.Table:
    """Return a stored table with the rows of a measured one, which replace those with the same first cell."""
    rows = {row[0]: row for row in (*stored["rows"], *measured["rows"])}
    return {**measured, "rows": [rows[name] for name in sorted(rows)]}


def measured(part: Part, options: Options) -> dict[str, figures.Table]:
    """Return the tables of a part, measured in a process of its own."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(part.tables, options).result()


def at_least_one(text: str) -> int:
    """Return a whole number from the command line."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, got {text}")
    return int(text)


def checkout(text: str) -> Path:
    """Return a folder that contains another version of this project, by its path or by its commit."""
    folder = Path(text)
    if not folder.exists():
        folder = Path(tempfile.mkdtemp(prefix="lissajous-before-"), "checkout")
        atexit.register(shutil.rmtree, folder.parent, ignore_errors=True)
        git = ["git", "-C", str(figures.ROOT), "worktree"]
        if subprocess.run([*git, "add", "--detach", "--quiet", str(folder), text], check=False).returncode == 0:
            atexit.register(subprocess.run, [*git, "remove", "--force", str(folder)], check=False)
    if not (folder / "lissajous_env" / "__init__.py").is_file():
        raise argparse.ArgumentTypeError(f"must be a checkout or commit of this project, got {text}")
    return folder.resolve()


def parser() -> argparse.ArgumentParser:
    """Return the options of the command line."""
    words = "\n".join(f"  {name:14}{part.what}" for name, part in PARTS.items())
    parser = argparse.ArgumentParser(description=f"{__doc__}\nparts:\n{words}",
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS), metavar="PART",
                        help="what is measured; all where none is named")  # fmt: skip
    parser.add_argument("--rounds", type=at_least_one, help="turns of each side, instead of each part's own number")
    parser.add_argument("--worlds", type=at_least_one, help="worlds of a batch (default: 4096)")
    parser.add_argument("--robots", type=int, choices=served.CURVES, nargs="+", help="teams of growth (default: all)")
    parser.add_argument("--targets", type=at_least_one, nargs="+", help="numbers of targets of growth")
    parser.add_argument("--threads", type=at_least_one, default=cores())
    parser.add_argument("--against", type=checkout, metavar="WHERE",
                        help="folder of another checkout of this project, or its commit")  # fmt: skip
    parser.add_argument("--without-rivals", action="store_true", help="measure this checkout alone")
    parser.add_argument(
        "--quick", action="store_true", help="two rounds of all but nothing: whether it runs, not how fast"
    )
    parser.add_argument("--store", action="store_true", help="keep tables and pictures in docs/, too")
    return parser


def options_of(part: Part, given: argparse.Namespace) -> Options:
    """Return the settings of a part from the command line."""
    return Options(
        rounds=given.rounds or (2 if given.quick else part.rounds),
        worlds=given.worlds or (8 if given.quick else 4096),
        threads=given.threads,
        against=given.against,
        rivals=not given.without_rivals,
        quick=given.quick,
        store=given.store,
        robots=tuple(given.robots or ()),
        targets=tuple(given.targets or ()),
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print and store."""
    given = parser().parse_args(arguments)
    if given.quick and given.store:
        sys.exit("error: --store must be without --quick, whose figures say nothing")
    left = []
    for part in (PARTS[name] for name in dict.fromkeys(given.parts)):
        options = options_of(part, given)
        if words := part.missing(options):
            print(f"left out: {part.name}; {words}", flush=True)
        else:
            left.append((part, options))
    if not left:
        sys.exit("error: no part is left to measure")
    figures.show("machine", machine([part.name for part, _ in left], given.threads))
    for part, options in left:
        print(f"{part.name}: {part.what}", flush=True)
        tables = measured(part, options)
        for name, table in tables.items():
            figures.show(name, table)
        if given.store:
            setup = machine([part.name], given.threads)
            figures.store(tables | {"machine": with_rows_of(figures.load().get("machine", setup), setup)})


if __name__ == "__main__":
    main()
