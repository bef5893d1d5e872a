"""The command for the figures of speed: evaluation of times, left-out parts, and that its parts run."""

import figures
import pytest
import speed
from speeds import Options, contamination, controller, marl, step

STORED = figures.load()
LIGHT = Options(rounds=2, worlds=4, threads=1, quick=True)


def names(table):
    return [row[0] for row in table["rows"]]


def test_steps_are_measured_and_stored_as_the_pages_show_them(tmp_path, monkeypatch, capsys):
    # Story: the command is run for real, by somebody without the rivals. Oracle: the table that the pages show.
    monkeypatch.setattr(figures, "STORE", tmp_path / "figures.json")
    speed.main(["--parts", "step", "--without-rivals", "--rounds", "2", "--worlds", "4", "--threads", "1", "--store"])
    assert "ParallelEnv.step" in capsys.readouterr().out
    tables = figures.load()
    assert set(tables) == {"machine", "speed"}
    assert tables["machine"]["columns"] == STORED["machine"]["columns"]
    assert tables["speed"]["columns"] == STORED["speed"]["columns"]
    assert set(names(STORED["speed"])) <= set(names(tables["speed"]))
    for name, worlds, middle, best, _, *rival in tables["speed"]["rows"]:
        assert worlds == ("4" if name.startswith("batch") else "1")
        assert float(middle) >= float(best) > 0
        assert rival == ["", "", ""]


@pytest.mark.parametrize("part", [contamination, controller, marl], ids=lambda part: part.PART.name)
def test_the_tables_of_a_part_are_those_of_the_pages(part):
    if part.PART.missing(LIGHT) and part is marl:
        pytest.skip("needs BenchMARL")
    for name, table in part.tables(LIGHT).items():
        assert table["columns"] == STORED[name]["columns"]
        assert names(table) == names(STORED[name])
        assert all(len(row) == len(table["columns"]) for row in table["rows"])


@pytest.mark.parametrize(("given", "said"), [
    (["--rounds", "0"], "must be a whole number of at least 1, got 0"),
    (["--against", "nowhere"], "must be a checkout or commit of this project, got nowhere"),
    (["--quick", "--store"], "--store must be without --quick"),
])  # fmt: skip
def test_what_is_wrong_is_named(given, said, capsys):
    with pytest.raises(SystemExit) as end:
        speed.main(given)
    assert said in capsys.readouterr().err + str(end.value.code)


def test_a_step_of_a_batch_stands_beside_the_rivals_per_world():
    # Oracle: by hand; 8 us for 4 worlds are 2 us a world, half a million a second, and 80 us are ten times that.
    times = {"ours": [8.0, 4.0, 16.0], "rival": [80.0, 80.0, 160.0]}
    assert step.rows_of(times, 4, "rival") == [["ours", "4", "2", "1", "0.500", "rival", "20", "10 (10\u201320)"]]
    assert step.rows_of({"ours": times["ours"]}, 4, "rival")[0][5:] == ["", "", ""]
