"""The rogue that a policy misses: closed forms, brute force, and the simulation's own detection."""

import dataclasses
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from reference_contamination import Field
from reference_witness import fault_of, first_detection

import baselines
import lissajous_env
from baselines.commands.exploit import exploit
from lissajous_env.console.terminal import Output
from lissajous_env.episodes.witness import nearest, witness_of, witnesses_of
from lissajous_env.episodes.witness.played import play
from lissajous_env.episodes.witness.replayed import record_again
from lissajous_env.replay import page

GRID = {"task.contamination": (90, 40)}
SHORT = {"task.duration": 12.0}


def missed(scenario, policy, seed=0, **overrides):
    made = lissajous_env.scenario(scenario, **overrides)
    return witness_of(baselines.make(policy, made, 1), made, seed)


# Stories with closed forms.


def corridor(**overrides):
    """A corridor that the disc of one robot fills, which goes from the right end to the left."""
    return lissajous_env.scenario(
        "experiment",
        **{
            "robot.kind": "curve", "robot.count": 1, "formation.p": 0, "formation.ring": None,
            "formation.start_noise": 0.0, "faults.schedule": (), "noise.wheelbase_spread": 0.0,
            "noise.drive_spread": 0.0, "robot.model_offset": None, "curve.half_height": 0.06,
            "curve.a": 1, "curve.b": 2,
            "sensing.radius": 0.5, "targets.count": 1, "targets.arrival_rate": 0.0, "targets.speed": 0.1,
            "targets.speed_limit": 0.15, "task.contamination": (90, 3), "task.grid": None, "task.duration": 20.0,
        } | overrides,
    )  # fmt: skip


def test_a_rogue_waits_at_the_end_of_a_corridor():
    # Oracle: the robot's place on the curve (3). It cannot be passed, so the rogue waits in the far corner that its
    # disc covers last.
    made = corridor()
    found = witness_of(baselines.make("open-loop", made, 1), made, 0)
    time = np.arange(0, 20, 1e-3)
    gamma = made.alpha * made.equilibrium[0] + made.formation.phase_rate * time
    x, y = 1.8 * np.cos(gamma), 0.06 * np.sin(2 * gamma)
    caught = max(time[np.argmax(np.hypot(x + 1.8, y + corner) < 0.5)] for corner in (-0.06, 0.06))
    assert 1.0 < caught < 20.0
    assert found.way.appears_at == 0
    assert found.undetected == pytest.approx(caught, abs=0.1)


def test_without_a_guarantee_the_rogue_is_undetected_for_the_whole_episode():
    for policy in ("still", "sweep"):
        found = missed("evaders", policy, **SHORT)
        assert not found.replayed.detected
        assert found.undetected == pytest.approx(11.9)  # targets appear from the first step on
        assert len(found.way.places) == 120


def test_without_rogues_there_is_none():
    assert missed("evaders", "still", **{"targets.arrival_rate": 0.0}) is None
    with pytest.raises(ValueError, match=r"task\.contamination of experiment must be"):
        missed("experiment", "still")


def test_nobody_hides_from_a_disc_that_covers_all():
    found = missed("evaders", "still", **{"sensing.radius": 9.0, **SHORT})
    assert found is None


# Brute force, and the simulation.


@pytest.mark.parametrize(("policy", "radius", "speed"), [("kuramoto-mpcc", 0.7, 0.6), ("random", 0.65, 0.5)])
def test_the_rogue_is_that_of_a_search_over_all_paths(policy, radius, speed):
    # Oracle: the field of all paths on another grid, with exact discs at four moments of a step and no contamination.
    settings = {"sensing.radius": radius, "targets.speed_limit": speed, "targets.count": 1, **GRID}
    found = missed("experiment", policy, 3, **{"task.duration": 6.0, "faults.schedule": (), **settings})
    track = found.played.track
    share = np.array([0.5, 1.0]) * (track.shape[2] - 1)
    slices = track[:, :, share.astype(int)].transpose(0, 2, 1, 3)
    brute = Field(slices, (1.8, 0.8), radius, speed, 0.1, finer=4).run()
    assert abs((found.way.unseen_until - found.way.appears_at) - brute.max()) <= 2


CASES = [
    ("evaders", "kuramoto-mpcc", {}),
    ("evaders", "random", {"targets.entry": "boundary", "targets.speed_limit": 0.6}),
    ("evaders-failure", "open-loop-mpcc", {}),
    ("team", "kuramoto-mpcc", {}),
    ("redundant", "open-loop", {"targets.speed_limit": 0.5}),
]


