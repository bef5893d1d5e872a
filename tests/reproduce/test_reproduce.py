"""The paper's figures and claims, simulated again: the table, the pictures, the page, and what docs/paper.md says."""

import doctest
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import called
from matplotlib import image

from baselines.commands.reproduce import PARTS, reproduce
from baselines.reproduce import claims
from baselines.reproduce.episodes import EpisodeArrays, first_times
from baselines.reproduce.three_dimensions import branch_radius
from benchmarks import figures
from lissajous_env.console.terminal import Output
from lissajous_env.parameters.scenario import Curve
from lissajous_env.storage.folder import LIST
from lissajous_env.theory import closed_forms

pytestmark = pytest.mark.filterwarnings("error:scenario ")  # the claims state which assumptions are violated
NUMBER = re.compile(r"\d[\d,]*(\.\d+)?(e-?\d+)?")
PAGE = Path(__file__).resolve().parents[2] / "docs" / "paper.md"
DISAGREES = {"printed", "experiment1"}
"""Claims that differ: misprints, and the time after which cars drift apart without feedback."""
OF_CARS = {"fig7", "fig8", "fig9", "experiment1", "printed", "window"}


@pytest.fixture(scope="module")
def reproduction(tmp_path_factory):
    """The folder and the rows of `lissajous reproduce all`."""
    out = tmp_path_factory.mktemp("reproduce")
    return out, reproduce(("all",), out=out)


def numbers(words):
    return [float(match[0].replace(",", "")) for match in NUMBER.finditer(words)]


def row(reproduction, part, start):
    (claim,) = (claim for claim in reproduction[1] if claim.part == part and claim.claim.startswith(start))
    return claim


