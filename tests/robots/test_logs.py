"""Logs in MCAP: what is written is read again, scored as the simulation scored it, and refused if it is damaged."""

import dataclasses
import json
import math
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import called

import baselines
import lissajous_env
from lissajous_env.episodes.recording import record
from lissajous_env.logs.log import Log, Series, Track
from lissajous_env.logs.motion import motion_of
from lissajous_env.logs.reading import read
from lissajous_env.logs.scoring import score
from lissajous_env.logs.writing import START, log_of, save_mcap
from lissajous_env.world.columns import COLUMNS

SHORT = {"task.duration": 12.0, "faults.schedule": ((0, 4.0, 7.0), (4, 4.0, 8.0))}
APPROXIMATE = {"distance_mean": 2e-3, "contact_time": 1e-9, "smoothness": 1e-5}
"""Columns of what happens within a step, and of commands that were converted, with their relative errors."""


@pytest.fixture(scope="module")
def logged(tmp_path_factory):
    """A recorded episode and the file of its log."""
    recording = record(baselines.make("kuramoto-mpcc", "experiment", 1), "experiment", seed=5, **SHORT)
    path = tmp_path_factory.mktemp("logs") / "episode.mcap"
    save_mcap(recording, path)
    return recording, path


def same(one, other):
    """Return the columns in which two score rows differ by more than the log resolves."""
    differing = []
    for name in ("seed", *COLUMNS):
        tolerance, least = APPROXIMATE.get(name, 1e-4), 1e-3 if name == "min_separation" else 1e-4
        if one[name] != pytest.approx(other[name], rel=tolerance, abs=least, nan_ok=True):
            differing.append((name, one[name], other[name]))
    return differing


def test_a_log_has_the_poses_to_the_last_bit(logged):
    recording, path = logged
    log = read(path)
    assert (log.start, log.episode["policy"]) == (START, "kuramoto-mpcc")
    for robot, track in enumerate(log.tracks):
        np.testing.assert_array_equal(track.position, recording.position[:, robot])
        np.testing.assert_array_equal(track.speed, recording.speed[:, robot])
        np.testing.assert_allclose(np.cos(track.heading - recording.heading[:, robot]), 1, atol=1e-12)
        np.testing.assert_allclose(log_of(recording).tracks[robot].heading, track.heading, atol=1e-9)
        np.testing.assert_array_equal(log.phases[robot].value, recording.phase[:, robot])
        np.testing.assert_array_equal(log.statuses[robot].value, recording.status[:, robot])
        assert len(log.commands[robot].time) == len(recording) - 1


LONG = (
    ("rough-lost", "kuramoto-mpcc-safe"), ("evaders-lost", "partition-repair"), ("failure", "kuramoto"),
    ("knot", "open-loop"), ("hall", "sweep"), ("evaders-failure", "line-abreast"),
)  # fmt: skip
PAIRS = {"robot.count": 6, "formation.alpha": 2, "task.on_collision": "remove", "task.duration": 3.0}
HIT, WEAK = ({"robot.radius": 0.2, "task.duration": 6.0}, {"robot.offset": 6.2, "task.duration": 3.0})


