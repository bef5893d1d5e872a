"""Recordings: stored exactly, rejected if damaged, and drawn like the simulation."""

import io
import zipfile

import numpy as np
import pytest

import baselines
import lissajous_env
from lissajous_env.episodes import recording as recordings
from lissajous_env.render import Renderer, Snapshot, film, palette
from lissajous_env.replay.contents import contents
from lissajous_env.world.columns import task_score
from lissajous_env.world.coverage import last_sensed

SHORT = {"task.duration": 1.2, "faults.schedule": ((0, 0.3, 0.9),), "targets.count": 6, "targets.fleeing": 0.5,
         "targets.wandering": 0.5, "targets.arrival_rate": 2.0, "sensing.radius": 0.4}  # fmt: skip


class Straight:
    """Cars that go straight on."""

    def __init__(self, num_worlds: int = 1):
        self.num_worlds = num_worlds
        self.name = "straight"

    def reset(self, worlds=None):
        pass

    def act(self, observation):
        return np.zeros((*observation.shape[:2], 2), np.float32)


@pytest.fixture(scope="module")
def recording() -> recordings.Recording:
    return recordings.record(Straight(), lissajous_env.scenario("experiment", **SHORT), seed=4)


def resaved(recording, path, **changes) -> None:
    arrays = {name: getattr(recording, name) for name in recordings.ARRAYS} | changes
    with np.load(path) as stored:
        arrays.setdefault("about", stored["about"])
    np.savez_compressed(path, **{name: value for name, value in arrays.items() if value is not None})


def test_a_recording_holds_the_episode(recording):
    simulation = lissajous_env.Simulation(recording.scenario, seed=4)
    assert len(recording) == recording.scenario.task.steps + 1 == 13
    assert recording.duration == pytest.approx(1.2)
    for moment in range(len(recording)):
        np.testing.assert_array_equal(recording.position[moment], simulation.robots.position.numpy()[0])
        np.testing.assert_array_equal(recording.phase[moment], simulation.robots.phase.numpy()[0])
        np.testing.assert_array_equal(recording.status[moment], simulation.robots.status.numpy()[0])
        np.testing.assert_array_equal(recording.target_position[moment], simulation.targets.position.numpy()[0])
        cells = simulation.cells
        seen = last_sensed(cells.sensed_at.numpy()[0], cells.in_discs.numpy()[0], moment)
        np.testing.assert_array_equal(recording.sensed_at[moment], seen)
        simulation.step(np.zeros(simulation.action_shape, np.float32))
    assert recording.score["policy"] == "straight"
    assert recording.score["seed"] == 4
    evaluated = lissajous_env.evaluate(Straight(), recording.scenario, seeds=[4])[0]
    assert str({**recording.score}) == str({name: evaluated[name] for name in recording.score})


def test_a_batch_records_its_first_world(recording):
    batch = recordings.record(Straight(num_worlds=3), recording.scenario, seed=4)
    np.testing.assert_array_equal(batch.position, recording.position)


def test_saved_and_loaded_by_any_name_is_the_same(recording, tmp_path):
    path = tmp_path / "episode.rec"
    recording.save(path)
    loaded = recordings.load(path)
    assert [file.name for file in tmp_path.iterdir()] == ["episode.rec"]
    assert loaded.scenario == recording.scenario
    assert str(loaded.score) == str(recording.score)
    for name in recordings.ARRAYS:
        original, read = getattr(recording, name), getattr(loaded, name)
        assert original.dtype == read.dtype, name
        np.testing.assert_array_equal(original, read, err_msg=name)


def test_infinite_fields_of_a_scenario_come_back_and_infinite_actions_as_the_zeros_that_they_count_as(tmp_path):
    scenario = lissajous_env.scenario("failure", **{"faults.schedule": ((1, 0.2, np.inf),), "task.duration": 0.5})
    simulation = lissajous_env.Simulation(scenario)
    recorder = recordings.Recorder(simulation)
    recorder.take()
    simulation.step(np.full(simulation.action_shape, np.inf))
    recorder.take()
    recorder.recording("nobody").save(tmp_path / "one.npz")
    loaded = recordings.load(tmp_path / "one.npz")
    assert loaded.scenario == simulation.scenario
    assert not loaded.action.any()


def test_every_damaged_byte_is_refused_or_harmless(recording, tmp_path):
    path = tmp_path / "hit.npz"
    recording.save(path)
    whole = path.read_bytes()
    for at in np.random.default_rng(0).integers(0, len(whole), 60):
        hit = bytearray(whole)
        hit[at] ^= 0xFF
        path.write_bytes(hit)
        refused = None
        try:
            loaded = recordings.load(path)
        except ValueError as error:
            refused = str(error)
        else:  # some bytes of a zip file mean nothing, as its dates
            np.testing.assert_array_equal(loaded.position, recording.position)
        assert refused is None or "hit.npz" in refused


