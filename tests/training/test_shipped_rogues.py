"""The included learned rogues: they have names, need no learning library, and hide better than the scripts."""

from pathlib import Path

import numpy as np
import pytest

import baselines
import lissajous_env
from benchmarks.rogues import LEARNED, rows
from training.learned import checkpoint
from training.settings import RogueTraining

SCRIPTS = ("wander", "flee", "shadow", "follow-gap")


def described(name):
    return checkpoint.read_description(LEARNED[name])


def test_each_shipped_rogue_tells_how_it_was_trained():
    # Story: the command and the seed are stored, the name says against whom, and an episode can be played by name.
    assert {"hide-from-sweep", "hide-from-partition", "hide-from-kuramoto-mpcc"} <= set(LEARNED)
    for name in LEARNED:
        about = described(name)
        stored = about["card"].settings
        settings = RogueTraining(**{key: stored[key] for key in ("scenario", "against", "seed", "rounds")})
        assert f"--against {settings.against}" in about["command"]
        assert f"--scenario {settings.scenario}" in about["command"]
        assert about["card"].scenario == settings.scenario
        assert name.startswith(f"hide-from-{settings.against}")
        assert name in lissajous_env.rogues()
        assert list(about["held_out_times"]) == [settings.against]


def test_the_table_of_the_page_is_that_of_the_stored_times():
    # Oracle: what the command that the page names prints.
    table, page = rows(), (Path(__file__).parents[2] / "docs" / "rogues.md").read_text(encoding="utf-8")
    assert len(table) >= len(LEARNED)
    assert [row for row in table if row not in page] == []


def test_each_shipped_rogue_hides_better_than_every_script():
    # Oracle: the stored times on seeds that were in neither training nor evaluations.
    for name in LEARNED:
        for times in described(name)["held_out_times"].values():
            assert times["learned"]["mean"] > 1.05 * max(times[script]["mean"] for script in SCRIPTS)


def test_the_stored_times_are_those_of_the_shipped_weights():
    # Oracle: a few of the held-out episodes; their mean lies within the spread of all.
    stored = described("hide-from-sweep")["held_out_times"]["sweep"]
    scenario = lissajous_env.scenario("evaders", **{"task.grid": None, "task.contamination": None})
    times = {}
    for rogue in ("hide-from-sweep", "follow-gap"):
        many = {"targets.count": 48, "targets.arrival_rate": 48 / scenario.task.duration}
        task = lissajous_env.scenario(scenario, rogues=rogue, **many, **{"targets.speed_limit": scenario.rogue_speed})
        rows = lissajous_env.evaluate(baselines.make("sweep", task, 4), task, range(10_000, 10_004))
        times[rogue] = np.array([row["detection_time_mean"] for row in rows])
    learned = times["hide-from-sweep"]
    assert np.abs(learned.mean() - stored["learned"]["mean"]) < 4 * max(learned.std(ddof=1), 0.2) / 2
    assert (learned > times["follow-gap"]).all()


def test_the_name_of_a_shipped_rogue_is_taken():
    with pytest.raises(ValueError, match="name of a rogue must be new, got 'hide-from-sweep'"):
        lissajous_env.rogue("hide-from-sweep")(lambda rows: rows)
