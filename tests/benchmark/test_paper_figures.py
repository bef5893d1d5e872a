"""Figures and tables for a paper: their statistics against SciPy, and files that a paper can take as they are."""

import re
import shutil
import subprocess

import numpy as np
import pytest
from PIL import Image
from rich.console import Console
from test_table import INTRUDERS, rows

import lissajous_env
from baselines.benchmark import paper_figures, results_folder
from baselines.benchmark.running import run
from baselines.benchmark.statistics import performance_profile
from baselines.benchmark.table import Table, compare
from baselines.benchmark.types import Benchmark
from baselines.benchmark.written import latex
from baselines.commands.figures import figures
from lissajous_env.storage.folder import Folder

QUIET = Console(quiet=True)


@lissajous_env.score_column(reduce="max")
def furthest(world):
    """Largest distance of a robot from the middle [m]."""
    return np.abs(world.robots.position[..., 0]).max(axis=1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Results of cars on two scenarios, one with a column of its own, and of points on a third."""
    made = [
        lissajous_env.scenario("evaders", **{"task.duration": 3.0, "extensions": (furthest,)}),
        lissajous_env.scenario("intruders", **{"task.duration": 3.0}),
        lissajous_env.scenario("failure", **{"task.duration": 3.0}),
    ]
    out = tmp_path_factory.mktemp("paper") / "results"
    settings = Benchmark(policies=("kuramoto-mpcc", "laps", "kuramoto", "random"), episodes=3, out=out,
                         replays=("none",))  # fmt: skip
    run(settings, scenarios=made, console=QUIET)
    return out


def test_improvement_is_that_of_tables_over_all_scenarios(folder):
    # Oracle: the shares of the table of each scenario, which have as many seeds.
    with Folder(folder, results_folder.FILES) as there, results_folder.Results(there) as results:
        table = Table.of(results.rows(), results.scenarios)
    group = next(of for of in table.groups() if of.kind == "car")
    pooled = {policy: [row for rows in by.values() for row in rows] for policy, by in group.rows.items()}
    pair = compare(pooled, None).policies["laps"]["detection_time_mean"]
    each = [table.against[name].policies["laps"]["detection_time_mean"] for name in group.scenarios]
    assert pair.n == sum(of.n for of in each) == 6
    assert pair.better == pytest.approx(np.mean([of.better for of in each]))
    assert pair.better_low <= pair.better <= pair.better_high


def test_profiles_are_shares_of_all_episodes():
    strata = [np.array([1.0, 2.0, np.inf, 2.0]), np.array([0.5, np.nan, 3.0])]
    share, low, high = performance_profile(strata, np.array([0.4, 0.5, 2.0, 9.0]))
    np.testing.assert_allclose(share, [0, 1 / 6, 4 / 6, 5 / 6])
    assert (low <= share).all()
    assert (share <= high).all()
    np.testing.assert_allclose(performance_profile(strata[:1], np.array([2.0]), better=1)[0], [3 / 4])
    # Each stratum keeps its share: within each all values agree, so no resample differs.
    _, low, high = performance_profile([np.zeros(4), np.ones(12)], np.array([0.5]))
    assert low == high == 0.25


@pytest.mark.parametrize(
    ("form", "begins"),
    [
        pytest.param("pdf", b"%PDF-", marks=pytest.mark.long),
        pytest.param("svg", b"<?xml", marks=pytest.mark.long),
        pytest.param("png", b"\x89PNG\r\n", marks=pytest.mark.long),
    ],
)
def test_every_figure_of_a_folder_is_drawn_and_the_same_again(folder, tmp_path, form, begins):
    written = figures(folder, form, tmp_path / form)
    assert {path.name.rpartition(".")[0] for path in written} == {
        "table", "profiles-car", "improvement-car", "aggregates-car", "profiles-curve", "improvement-curve",
        "ratios-car", "distribution-evaders", "distribution-intruders",
        "distribution-failure",
    }  # fmt: skip
    drawn = [path for path in written if path.suffix != ".tex"]
    assert all(path.read_bytes().startswith(begins) for path in drawn)
    again = figures(folder, form, tmp_path / "again")
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in written]


def test_few_episodes_of_one_policy_without_any_bound_are_drawn(tmp_path):
    # Story: half a second of episodes, whose guarantee shows no bound anywhere, with nobody to compare with.
    made = [lissajous_env.scenario(name, **{"task.duration": 0.5}) for name in ("evaders", "intruders")]
    settings = Benchmark(policies=("sweep",), episodes=1, out=tmp_path / "results", replays=("none",))
    run(settings, scenarios=made, console=QUIET)
    written = figures(tmp_path / "results", "png")
    assert [path.name for path in written if "distribution" not in path.name] == [
        "table.tex", "profiles-car.png", "aggregates-car.png",
    ]  # fmt: skip


@pytest.mark.long
def test_figures_are_as_wide_as_two_columns_and_no_font_is_of_type_3(folder, tmp_path):
    # Oracle: 7.16 inch, as IEEE requires; journals refuse fonts of type 3.
    for path in figures(folder, "png", tmp_path / "png")[1:]:
        with Image.open(path) as picture:
            assert picture.width == int(7.16 * 300)
            assert np.asarray(picture.convert("L")).std() > 10
    for path in figures(folder, "pdf", tmp_path / "pdf")[1:]:
        data = path.read_bytes()
        assert re.search(rb"/MediaBox \[\s*0 0 515\.5", data)
        assert b"/Type3" not in data
        assert b"/TrueType" in data or b"/CIDFontType2" in data


def test_a_column_of_ones_own_is_in_its_distribution_and_in_the_table(folder, tmp_path, monkeypatch):
    titles = {}

    def saved(figure, form):
        titles[len(titles)] = [axes.get_title() or axes.get_title(loc="left") for axes in figure.axes]
        return b""

    monkeypatch.setattr(paper_figures, "saved", saved)
    figures(folder, "pdf", tmp_path / "out")
    assert sum("furthest" in each for each in titles.values()) == 1
    text = (tmp_path / "out" / "table.tex").read_text()
    assert "furthest" in text[text.index("tab:evaders") : text.index("tab:intruders")]
    assert "furthest" not in text[text.index("tab:intruders") :]


def test_the_table_escapes_what_latex_would_read_and_marks_the_best():
    played = [*rows("my_50%&#{x}~^\\$", detection_time_mean=[2.0, 2.0]), *rows("slow", detection_time_mean=[3.0, 3.0])]
    text = latex(Table.of(played, INTRUDERS))
    assert r"my\_50\%\&\#\{x\}\textasciitilde{}\textasciicircum{}\textbackslash{}\$ & \textbf{2}" in text
    assert "slow & 3 " in text
    for line in text.splitlines():
        if line.endswith(r"\\"):
            assert line.replace(r"\&", "").count("&") == text.split(r"\begin{tabular}{@{}l")[1].index("@")
    assert text.count(r"\toprule") == text.count(r"\midrule") == text.count(r"\bottomrule") == 1


@pytest.mark.long
@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="LaTeX is not installed")
def test_the_table_compiles(folder, tmp_path):
    figures(folder, "pdf", tmp_path / "paper")
    page = r"\documentclass[twocolumn]{article}\usepackage{booktabs,graphicx}\begin{document}\input{table.tex}"
    page += r"\begin{figure*}\includegraphics{profiles-car.pdf}\end{figure*}Text.\end{document}"
    (tmp_path / "paper" / "paper.tex").write_text(page)
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "paper.tex"]
    done = subprocess.run(command, cwd=tmp_path / "paper", capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:]
    assert "Output written on paper.pdf" in done.stdout


def test_what_holds_no_results_is_refused_and_nothing_is_written(folder, tmp_path):
    with pytest.raises(ValueError, match=r"folder must contain the results of a benchmark \(settings.json\), got"):
        figures(tmp_path)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ValueError, match="against must be a policy that was played"):
        figures(folder, out=tmp_path / "out", against="sweep")
    assert not (tmp_path / "out").exists()