@pytest.mark.long
def test_pictures_are_not_blank(reproduction):
    for path in reproduction[0].glob("*.png"):
        grey = image.imread(path)[..., :3].mean(axis=-1)
        height, width = grey.shape
        assert width > 1000, path
        # Ink in every quarter of the drawing, above the caption.
        for part in (grey[: height // 3, : width // 2], grey[height // 3 : 2 * height // 3, width // 2 :]):
            assert 0.005 < np.mean(part < 0.8) < 0.9, path
        assert len(np.unique(grey.round(2))) > 20, path


@pytest.mark.long
def test_every_row_agrees_or_says_why(reproduction):
    for claim in reproduction[1]:
        assert all((claim.claim, claim.paper, claim.ours, claim.tolerance)), claim
        assert claim.agrees or claim.why, claim
    assert {claim.part for claim in reproduction[1] if claim.agrees is False} == DISAGREES


@pytest.mark.long
def test_the_numbers_of_the_paper(reproduction):
    # Oracle: numbers that the paper prints, and those of an independent simulation (56 %, 4.6 to 4.8 s).
    assert numbers(row(reproduction, "fig3", "T_max for N = 15").ours) == [pytest.approx(8.38, abs=0.005)]
    assert 4.4 < numbers(row(reproduction, "fig3", "the last of 10,000 targets").ours)[0] < 4.9
    share = row(reproduction, "fig3", "share in sight")
    assert numbers(share.ours) == [pytest.approx(56, abs=1.5)]
    assert (share.agrees, share.paper) == (None, claims.SILENT)
    for paper, claim in ((1.2429, "eta_1: largest"), (0.192, "smallest distance")):
        measured = row(reproduction, "fig9", claim)
        low, high = numbers(measured.ours)
        assert low < paper == numbers(measured.paper)[0] < high


@pytest.mark.long
def test_the_stories_of_the_paper(reproduction):
    # Oracle: float64 NumPy, simulated independently: recovery within 1.3 to 2.5 s, N = 10 with p = 3 leaves.
    coarse, fine = (row(reproduction, "fig6", f"(a) {start}").ours for start in ("Kuramoto", "with Euler"))
    assert 1.3 <= numbers(coarse)[0] <= 2.5
    assert numbers(fine)[0] == pytest.approx(numbers(coarse)[0], abs=0.1)
    before, after = numbers(row(reproduction, "theorem4", "N = 10").ours)[:2]
    assert before == 3 < after < 8
    shares = row(reproduction, "theorem1", "N = 6:").why
    assert float(re.search(r"p = 3 (\S+) %", shares)[1]) == pytest.approx(86, abs=8)


@pytest.mark.long
def test_the_window_of_the_gain(reproduction):
    # Oracle: collisions in 60 s of an earlier measurement on other code, 16 seeds: few from 0.9 to 1.25 alone.
    same = row(reproduction, "window", "the same")
    mean = {float(K): float(value) for value, K in re.findall(r"(\S+) \((\S+)\)", same.ours)}
    for K, expected in ((0.5, 27.6), (0.62, 9.7), (0.8, 1.4), (1.5, 7), (1.75, 37), (2, 59)):
        assert mean[K] == pytest.approx(expected, rel=0.25, abs=1)
    assert all(mean[K] < 1.5 for K in (0.9, 1, 1.1, 1.25))
    _, low, high = numbers(same.why)
    assert 0.62 < low <= 0.9
    assert 1.25 <= high < 1.5


@pytest.mark.long
def test_the_page_has_a_row_for_each_claim(reproduction):
    out, claims = reproduction
    page = (out / "README.md").read_text(encoding="utf-8")
    read = [line.replace("\\|", "|").split(" | ") for line in page.splitlines() if line.startswith("| ")][2:]
    assert [(cells[0][2:], cells[1], cells[3]) for cells in read] == [(c.part, c.claim, c.ours) for c in claims]
    assert {cells[5] for cells in read} == {"yes", "**no**", "-"}
    assert set(re.findall(r"\]\((\w+\.png)\)", page)) == {path.name for path in out.glob("*.png")}
    assert {path.name for path in out.iterdir() if path.name.startswith(".")} <= {LIST}


def test_a_claim_agrees_by_its_tolerance():
    assert claims.near("", 4.5, 4.7, 0.3).agrees
    assert not claims.near("", 4.5, 4.9, 0.3).agrees
    assert claims.within_range("", 0.192, np.array([0.1, 0.2])).agrees
    assert not claims.within_range("", 0.192, np.array([0.2, 0.3])).agrees
    assert not claims.all_of("", "", [True, False], "starts").agrees
    assert claims.at_most("", "", 1.0, 1.0).agrees
    assert not claims.at_most("", "", 1.1, 1.0).agrees
    assert claims.reported("", "", "").agrees is None


def test_the_condition_of_theorem_4_is_that_of_the_time_of_the_failure():
    # Story: of two opposite points one fails and resumes; they meet afterwards, in the first of two worlds.
    failed, meet = np.array([[[True, False]] * 2, [[False] * 2] * 2]), np.array([[False, False], [True, False]])
    arrays = SimpleNamespace(ring_phases=np.where(meet, 0.0, np.pi)[..., None].repeat(2, axis=-1), failed=failed)
    assert EpisodeArrays.largest_cosine.fget(arrays).tolist() == [-1, -1]
    assert first_times(np.array([0.0, 0.1]), meet).tolist() == [0.1, np.inf]


@pytest.mark.parametrize(("depth", "c"), [(0.8, 3), (0.3, 11)])
def test_distance_of_branches(depth, c):
    # Oracle: all pairs of points of the curve that are apart along it, by brute force.
    curve = Curve(1.8, 0.8, 3, 2, depth, c)
    gamma = np.linspace(0, 2 * np.pi, 2400, endpoint=False)
    place = closed_forms.curve_point_3d(curve, gamma)
    distance = np.linalg.norm(place[:, None] - place, axis=-1)
    # Only dips of the distance count: next to itself a branch is near for another reason.
    inner = distance[1:-1, 1:-1]
    around = [distance[1 + i : 2399 + i, 1 + j : 2399 + j] for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    index = np.arange(1, 2399)
    apart = np.abs(index[:, None] - index)
    dips = np.all([inner <= other for other in around], axis=0) & (np.minimum(apart, 2400 - apart) > 5)
    assert branch_radius(curve) == pytest.approx(inner[dips].min() / 2, abs=0.01)


def test_an_unknown_name_offers_the_nearest(tmp_path, capsys):
    code, _, error = called(capsys, "reproduce", "figg6", "--out", str(tmp_path / "out"))
    assert code == 2
    assert "got 'figg6'; did you mean fig6?" in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("settings", "said"), [({"seed": -1}, "seed must be"), ({"device": "gpu"}, "device must be")])
def test_bad_input_is_refused(settings, said, tmp_path):
    with pytest.raises(ValueError, match=said):
        reproduce(("fig2",), out=tmp_path / "out", **settings)
    assert not (tmp_path / "out").exists()


def test_an_interrupt_keeps_what_is_finished(tmp_path, monkeypatch, capsys):
    def interrupted(player):
        raise KeyboardInterrupt

    monkeypatch.setitem(PARTS, "lemmas", interrupted)
    with pytest.raises(KeyboardInterrupt, match="what was finished is in"):
        reproduce(("theorem2", "lemmas"), out=tmp_path)
    assert "theorem2" in (tmp_path / "README.md").read_text(encoding="utf-8")


def test_the_examples_of_the_page_say_what_happens():
    done = doctest.testfile(str(PAGE), module_relative=False)
    assert done.attempted > 10
    assert done.failed == 0


@pytest.mark.long
def test_the_stored_figures_are_those_of_today(reproduction):
    # Oracle: the simulation of this moment. What cars do depends on the last digits of the machine, its words do not.
    stored, fresh = figures.load(), figures.of_claims(reproduction[1])
    assert set(fresh) == set(PARTS)
    for part, table in fresh.items():
        assert stored[part]["columns"] == table["columns"]
        for old, new in zip(stored[part]["rows"], table["rows"], strict=True):
            for cell, now in zip(old, new, strict=True):
                assert NUMBER.sub("#", cell) == NUMBER.sub("#", now) or part in OF_CARS, (part, old, new)
                if part not in OF_CARS:
                    assert numbers(cell) == pytest.approx(numbers(now), rel=0.02, abs=0.01), (part, old, new)
            assert old[:2] + old[3:4] == new[:2] + new[3:4], part


def test_a_part_alone_has_rows_and_its_picture(tmp_path):
    # Story: `lissajous reproduce fig2 lemmas --format svg`; the page shows the picture, and names its command.
    claims = reproduce(("fig2", "lemmas"), tmp_path, format="svg", output=Output(quiet=True))
    assert [claim.part for claim in claims if claim.agrees is False] == []
    assert {claim.part for claim in claims} == {"fig2", "lemmas"}
    assert (tmp_path / "fig2.svg").read_bytes().startswith(b"<?xml")
    page = (tmp_path / "README.md").read_text()
    assert "](fig2.svg)" in page
    assert "--format svg" in page
    assert not list(tmp_path.glob("*.png"))
