"""The scripts that write the README's tables: tables match their rows."""

import json
import re

import figures
from rich.console import Console

import lissajous_env
from baselines.benchmark import bounds, types
from baselines.benchmark.running import measure, plan, run
from baselines.benchmark.table import Table
from baselines.benchmark.types import Benchmark
from baselines.benchmark.written import markdown, table_of
from baselines.planning import portfolio
from lissajous_env.world.columns import COLUMNS


def rows(policy, times, scenario="intruders"):
    for k, time in enumerate(times):
        numbers = dict.fromkeys(COLUMNS, 0.5) | {"detection_time_mean": time}
        yield {"scenario": scenario, "policy": policy, "episode": k, "seed": k} | numbers


def test_the_table_says_what_the_rows_hold():
    scenario = lissajous_env.scenario("intruders")
    played = [*rows("kuramoto-mpcc", [4.0] * 4), *rows("laps", [2.0, 2.0, 2.0, 6.0])]
    made = table_of(Table.of(played, {"intruders": scenario}))
    first, laps = (dict(zip(made["columns"], row, strict=True)) for row in made["rows"])
    assert list(first)[:4] == ["scenario", "policy", "detection [s]", "over lower bound"]
    assert (first["scenario"], first["detection [s]"], first["sooner"]) == ("`intruders`, lower bound 0.582 s", "4", "")
    assert (laps["scenario"], laps["detection [s]"]) == ("", "2 (2\N{EN DASH}6)")
    assert laps["sooner"].startswith("75 %")
    lines = markdown(made).splitlines()
    assert lines[2].startswith("| `intruders`, lower bound 0.582 s | `kuramoto-mpcc` | 4 |")
    assert len({line.count("|") for line in lines}) == 1


def policies_of(table):
    """Policies of each scenario in a table in Markdown."""
    found = {}
    for line in table.splitlines()[2:]:
        where, policy = (cell.strip() for cell in line.split("|")[1:3])
        if where:
            of = found.setdefault(where.split("`")[1], set())
        of.add(policy)
    return found


def test_the_command_makes_the_table_of_the_readme(tmp_path):
    # Story: who runs the README's command finds its table in the folder: the same scenarios, policies and columns.
    # Oracle: the page itself. Episodes of half a second, as only what is played and shown counts.
    import baselines

    settings = Benchmark(episodes=1, out=tmp_path, replays=("none",), overrides={"task.duration": 0.5})
    run(settings, console=Console(quiet=True))
    page = (figures.ROOT / "docs" / "comparison.md").read_text(encoding="utf-8")
    stored = re.search(r"<!-- figures: policies -->\s+(.*?)\s+<!-- end -->", page, re.DOTALL)[1]
    made, told = ((tmp_path / "table.md").read_text().strip(), stored)
    assert made.splitlines()[0] == told.splitlines()[0]
    # Scenarios of another duration have no best known plan, and portfolios refuse such short ones.
    known = {each.name for each in bounds.all_known()} & set(types.SCENARIOS)
    assert {name for name, of in policies_of(told).items() if "*best known*" in of} == known
    missing = {"*best known*", *(f"`{name}`" for name in types.POLICIES if name in portfolio.NAMES)}
    assert policies_of(made) == {name: of - missing for name, of in policies_of(told).items()}
    readme = (figures.ROOT / "README.md").read_text(encoding="utf-8")
    gist = re.search(r"<!-- figures: gist -->\s+(.*?)\s+<!-- end -->", readme, re.DOTALL)[1].splitlines()[2:]
    assert [line.split("|")[1].strip(" `") for line in gist] == list(figures.GIST_POLICIES)
    assert set(types.POLICIES) <= set(baselines.names())
    # Every one of them has a guarantee, also where the scenario does not follow one by itself.
    rows = [json.loads(line) for line in (tmp_path / "episodes.jsonl").read_text().splitlines()]
    assert all(row["guaranteed_detection_time"] is not None for row in rows)


def test_a_named_scenario_is_played_as_in_the_standard_comparison(tmp_path):
    def played(**overrides):
        settings = Benchmark(("intruders",), ("still",), 1, out=tmp_path / str(len(overrides)), overrides=overrides)
        return measure(settings, console=Console(quiet=True)).table.scenarios["intruders"].task.contamination

    assert played(**{"task.duration": 0.5}) == (108, 48)
    assert played(**{"task.duration": 0.5, "task.contamination": None}) is None
    page = (tmp_path / "1" / "report.html").read_text()
    assert "--set 'task.contamination=(108, 48)' task.duration=0.5" in page


def test_policies_that_users_registered_are_played_beside_the_standard_ones_and_all_plays_every_one():
    import baselines

    baselines.register("theirs", "car", lambda scenario, num_worlds, device: None)
    names = lambda *policies: [cell.policy for cell in plan(Benchmark(("evaders",), policies))]  # noqa: E731
    usual = names()
    assert [name for name in usual if name not in types.POLICIES] == ["theirs"]
    assert {"arc-mpcc", "still", "theirs"} <= set(names("all"))
