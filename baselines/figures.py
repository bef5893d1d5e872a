"""The command that makes figures and a table for a paper of the results of a benchmark."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from lissajous_env.console.terminal import DEFAULT_OUTPUT, OutputOptions
from lissajous_env.storage.folder import Folder

TABLE = "table.tex"
_Folder = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
_Out = Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")]


def figures(
    folder: _Folder,
    format: Literal["pdf", "svg", "png"] = "pdf",
    out: _Out = None,
    against: str | None = None,
    output: OutputOptions = DEFAULT_OUTPUT,
) -> list[Path]:
    """Draw the results of a benchmark for a paper, and write its table in LaTeX; nothing is played.

    For each kind of robots: performance profiles, the probability of improvement over the reference, and aggregates,
    all with 95 % bootstrap intervals stratified by scenario; for each scenario the distributions of its scores. All are
    as wide as both columns of a paper, 7.16 inch.

    Example:
        lissajous figures results/mine --format pdf

    Args:
        folder: of the results of a benchmark.
        format: pdf, svg or png.
        out: folder of the figures; FOLDER/figures without one.
        against: policy that the others are compared with; without one the paper's method, or the first that was played.
        output: How it speaks.

    Returns:
        The files.

    Raises:
        ValueError: the folder holds no results, or a policy that was not played.
    """
    from baselines.benchmark import paper_figures, results_folder
    from baselines.benchmark.comparison import compare, with_derived
    from baselines.benchmark.written import latex

    if not (folder / "settings.json").is_file():
        raise ValueError(f"folder must hold the results of a benchmark (settings.json), got {folder}")
    held = results_folder.read_settings(folder / "settings.json")
    scenarios = results_folder.scenarios_of(folder, held)
    with Folder(folder, results_folder.NAMES) as results, results_folder.Episodes(results, held) as kept:
        rows = kept.all()
    policies = dict.fromkeys(row["policy"] for row in rows)
    if not rows:
        raise ValueError(f"folder must hold an episode at least, got {folder}")
    if against is not None and against not in policies:
        raise ValueError(f"against must be a policy that was played ({', '.join(policies)}), got {against}")
    comparisons, told = compare(rows, scenarios, against), with_derived(rows, scenarios)
    written = []
    drawn = list(paper_figures.draw(told, scenarios, comparisons, against, format))
    place = out or folder / "figures"
    with Folder(place, (TABLE, *(name for name, _ in drawn))) as made:
        made.write(TABLE, latex(comparisons, scenarios))
        for name, content in drawn:
            made.write(name, content)
        written = [place / name for name in (TABLE, *(name for name, _ in drawn))]
    output.console().print(
        f"{len(drawn)} figures and {TABLE} are in {place}", markup=False, highlight=False, soft_wrap=True
    )
    output.print_json([str(path) for path in written])
    return written
