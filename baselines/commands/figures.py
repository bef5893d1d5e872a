"""The command `lissajous figures`: figures and a LaTeX table for a paper, from the results of a benchmark."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from baselines.benchmark.results_folder import Results
from baselines.benchmark.table import Table
from baselines.benchmark.written import latex
from lissajous_env.console.terminal import DEFAULT_OUTPUT, OutFolder, Output
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import counted

TABLE = "table.tex"
_Folder = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]


def figures(
    folder: _Folder,
    format: Literal["pdf", "svg", "png"] = "pdf",
    out: OutFolder = None,
    output: Output = DEFAULT_OUTPUT,
) -> list[Path]:
    """Draw the results of a benchmark for a paper, and write its table in LaTeX; no episode is played.

    A figure of each scenario shows every episode, the estimates with their 95 % bootstrap intervals, and the
    probability of improvement over the reference on the same seeds; another one shows the estimates over all scenarios
    of a robot kind. All are 7.16 inch wide, both columns of a paper.

    Example:
        lissajous figures results/mine --format pdf

    Args:
        folder: folder with the results of `lissajous benchmark`.
        format: format of the figures; pdf and svg scale without loss, png does not.
        out: folder of the figures; by default FOLDER/figures.

    Returns:
        Paths of the files.

    Raises:
        ValueError: the folder contains no results.
    """
    from baselines.benchmark import paper_figures  # the import of matplotlib takes a second

    results = Results(folder)
    if not (rows := results.rows()):
        raise ValueError(f"folder must contain at least one episode, got {folder}")
    table = Table.of(rows, results.scenarios)
    files = {TABLE: latex(table), **dict(paper_figures.draw(table, format))}
    place = out or folder / "figures"
    with Folder(place, files) as written:
        for name, content in files.items():
            written.write(name, content)
    output.print(f"{counted(len(files) - 1, 'figure')} and {TABLE} are in {place}")
    paths = [place / name for name in files]
    output.print_json(paths)
    return paths