@pytest.mark.parametrize(("scenario", "policy", "fields"), [
    *(pytest.param(*case, {}, marks=pytest.mark.long) for case in LONG),
    ("experiment", "kuramoto-mpcc", SHORT), ("evaders-uneven", "sweep", WEAK),
    ("evaders", "random", {"task.boundary": "remove", "task.duration": 6.0}),
    ("evaders", "random", HIT | {"task.on_collision": "remove", "faults.rate": 0.2}),
    ("evaders", "random", HIT | {"task.on_collision": "stop"}), ("evaders", "random", {"task.duration": 0.1}),
    ("hotspots", "index", {"task.duration": 3.0}),
    ("perturbation", "consensus", {"faults.removed": ((7, 1.0),), "task.duration": 3.0, "task.step": 0.6}),
    ("failure", "kuramoto", PAIRS | {"faults.removed": ((0, 1.0),), "faults.schedule": ()}),
    ("failure", "random", {"formation.phase_rate": 6.0, "task.on_collision": "stop", "task.duration": 3.0}),
])  # fmt: skip
def test_logs_of_every_kind_and_those_of_their_scores_score_as_the_simulation_did(scenario, policy, fields, tmp_path):
    scenario = lissajous_env.scenario(scenario, **fields)
    recording = log = record(baselines.make(policy, scenario), scenario, seed=2)
    for _ in range(2):
        save_mcap(log, tmp_path / "log.mcap")
        scored = score(read(tmp_path / "log.mcap"))
        log = scored.log
        unknown = () if scenario.task.action == "control" else ("return_mean", "smoothness", "blocked_time")
        assert same(recording.score | dict.fromkeys(unknown, math.nan), scored.recording.score) == []
        for name in ("position", "status", "sensed_at", "found_at"):
            np.testing.assert_array_equal(getattr(scored.recording, name), getattr(recording, name))


def test_an_episode_goes_on_where_nodes_of_removed_robots_send_no_poses(tmp_path):
    fields = {"faults.removed": [(robot, 1.0 + robot / 10) for robot in range(10)], "task.duration": 3.0}
    recording = record(baselines.make("consensus", "perturbation"), "perturbation", seed=2, **fields)
    save_mcap(recording, tmp_path / "log.mcap")
    log = read(tmp_path / "log.mcap")
    tracks = tuple(Track(*(array[: 13 + k] for array in vars(track).values())) for k, track in enumerate(log.tracks))
    scored = score(dataclasses.replace(log, tracks=tracks))
    assert same(recording.score, scored.rows[0]) == []
    np.testing.assert_array_equal(scored.recording.status, recording.status)


@pytest.mark.parametrize(("name", "fields", "seed"), [
    ("evaders", {"curve.b": 4, "formation.displaced": ((2, 1.8),), "formation.start_noise": 0.0}, 3), ("hall", {}, 7),
])  # fmt: skip
def test_a_log_without_phases_has_those_of_a_formation_and_one_without_an_episode_is_read(name, fields, seed, tmp_path):
    scenario = lissajous_env.scenario(name, **fields, **{"task.duration": 4.0})
    recording = record(baselines.make("open-loop-mpcc", scenario), scenario, seed=seed)
    log = log_of(recording)
    (row,), error = score(dataclasses.replace(log, phases={})).rows, recording.score["phase_error"]
    assert name == "hall" or pytest.approx(error) == row["phase_error"] > 1
    tracks = Track(*(np.delete(array, range(20, 30), 0) for array in vars(log.tracks[0]).values())), *log.tracks[1:]
    (row,) = score(dataclasses.replace(log, tracks=tracks, phases={})).rows
    assert row["phase_error"] == pytest.approx(error, abs=0.05), "also after a gap"
    save_mcap(dataclasses.replace(log, episode=None), tmp_path / "log.mcap")
    assert read(tmp_path / "log.mcap").episode is None


def circle(count=101, robots=5):
    time = np.linspace(0, 10, count)
    gamma = 0.3 * time[None] + np.arange(robots)[:, None]
    place = np.stack([np.cos(gamma), 0.5 * np.sin(gamma), 0 * gamma], axis=-1)
    return tuple(Track(time, path, 0 * time, 0.3 + 0 * time) for path in place)


def test_virtual_targets_differ_by_their_seeds_and_everything_else_does_not():
    overlapping = {"formation.start": "random", "formation.start_headway": 1.0, "robot.radius": 0.5}
    scored = score(Log("circle", circle()), lissajous_env.scenario("experiment", **overlapping), seeds=range(3))
    assert len({(row["targets"], row["detection_time_mean"]) for row in scored.rows}) > 1
    assert len({(row["idleness_mean"], row["min_separation"], row["distance_mean"]) for row in scored.rows}) == 1
    np.testing.assert_allclose(scored.recording.position[0], [track.position[0] for track in circle()], rtol=1e-6)


