"""The command for the figures of speed: evaluation of times, left-out parts, and that its parts run."""

import importlib.metadata
import sys
from dataclasses import replace

import figures
import pytest
import speed
import speeds
import timing
from speeds import Options, act, contamination, controller, step, training

# What the pages show, whose marks name columns and rows.
STORED = figures.load()
LIGHT = Options(rounds=2, worlds=4, threads=1, quick=True)


def names(table):
    return [row[0] for row in table["rows"]]


def test_steps_are_measured_and_stored_as_the_pages_show_them(tmp_path, monkeypatch, capsys):
    # Story: the command is run for real, by somebody without the rivals. Oracle: the table that the pages show.
    monkeypatch.setattr(figures, "STORE", tmp_path / "figures.json")
    speed.main(["--parts", "step", "--without-rivals", "--rounds", "2", "--worlds", "4", "--threads", "1", "--store"])
    assert "ParallelEnv.step" in capsys.readouterr().out
    found = figures.load()
    assert set(found) == {"machine", "speed"}
    assert found["machine"]["columns"] == STORED["machine"]["columns"]
    assert found["speed"]["columns"] == STORED["speed"]["columns"]
    assert set(names(STORED["speed"])) <= set(names(found["speed"]))
    for name, worlds, middle, best, _, *rival in found["speed"]["rows"]:
        assert worlds == ("4" if name.startswith("batch") else "1")
        assert float(middle) >= float(best) > 0
        assert rival == ["", "", ""]


@pytest.mark.parametrize("part", [contamination, controller, act], ids=lambda part: part.PART.name)
def test_the_tables_of_a_part_are_those_of_the_pages(part):
    for name, table in part.tables(LIGHT).items():
        assert table["columns"] == STORED[name]["columns"]
        assert names(table) == names(STORED[name])
        assert all(len(row) == len(table["columns"]) for row in table["rows"])


@pytest.mark.long
def test_memory_is_that_of_a_process_with_nothing_else():
    # Oracle: Python with Warp is above 50 MB; small worlds add little.
    (table,) = speed.measured(speed.PARTS["memory"], LIGHT).values()
    assert table["columns"] == STORED["memory"]["columns"]
    assert names(table) == names(STORED["memory"])
    assert 50 < float(table["rows"][0][2]) < 2000


def test_a_solve_without_a_rival_has_no_row_of_it():
    rows = names(controller.tables(replace(LIGHT, rivals=False))["mpcc"])
    assert "solve from the guess [us]" in rows
    assert not any("IPOPT" in name for name in rows)


def test_a_part_without_its_rival_is_left_out_in_one_line(monkeypatch, capsys):
    # Story: VMAS is not installed, and there is no other checkout.
    monkeypatch.setattr(speeds, "find_spec", lambda name: None if name in ("vmas", "casadi") else name)
    monkeypatch.setattr(speed, "measured", lambda part, options: pytest.fail(f"{part.name} was measured"))
    with pytest.raises(SystemExit, match="no part is left"):
        speed.main(["--parts", "step", "growth", "controller", "step"])
    assert capsys.readouterr().out.splitlines() == [
        'left out: step; pip install ".[bench]" for vmas, or pass --without-rivals',
        "left out: growth; pass --against FOLDER with another checkout, or pass --without-rivals",
        'left out: controller; pip install ".[bench]" for casadi',
    ]