@pytest.mark.parametrize(("scenario", "policy", "overrides"), CASES)
def test_a_rogue_is_an_ordinary_target_that_is_detected_when_the_witness_says(scenario, policy, overrides):
    # Oracle: speed, walls and distances in float64 from the recorded robots, and the simulation's own detection.
    made = lissajous_env.scenario(scenario, **{**SHORT, **overrides})
    for found in witnesses_of(baselines.make(policy, made, 2), made, [4, 5]):
        assert fault_of(found) is None
        seen = first_detection(found.played, found.way)
        assert found.replayed.detected == (seen is not None)
        if seen is not None:
            assert found.undetected == pytest.approx(seen * made.task.step, abs=2e-3)
        way = found.way.unseen_until - found.way.appears_at
        assert found.undetected >= way * made.task.step - 1e-6
        assert found.undetected <= found.proved + 1e-6


def test_the_oracle_finds_faults():
    found = missed("evaders", "kuramoto-mpcc", **SHORT)
    way = found.way
    for places, words in (
        (way.places * 3, "leaves the rectangle|moves"),
        (way.places[::2], "moves|within a disc"),
        (np.repeat(way.places[:1], len(way.places), axis=0), "within a disc"),
    ):
        wrong = dataclasses.replace(found, way=way._replace(places=places))
        assert any(word in (fault_of(wrong) or "") for word in words.split("|"))


def test_the_rogue_of_the_reported_worst_case_is_found():
    # Seed 2 of `random` passes a gap of millimetres past fast robots.
    for policy, seed in (("kuramoto-mpcc", 0), ("random", 2)):
        found = missed("evaders", policy, seed, **{"task.duration": 16.0})
        assert abs(found.undetected - found.stated) <= found.resolution + 0.1


# The page and the command.


def data_of(html):
    """Data of a page."""
    return json.loads(html.partition('id="data"')[2].partition(">")[2].partition("</script>")[0])


def test_episodes_that_are_searched_apart_have_the_same_rogues(monkeypatch):
    # Law: the limit on the labels that are read at once changes no way.
    scenario = lissajous_env.scenario("evaders", **SHORT)
    episodes = play(baselines.make("open-loop-mpcc", scenario, 3), scenario, [0, 1, 2])
    together, counts, search = nearest.longest_ways(episodes), [], nearest._longest_ways
    monkeypatch.setattr(nearest, "_LABELS", 2 * episodes[0].labels.size)
    monkeypatch.setattr(nearest, "_longest_ways", lambda some: (counts.append(len(some)), search(some))[1])
    apart = nearest.longest_ways(episodes)
    assert counts == [2, 1]
    for (one, _), (other, _) in zip(together, apart, strict=True):
        assert one.appears_at == other.appears_at
        assert np.array_equal(one.places, other.places)


def test_the_page_shows_the_rogue():
    found = missed("evaders", "kuramoto-mpcc", **SHORT)
    recording = record_again(found.played, found.policy)
    assert recording.score["detection_time_mean"] == pytest.approx(
        found.played.score["detection_time_mean"], nan_ok=True
    )
    rogue = data_of(page(recording, missed=found))["episodes"][0]["rogue"]
    assert rogue["steps"][0] == found.way.appears_at
    assert len(rogue["places"]) == len(rogue["steps"]) == len(found.way.places)
    assert (rogue["until"] - rogue["steps"][0]) * 0.1 == pytest.approx(found.undetected, abs=1e-3)
    assert data_of(page(recording))["episodes"][0]["rogue"] is None


def test_the_command(tmp_path, capsys):
    out = tmp_path / "rogue.html"
    overrides = (("task.duration=8",),)
    exploit("evaders", "still", witness=True, episodes=2, out=out, output=Output(json=True), overrides=overrides)
    printed = json.loads(capsys.readouterr().out)
    assert [row["seed"] for row in printed["episodes"]] == [0, 1]
    assert printed["episodes"][0]["witness"] == pytest.approx(7.9)
    assert printed["episodes"][0]["conservative"] >= 7.9
    assert out.read_text(encoding="utf-8").startswith("<!doctype html>")


@pytest.mark.long
def test_compiling_the_search_prints_nothing_of_warp(tmp_path):
    command = "exploit", "evaders", "still", "--witness", "--episodes", "1", "--quiet", "--set", "task.duration=8"
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path)}
    line = [sys.executable, "-m", "lissajous_env", *command]
    ended = subprocess.run(line, capture_output=True, text=True, env=environment, timeout=200)
    assert ended.returncode == 0, ended.stderr
    assert "Module " not in ended.stdout + ended.stderr