def test_another_number_of_robots_and_a_short_log_are_refused():
    with pytest.raises(ValueError, match="must have the 5 robots of experiment, got 4"):
        score(Log("few", circle(robots=4)), "experiment")
    with pytest.raises(ValueError, match="at least a control step of"):
        score(Log("fast", tuple(dataclasses.replace(track, time=track.time / 1e3) for track in circle())), "experiment")
    track, nan = circle(3)[0], np.full((3, 3), np.nan)
    for field, wrong in {"time": track.time[::-1], "position": nan, "heading": nan, "speed": [0.3]}.items():
        with pytest.raises(ValueError, match=f"{field} of a track must "):
            dataclasses.replace(track, **{field: wrong})
    for field, *wrong in (("time", track.time[::-1], nan), ("value", [], []), ("names", [0.0], [[0.0]], ("x", "y"))):
        with pytest.raises(ValueError, match=f"{field} of a series must "):
            Series(*wrong)
    for field in ("commands", "phases", "statuses"):
        with pytest.raises(ValueError, match=rf"{field} of a log must be of robots with a track, 0 to 4, got \[5\]"):
            Log("circle", circle(), **{field: {5: Series([0.0], [0.0])}})


def test_interpolation_is_exact_for_a_cubic():
    # Oracle: Hermite interpolation reproduces cubics; here along x with its derivative as the speed.
    time = np.array([0.0, 1.0, 2.5])
    place = np.stack([time**3, 0 * time, 0 * time], axis=1)
    places = motion_of(Track(time, place, 0 * time, 3 * time**2)).at(np.linspace(0, 2.5, 11))[0]
    np.testing.assert_allclose(places[:, 0], np.linspace(0, 2.5, 11) ** 3, atol=1e-12)
    np.testing.assert_allclose(motion_of(Track(time, 0 * place, time, 0 * time)).at(time[1:] / 2)[1], time[1:] / 2)
    # Oracle: a way without noise leads through all poses, also with a corner at every fifth of them.
    corners = np.cumsum(np.repeat([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] * 20, 5, axis=0), axis=0)
    track = Track(0.05 * np.arange(200), corners, *np.full((2, 200), np.nan))
    np.testing.assert_array_equal(motion_of(track).track.position, corners)


@pytest.mark.parametrize("turn", [1.0, 3.0])
@pytest.mark.parametrize("change", [0.0, 1.0, 2.0])
def test_the_way_is_exact_for_an_arc_and_obeys_a_law_where_the_yaw_rate_changes(turn, change):
    # Oracle: the integral of the velocity of a robot at 1 m/s whose yaw rate rises by `change`, with a way of 1 m.
    time = np.arange(4000) / 4000 + 1 / 8000
    heading = turn * time + 0.5 * change * time * (time - 1)
    last = [np.cos(heading).mean(), np.sin(heading).mean(), 0.0]
    track = Track(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], last]), np.array([0.0, turn]), np.ones(2))
    way = np.linalg.norm(np.diff(motion_of(track).at(np.linspace(0, 1, 4001))[0], axis=0), axis=1).sum()
    assert way == pytest.approx(1, abs=change**2 / 1000 + 1e-5)


@pytest.mark.parametrize(("scenario", "fields"), [
    ("rough", {"robot.kind": "differential"}), ("experiment", {"robot.drive": 100.0, "task.duration": 20.0}),
])  # fmt: skip
def test_robots_that_turn_half_around_or_more_between_poses_drive_as_in_the_simulation(scenario, fields, tmp_path):
    scenario = lissajous_env.scenario(scenario, **({"task.duration": 5.0} | fields))
    recording = record(baselines.make("random", scenario), scenario, seed=2)
    save_mcap(recording, tmp_path / "log.mcap")
    assert np.abs(np.angle(np.exp(1j * np.diff(recording.heading, axis=0)))).max() > 3
    (row,) = score(read(tmp_path / "log.mcap")).rows
    assert row["distance_mean"] == pytest.approx(recording.score["distance_mean"], rel=2e-3)