def test_a_part_has_the_rounds_that_are_asked_for_or_its_own(monkeypatch):
    asked = []
    monkeypatch.setattr(speed, "measured", lambda part, options: asked.append((part.name, options)) or {})
    given = ["--parts", "growth", "contamination", "--against", str(figures.ROOT)]
    speed.main(given)
    assert [name for name, _ in asked] == ["growth", "contamination"]
    assert {options.rounds for _, options in asked} == {15}
    assert {options.against for _, options in asked} == {figures.ROOT}
    assert {options.worlds for _, options in asked} == {4096}
    speed.main([*given, "--rounds", "3"])
    speed.main([*given, "--quick"])
    assert [options.rounds for _, options in asked[2:]] == [3, 3, 2, 2]
    assert all(options.worlds < 100 for _, options in asked[4:])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--parts", "steps"], "invalid choice: 'steps'"),
        (["--rounds", "0"], "must be a whole number of at least 1, got 0"),
        (["--worlds", "many"], "must be a whole number of at least 1, got many"),
        (["--against", "nowhere"], "must be a checkout or commit of this project, got nowhere"),
        (["--quick", "--store"], "--store must be without --quick"),
    ],
)
def test_what_is_wrong_is_named(given, said, capsys):
    with pytest.raises(SystemExit) as end:
        speed.main(given)
    assert said in capsys.readouterr().err + str(end.value.code)


def test_a_step_of_a_batch_stands_beside_the_rivals_per_world():
    # Oracle: by hand; 8 us for 4 worlds are 2 us a world, half a million a second, and 80 us are ten times that.
    times = {"ours": [8.0, 4.0, 16.0], "rival": [80.0, 80.0, 160.0]}
    assert step.rows_of(times, 4, "rival") == [["ours", "4", "2", "1", "0.500", "rival", "20", "10 (10\u201320)"]]
    assert step.rows_of({"ours": times["ours"]}, 4, "rival")[0][5:] == ["", "", ""]


def test_contamination_stands_beside_a_step_without_it():
    times = {"without": [8.0, 8.0, 8.0], "grid": [20.0, 20.0, 16.0]}
    assert contamination.rows_of(times, "batch", 4) == [
        ["batch, without", "4", "2", "2", "", ""],
        ["batch, grid", "4", "5", "4", "3", "2.50 (2\u20132.50)"],
    ]


def test_trainings_stand_beside_those_of_this_checkout():
    # Oracle: by hand; pairs of 4 and 2.
    rates = {training.OURS: [4000.0] * 4, "before": [2000.0] * 4}
    rows = training.rows_of(rates)
    assert [row[:3] for row in rows] == [["here", "4,000", "4,000"], ["before", "2,000", "2,000"]]
    assert rows[0][3] == ""
    assert rows[1][3].startswith("2")


def test_another_checkout_registers_its_own_and_not_what_is_installed(tmp_path, monkeypatch):
    # Story: an older version kept its policies in a module that is gone; Python is to look for that one.
    (tmp_path / "pyproject.toml").write_text(
        '[project]\nname = "lissajous-env"\n[project.entry-points."lissajous_env.policies"]\nold = "gone:register"\n'
    )
    monkeypatch.syspath_prepend(training.declared(tmp_path, tmp_path))
    found = importlib.metadata.entry_points(group="lissajous_env.policies")
    assert [(each.name, each.value) for each in found] == [("old", "gone:register")]


def test_sides_take_turns_and_a_ratio_is_of_their_pairs():
    # Story: every other round is ten times as slow, for both sides; their ratio is three in each.
    called = []
    times = timing.by_turns({"a": (lambda: called.append("a"), 1), "b": (lambda: called.append("b"), 2)}, 2)
    assert "".join(called) == "ab" + "abb" * 2
    assert [len(each) for each in times.values()] == [2, 2]
    assert timing.ratio([1.0, 10.0, 1.0, 10.0], [3.0, 30.0, 3.0, 30.0]) == (3.0, 3.0, 3.0)


def test_each_part_has_a_row_with_its_machine():
    made = speed.machine(["act", "step"], 3)
    for part, row in zip(("`act`", "`step`"), made["rows"], strict=True):
        told = dict(zip(made["columns"], row, strict=True))
        assert (told["part"], told["threads"]) == (part, "3")
        assert told["Python"] == ".".join(map(str, sys.version_info[:3]))
        assert all(row)


def test_a_part_that_is_measured_again_replaces_its_row_alone():
    before = speed.machine(["act", "step"], 3)
    after = speed.with_rows_of(before, speed.machine(["step", "growth"], 2))
    assert {row[0]: row[3] for row in after["rows"]} == {"`act`": "3", "`growth`": "2", "`step`": "2"}