def test_foreign_files_are_refused_by_name(recording, tmp_path):
    path = tmp_path / "foreign.npz"
    pickled = io.BytesIO()
    np.save(pickled, np.array([{}], dtype=object), allow_pickle=True)
    array = io.BytesIO()
    np.save(array, np.zeros(3))
    for data in (b"", b"GIF89a", pickled.getvalue(), array.getvalue()):
        path.write_bytes(data)
        with pytest.raises(ValueError, match=r"foreign\.npz must be an undamaged recording"):
            recordings.load(path)
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("readme.txt", "hello")
    with pytest.raises(ValueError, match="it lacks"):
        recordings.load(path)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("heading", lambda a: a[:, :3]),
        ("position", lambda a: a * np.nan),
        ("found_at", lambda a: None),
        ("contact", lambda a: np.array([[0, 0, 99]])),
        ("sensed_at", lambda a: a[:-1]),
        ("status", lambda a: a.astype("U3")),
        ("about", lambda a: np.array('{"format": "something else"}')),
        ("about", lambda a: np.array('{"format": "lissajous recording 2", "scenario": {"curve": {"d": 1}}}')),
        ("about", lambda a: np.array("[]")),
    ],
)
def test_arrays_that_do_not_fit_are_refused_by_name(recording, tmp_path, name, change):
    path = tmp_path / "odd.npz"
    recording.save(path)
    resaved(recording, path, **{name: change(getattr(recording, name, None))})
    with pytest.raises(ValueError, match=r"odd\.npz must be an undamaged recording"):
        recordings.load(path)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.npz"):
        recordings.load(tmp_path / "none.npz")


def test_pictures_of_a_recording_are_those_of_the_simulation(recording):
    simulation = lissajous_env.Simulation(recording.scenario, seed=4)
    live = Renderer(recording.scenario, 0.5)
    for picture in film.frames(recording, Renderer(recording.scenario, 0.5)):
        np.testing.assert_array_equal(live.draw(simulation), picture)
        simulation.step(np.zeros(simulation.action_shape, np.float32))


def test_an_episode_too_large_to_be_kept_is_refused_while_it_is_recorded(monkeypatch):
    monkeypatch.setattr(recordings, "MOST_BYTES", 10_000)
    with pytest.raises(ValueError, match=r"a recording must contain at most 10,000 bytes: use a coarser task\.grid"):
        recordings.record(Straight(), lissajous_env.scenario("experiment", **SHORT))
    # Each of hundreds of detections is a target of its own, with its places at 101 moments.
    monkeypatch.setattr(recordings, "MOST_BYTES", 700_000)
    again = lissajous_env.scenario("rough", **{"targets.respawn": True, "task.duration": 10.0, "sensing.radius": 9.0})
    with pytest.raises(ValueError, match="a recording must contain at most 700,000 bytes"):
        recordings.record(baselines.make("still", again), again)


@pytest.mark.parametrize(("name", "effect", "more"), [("watch", "count", 99), ("experiment", "remove", 0)])
def test_every_collision_is_recorded_and_over_when_a_robot_is_removed(name, effect, more):
    # Law: there is a contact in each moment in which the number of collisions has grown, also if it was over before.
    scenario = lissajous_env.scenario(name, **{"task.duration": 120.0, "task.on_collision": effect})
    recording = recordings.record(baselines.make("random", scenario), scenario, seed=1)
    grown, count = np.flatnonzero(np.diff(recording.collisions)) + 1, recording.collisions[-1]
    assert {*grown} <= {*recording.contact[:, 0]}
    assert 0 < len(grown) <= count <= len(recording.contact) <= count + more


@pytest.mark.parametrize(("name", "score"), [("watch", "observed_fraction"), ("intercept", None)])
def test_the_targets_in_sight_are_those_of_the_simulation(name, score):
    scenario = lissajous_env.scenario(name, **{"task.duration": 30.0, "faults.schedule": ((1, 5.0, 12.0),)})
    simulation, policy = lissajous_env.Simulation(scenario, seed=2), baselines.make("greedy-cover", scenario)
    recorder, shares = recordings.Recorder(simulation), []
    recorder.take()
    for _ in range(scenario.task.steps):
        simulation.step(policy.act(simulation.observation.numpy()))
        recorder.take()
        now = Snapshot.of(simulation)
        in_sight = now.in_sight(scenario.sight)
        np.testing.assert_array_equal(in_sight[now.present], simulation.targets.in_sight.numpy()[0][now.present] > 0)
        shares.append(in_sight.mean())
    assert 0 < np.mean(shares) < 1
    recording = recorder.recording()
    assert now.num_detected == round(recording.score["detected_fraction"] * recording.score["targets"])
    assert now.mean_detection_time(scenario.task.step) == pytest.approx(recording.score["detection_time_mean"])
    if score is not None:
        assert np.mean(shares) == pytest.approx(recording.score[score])
    page = contents(recording)
    assert page["curve"]["shape"] == [3, 0]
    assert page["scenario"]["links"] == []
    assert next(iter(page["score"])) == task_score(scenario).name


def test_targets_that_stay_are_green_while_they_are_in_sight_and_no_curve_is_drawn():
    simulation = lissajous_env.Simulation("watch", seed=2)
    assert 0 < Snapshot.of(simulation).in_sight(4.0).sum() < 10
    picture = Renderer("watch").draw(simulation).astype(int)
    hall = Renderer("hall").draw(lissajous_env.Simulation("hall", seed=2)).astype(int)

    def count(picture, colour):
        return (np.abs(picture - colour).max(axis=-1) < 12).sum()

    assert count(picture, palette.TARGET) > 20
    assert count(picture, palette.DETECTED) > 20
    assert count(picture, palette.CURVE) < 100 < count(hall, palette.CURVE)
