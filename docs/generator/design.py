"""Drawings of the code: the stages of a step, and the folders with their imports."""

import ast
import re
from collections import Counter
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

import lissajous_env
from docs.generator.concepts import drawn
from lissajous_env.world.stages import stages_of

ROOT = Path(lissajous_env.__file__).resolve().parent.parent
PACKAGES = "lissajous_env", "baselines", "training"
_OVER = {"world": "#dbe7f3", "robot": "#d8efe3", "target": "#f8dcd6", "row": "#f6ecd0", "field row": "#e8ddf2"}
"""Colours by the object over which a stage iterates."""
_LONGEST = 72
"""Maximum length of a line in the picture of the stages [characters]."""


def stages() -> bytes:
    """Draw the stages of a step of `evaders-failure`, which has nearly all."""
    listed = [stage for stage in stages_of(lissajous_env.scenario("evaders-failure").resolve()) if stage.when]
    return drawn(lambda figure: _draw_stages(figure, listed), 8.0, 0.3 * len(listed) + 0.5)


def _draw_stages(figure: Figure, listed: list) -> None:
    axes = figure.subplots()
    for k, stage in enumerate(listed):
        y = len(listed) - k
        _box(axes, 0, y, 2.6, 0.72, _OVER[stage.over])
        axes.text(0.1, y, f"{k + 1:2}  {stage.name}", va="center", weight="bold", size=8.5)
        module = stage.run.func.__module__.removeprefix("lissajous_env.world.").replace(".", "/")
        axes.text(2.75, y, f"{module}.py", va="center", color="#555555", family="monospace", size=7.5)
        axes.text(5.3, y, _gist(stage.about), va="center", size=8)
    for k, (over, colour) in enumerate(_OVER.items()):
        _box(axes, 2.3 * k, 0, 0.25, 0.5, colour)
        axes.text(2.3 * k + 0.35, 0, f"for each {over}", va="center", size=8)
    axes.set(xlim=(-0.05, 11.6), ylim=(-0.5, len(listed) + 0.6))
    axes.axis("off")


def _gist(about: str) -> str:
    """Return the text before the first colon or semicolon; shorten a long one at a comma."""
    gist = re.split("[;:]", about.replace("`", ""))[0].rstrip(".")
    return gist if len(gist) <= _LONGEST else gist[:_LONGEST].rpartition(",")[0] or gist[:_LONGEST].rpartition(" ")[0]


def folders() -> bytes:
    """Draw the packages, their folders with lines of code, and the number of imports between packages."""
    return drawn(_draw_folders, 7.4, 4.2)


def _draw_folders(figure: Figure) -> None:
    axes, counted = figure.subplots(), {package: lines_by_folder(package) for package in PACKAGES[::-1]}
    for k, (package, lines) in enumerate(counted.items()):
        x = 3.4 * k
        _box(axes, x, 0.65 - 0.275 * len(lines), 2.6, 0.55 * len(lines) + 0.9, "#f1f1ee")
        axes.text(x + 0.15, 0.75, package, weight="bold", va="center", size=10)
        axes.text(x + 2.45, 0.75, f"{sum(lines.values()):,} lines", va="center", ha="right", size=8)
        for row, (folder, count) in enumerate(lines.items()):
            axes.text(x + 0.15, 0.2 - 0.55 * row, folder, va="center", family="monospace", size=8)
            axes.text(x + 2.45, 0.2 - 0.55 * row, f"{count:,}", va="center", ha="right", size=8, color="#555555")
    for (source, target), count in imports_between().items():
        first, last = list(counted).index(source), list(counted).index(target)
        _draw_arrow(axes, 3.4 * first, 3.4 * last, last - first == 1, count)
    axes.set(xlim=(-0.05, 9.45), ylim=(0.2 - 0.55 * max(map(len, counted.values())), 2.9))
    axes.axis("off")


def _draw_arrow(axes: Axes, first: float, last: float, is_next: bool, count: int) -> None:
    """Draw an arrow with the number of imports from the package at x = `first` to that at `last`."""
    start, end = ((first + 2.6, 0.75), (last, 0.75)) if is_next else ((first + 1.3, 1.1), (last + 1.3, 1.1))
    arrow = {"arrowstyle": "->", "color": "#333333", "connectionstyle": f"arc3,rad={0 if is_next else -0.25}"}
    axes.annotate("", end, start, arrowprops=arrow)
    axes.text((start[0] + end[0]) / 2, 0.87 if is_next else 2.6, f"{count} imports", ha="center", size=7)


def lines_by_folder(package: str) -> dict[str, int]:
    """Return lines of Python in each folder of a package, most first; files beside them count as `.`."""
    counted: Counter[str] = Counter()
    for path in (ROOT / package).rglob("*.py"):
        parts = path.relative_to(ROOT / package).parts
        counted[parts[0] if len(parts) > 1 else "."] += len(path.read_text(encoding="utf-8").splitlines())
    return dict(counted.most_common())


def imports_between() -> dict[tuple[str, str], int]:
    """Return the number of import statements from one package to another."""
    counted: Counter[tuple[str, str]] = Counter()
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                counted.update((package, name.split(".")[0]) for name in names)
    return {pair: count for pair, count in counted.items() if pair[1] in PACKAGES and pair[0] != pair[1]}


def _box(axes: Axes, x: float, middle: float, width: float, height: float, colour: str) -> None:
    corner = x, middle - height / 2
    axes.add_patch(FancyBboxPatch(corner, width, height, "round,pad=0,rounding_size=0.08", color=colour, linewidth=0))


DRAWINGS = {"stages": stages, "folders": folders}
"""Functions that make the drawings, by name."""