def test_computed_speeds_and_ways_of_noisy_poses_at_odd_times_are_precise_and_speeds_negative_in_reverse():
    # Oracle: a circle at 0.5 m/s, with poses in bursts, then at random times, and after gaps of 0.4 s and 30 s.
    random, steps = np.random.default_rng(0), np.arange(0, 10, 0.05)
    bursts = (steps[::5, None] + 1e-4 * np.arange(5)).ravel()
    time = np.concatenate([bursts, 10 + np.sort(random.uniform(0, 10, 200)), 20.4 + steps, 60 + steps])
    place = 0.2 * np.stack([np.cos(2.5 * time), np.sin(2.5 * time), 0 * time], axis=1)
    inside = np.arange(20.6, 29.8, 0.01)
    for noise, way, error in ((0.0, 1, 1e-4), (0.001, -1, 0.01), (0.01, 1, 0.02), (0.1, -1, 0.2)):
        noisy, heading = place + noise * random.normal(size=place.shape), 2.5 * time + way * np.pi / 2
        for logged in (np.nan, way * 0.5):
            motion = motion_of(Track(time, noisy, heading, logged + 0 * time), 1.0)
            driven = np.linalg.norm(np.diff(motion.at(inside)[0], axis=0), axis=1).sum()
            assert driven == pytest.approx(0.5 * np.ptp(inside), rel=error + 1e-3)
            assert np.sqrt(((motion.track.speed - way * 0.5) ** 2).mean()) < error


@pytest.mark.parametrize(
    "damage", [lambda data: data[: len(data) // 3], lambda data: data[:200] + b"\xff" * 4000, lambda data: b"no log"]
)
def test_a_damaged_or_missing_log_is_refused_by_its_name(logged, tmp_path, damage):
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(damage(logged[1].read_bytes()))
    with pytest.raises(ValueError, match="bad") as caught:
        read([logged[1], bad])
    assert logged[1] not in [path.resolve() for path in Path("/proc/self/fd").iterdir()], caught
    os.mkfifo(tmp_path / "pipe.mcap")
    bad.rename(tmp_path / "bad.csv")
    for name, rule in {"none.mcap": "existing", "pipe.mcap": "existing", "bad.csv": "rosbag2.* in Python"}.items():
        with pytest.raises(ValueError, match=rf"logs must be {rule}.*, got .*{name}"):
            read(tmp_path / name)


def test_the_commands_score_and_identify(logged, tmp_path, capsys, monkeypatch):
    recording, path = logged
    page, table, cars = (tmp_path / name for name in ("page.html", "rows.csv", "cars.toml"))
    code, out, err = called(capsys, "score", path, "--out", page, table, "--json")
    assert (code, err) == (0, "")
    (row,) = json.loads(out)["episodes"]
    assert same(recording.score, {name: math.nan if value is None else value for name, value in row.items()}) == []
    assert page.stat().st_size > 10_000
    assert "detection_time_mean" in table.read_text().partition("\n")[0]
    monkeypatch.setattr("lissajous_env.episodes.recording.MOST_BYTES", 10**5)
    assert [called(capsys, "score", path, *more)[0] for more in ((), ("--out", page))] == [0, 2], "a page is recorded"
    assert "out must be another file than the log, got" in called(capsys, "score", path, "--out", path)[2]
    (lab := tmp_path / "lab\ncurve.a = 9\n#.mcap").write_bytes(path.read_bytes())  # no fields of the scenario
    code, out, err = called(capsys, "identify", lab, "--topics", "/robot_0/odom", "/robot_3/odom", "--out", cars)
    assert (code, err) == (0, "")
    robot = lissajous_env.scenario(cars).robot
    assert robot.drive == pytest.approx(recording.scenario.robot.drive, rel=0.03)
    assert robot.model_offset is None, "controllers assume the cars that were identified"
    assert all(f"residuals of robot {k} over" in out for k in (0, 3))
    assert "warning" not in out
    alone = f"{sys.executable} -m lissajous_env identify {path} --topics /robot_0/odom --json"
    assert [*json.loads(os.popen(alone).read())] == ["0"]  # without a word of Warp, which starts there
