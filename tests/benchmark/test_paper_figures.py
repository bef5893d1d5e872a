"""Figures and tables for a paper: files that a paper can take as they are, with any settings of matplotlib."""

import re
import shutil
import subprocess

import matplotlib
import numpy as np
import pytest
from benchmarks_in_the_small import QUIET, furthest, rows
from PIL import Image

import lissajous_env
from baselines.benchmark import paper_figures
from baselines.benchmark.running import run
from baselines.benchmark.table import Table
from baselines.benchmark.types import Benchmark
from baselines.commands.figures import figures
from baselines.policies.registry import as_factory
from baselines.reproduce.drawing import sheet
from lissajous_env.storage.folder import Folder

SHORT = {"task.duration": 3.0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Results of cars on two scenarios, one with a column of its own, and of points on a third."""
    scenarios = [
        lissajous_env.scenario("evaders", **SHORT | {"extensions": (furthest,)}),
        lissajous_env.scenario("intruders", **SHORT),
        lissajous_env.scenario("failure", **SHORT),
    ]
    out = tmp_path_factory.mktemp("paper") / "results"
    policies = ("kuramoto-mpcc", "laps", "kuramoto", "random")
    run(Benchmark(policies=policies, episodes=3, out=out, replays=0), scenarios=scenarios, console=QUIET)
    return out


def test_the_figures_show_the_columns_of_the_table(folder, tmp_path, monkeypatch):
    # Oracle: the columns that have numbers on each scenario.
    titles = []

    def saved(figure, form):
        titles.append([axes.get_title() or axes.get_title(loc="left") for axes in figure.axes])
        return b""

    monkeypatch.setattr(paper_figures, "saved", saved)
    written = figures(folder, "pdf", tmp_path / "out")
    names = ["table.tex", "overall-car.pdf", "scores-evaders.pdf", "scores-intruders.pdf", "scores-failure.pdf"]
    assert [path.name for path in written] == names
    assert titles[0][0] == "score / best"
    assert "guaranteed [s]\nlargest of 3" in titles[1]
    assert {"furthest", "better"} < set(titles[1])
    assert not any("furthest" in figure_titles for figure_titles in titles[2:])
    text = (tmp_path / "out" / "table.tex").read_text()
    assert "furthest" in text[text.index("tab:evaders") : text.index("tab:intruders")]
    assert "furthest" not in text[text.index("tab:intruders") :]


def test_one_episode_of_one_policy_without_any_bound_is_drawn(tmp_path):
    pair = [lissajous_env.scenario(name, **{"task.duration": 0.5}) for name in ("evaders", "intruders")]
    run(Benchmark(episodes=1, out=tmp_path / "results", replays=0), {r"$\formula$": as_factory("sweep")}, pair, QUIET)
    journal = tmp_path / "results" / "episodes.jsonl"
    with Folder(journal.parent), journal.open("a") as file:  # a benchmark that writes a line
        print('{"scenario": "evad', end="", file=file, flush=True)
        written = figures(journal.parent, "png")
    assert journal.read_text().endswith("evad"), "it does not change"
    assert [path.name for path in written][1:] == ["overall-car.png", "scores-evaders.png", "scores-intruders.png"]
    # Oracle: 7.16 inch, as IEEE requires.
    with Image.open(written[1]) as picture:
        assert picture.width == int(7.16 * 300)
        assert np.asarray(picture.convert("L")).std() > 10


def test_a_guarantee_is_drawn_from_its_median_and_as_words_without_a_bound(monkeypatch):
    panels = []
    monkeypatch.setattr(paper_figures, "saved", lambda figure, form: panels.append(figure.axes[1]) or b"")
    scenarios = {name: lissajous_env.scenario(name) for name in ("evaders", "team")}
    played = [
        row | {"guarantee_open": float(policy == "lost")}
        for name in scenarios
        for policy in ("lost", "closed")
        for row in rows(policy, name, guaranteed_detection_time=[4.0, 5.0])
    ]
    list(paper_figures.draw(Table.of(played, scenarios), "png"))
    overall, evaders, _ = panels
    assert [(text.get_text(), text.get_position()[1]) for text in overall.texts] == [("no bound", 0)]
    intervals = [[*line.get_xdata()] for line in evaders.lines if line.get_linewidth() == 4]
    assert intervals == [[4.5, 5.0]]


@pytest.mark.long
@pytest.mark.parametrize("form", ["pdf", "svg", "png"])
def test_every_figure_is_the_same_again_and_no_font_is_of_type_3(folder, tmp_path, form):
    written = figures(folder, form, tmp_path / form)
    again = figures(folder, form, tmp_path / "again")
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in written]
    for data in (path.read_bytes() for path in written[1:] if form == "pdf"):
        assert re.search(rb"/MediaBox \[\s*0 0 515\.5", data)
        assert b"/Type3" not in data  # journals refuse it
        assert b"/TrueType" in data or b"/CIDFontType2" in data


@pytest.mark.long
@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="LaTeX is not installed")
def test_the_table_compiles(folder, tmp_path):
    figures(folder, "pdf", tmp_path / "paper")
    page = r"\documentclass[twocolumn]{article}\textwidth=7.16in\usepackage{booktabs,graphicx}\begin{document}"
    page += r"\input{table.tex}\begin{figure*}\includegraphics{overall-car.pdf}\end{figure*}Text.\end{document}"
    (tmp_path / "paper" / "paper.tex").write_text(page)
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    done = subprocess.run(command, cwd=tmp_path / "paper", capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:]
    assert [words in done.stdout for words in ("Output written on paper.pdf", "Overfull")] == [True, False]


def test_what_has_no_results_is_refused_and_nothing_is_written(tmp_path):
    with pytest.raises(ValueError, match=r"must contain settings.json of a benchmark"):
        figures(tmp_path)
    assert list(tmp_path.iterdir()) == []


HOSTILE = {
    "text.usetex": True, "savefig.bbox": "tight", "savefig.dpi": 37, "savefig.format": "svg",
    "savefig.transparent": True, "figure.dpi": 33, "font.family": "A font that nobody has", "axes.facecolor": "black",
    "lines.linewidth": 9, "axes.prop_cycle": "cycler('color', ['r'])", "svg.fonttype": "none", "pdf.fonttype": 42,
    "path.simplify": False, "figure.constrained_layout.use": False,
}  # fmt: skip


def drawn(suffix):
    with sheet("name", "Title with a $ sign", 5.0, 3.0) as picture:
        axes = picture.figure.subplots()
        axes.plot([0, 1, 2], [0, 1, -1], label="a line")
        axes.legend()
        picture.caption = "A caption."
    return picture.content(suffix)


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_pictures_are_the_same_with_any_settings(suffix):
    # Oracle: the picture of a user without settings, bit for bit.
    expected = drawn(suffix)
    with matplotlib.rc_context(HOSTILE):
        assert drawn(suffix) == expected
        assert matplotlib.rcParams["lines.linewidth"] == 9
