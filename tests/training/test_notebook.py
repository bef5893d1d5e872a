"""The notebook that trains: every cell runs, in short, and what it trains is a policy."""

import re
from pathlib import Path

import pytest

pytest.importorskip("torch", reason='training is not installed: pip install ".[train]"')
import matplotlib.pyplot as plt

PAGE = Path(__file__).parents[2] / "docs" / "notebooks" / "learning.md"
SHORT = "STEPS, EPISODES = 64_000, 4"


def test_the_notebook_that_trains_runs_from_top_to_bottom(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    cells = re.findall(r"```{code-cell}\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert cells[0] == "STEPS, EPISODES = 3_000_000, 64\n"
    names: dict = {}
    for cell in [SHORT, *cells[1:]]:
        exec(compile(cell, str(PAGE), "exec"), names)
    plt.close("all")
    curve = names["history"]["curve"]
    assert [point["steps"] for point in curve][-1] >= 64_000
    assert len(curve) > 3
    assert (tmp_path / "learning_curve.png").stat().st_size > 1000
    printed = capsys.readouterr().out
    assert printed.count("in sight") == 5
    assert re.search(r"learned +0\.[234]\d\d in sight", printed)
