"""The rogue that a policy misses: closed forms, brute force, and the simulation's own detection."""

import json

import numpy as np
import pytest
from command_line import called
from reference_contamination import Field
from reference_missed_rogue import fault_of, first_detection

import baselines
import lissajous_env
from baselines.commands.exploit import exploit
from baselines.commands.playing import PlayOptions
from lissajous_env.episodes.missed import missed_rogue, play
from lissajous_env.episodes.missed.played import PlayedEpisode
from lissajous_env.episodes.missed.search import longest_path
from lissajous_env.episodes.recording import record
from lissajous_env.replay import Replay

SHORT = {"task.duration": 12.0}


def missed(name, policy, seed=0, **overrides):
    scenario = lissajous_env.scenario(name, **overrides)
    return missed_rogue(baselines.make(policy, scenario, 1), scenario, seed)


# Stories with closed forms.


def test_a_rogue_waits_at_the_end_of_a_corridor():
    # Oracle: the robot's place on the curve (3). Its disc fills the corridor and goes from right to left, so the rogue
    # waits in the corner that it covers last.
    corridor = lissajous_env.scenario(
        "experiment",
        **{
            "robot.kind": "curve", "robot.count": 1, "robot.model_offset": None, "formation.p": 0,
            "formation.ring": None, "formation.start_noise": 0.0, "noise.wheelbase_spread": 0.0,
            "noise.drive_spread": 0.0, "curve.a": 1, "curve.b": 2, "curve.half_height": 0.06, "faults.schedule": (),
            "sensing.radius": 0.5, "targets.count": 1, "targets.arrival_rate": 0.0, "targets.speed": 0.1,
            "targets.speed_limit": 0.15, "task.contamination": (90, 3), "task.grid": None, "task.duration": 20.0,
        },
    )  # fmt: skip
    rogue = missed_rogue(baselines.make("open-loop", corridor, 1), corridor, 0)
    time = np.arange(0, 20, 1e-3)
    gamma = corridor.alpha * corridor.equilibrium[0] + corridor.formation.phase_rate * time
    x, y = 1.8 * np.cos(gamma), 0.06 * np.sin(2 * gamma)
    caught = max(time[np.argmax(np.hypot(x + 1.8, y + corner) < 0.5)] for corner in (-0.06, 0.06))
    assert 1.0 < caught < 20.0
    assert rogue.path.appears_at == 0
    assert rogue.undetected == pytest.approx(caught, abs=0.01)


def test_without_a_guarantee_the_rogue_is_undetected_for_the_whole_episode():
    rogue = missed("evaders", "sweep", **SHORT)
    assert not rogue.detected
    assert rogue.undetected == pytest.approx(11.9)  # targets appear from the first step on
    assert rogue.path.steps == 119
    # The rogue of the stage appears at once, and is detected after 3.3 s; one that appears later is not.
    later = missed("evaders", "sweep", **SHORT, **{"targets.count": 3, "targets.arrival_rate": 0.5})
    assert later.path.appears_at > 0
    assert later.undetected == pytest.approx(11.9, abs=0.2)  # a cell


def test_without_rogues_or_without_a_place_for_them_there_is_none():
    assert missed("evaders", "still", **{"targets.arrival_rate": 0.0}, **SHORT) is None
    assert missed("evaders", "still", **{"sensing.radius": 9.0, **SHORT}) is None
    with pytest.raises(ValueError, match=r"task\.contamination of experiment must be"):
        missed("experiment", "still")


def test_a_rogue_appears_in_the_middle_if_only_that_is_unsensed():
    # Story: robots stand all along the edges, so a rogue has to appear away from them, where it stays.
    scenario = lissajous_env.scenario("evaders", **{"task.duration": 1.0})
    x, y = np.meshgrid(np.linspace(-1.8, 1.8, 9), [-0.8, 0.8])
    discs = np.concatenate([np.stack([x, y], axis=-1).reshape(-1, 2), [[-1.8, 0.0], [1.8, 0.0]]])
    track = np.tile(discs[:, None], (11, 1, 2, 1)).astype(np.float32)
    works, action = np.ones(track.shape[:2], bool), np.zeros((11, len(discs), 2), np.float32)
    path = longest_path(PlayedEpisode(scenario, 0, {}, track, works, action, np.zeros(11, np.int32)))
    assert path.steps == 10
    assert (np.abs(path.places[:, 1]) < 0.4).all()


def test_a_robot_that_fails_senses_nothing_in_a_step_in_which_others_collide_with_it():
    # Story: bodies overlap from the start, so all five collide in the first step, in which one has failed already.
    body = {"robot.radius": 1.0, "formation.start_headway": 0.0, "faults.schedule": ((0, 0.0, 9.0),)}
    scenario = lissajous_env.scenario("evaders", **{"task.duration": 0.3, "task.on_collision": "stop", **body})
    works = play(baselines.make("random", scenario, 1), scenario).works
    assert works.tolist() == [[True] * 5, [False, *[True] * 4], [False] * 5, [False] * 5]


# Brute force, and the simulation.


def test_the_rogue_is_that_of_a_search_over_all_paths():
    # Oracle: the field of all paths on another grid, with exact discs at four moments of a step and no contamination.
    settings = {"sensing.radius": 0.65, "targets.speed_limit": 0.5, "targets.count": 1, "task.contamination": (90, 40)}
    rogue = missed("experiment", "random", 3, **{"task.duration": 4.0, "faults.schedule": (), **settings})
    path = rogue.played.path
    share = np.array([0.5, 1.0]) * (path.shape[2] - 1)
    slices = path[:, :, share.astype(int)].transpose(0, 2, 1, 3)
    brute = Field(slices, (1.8, 0.8), 0.65, 0.5, 0.1, finer=4).run()
    assert abs(rogue.path.steps - brute.max()) <= 2


LOST = {"task.duration": 5.0, "targets.speed_limit": 1.0, "formation.ring": None, "robot.drive_factors": ()}
ONCE = {"targets.count": 1, "targets.arrival_rate": 0.0}
CASES = [
    ("evaders", "random", {"targets.entry": "boundary", "targets.speed_limit": 0.6}),
    ("evaders-failure", "open-loop-mpcc", {}),
    ("redundant", "open-loop", {"targets.speed_limit": 0.5, "targets.respawn": True}),
    # On a coarse grid the stage reports more than any path has, and without arrivals no rogue appears later.
    ("evaders-uneven", "open-loop-mpcc", ONCE | {"task.contamination": (13, 6)}),
    # Robots sense in the step at whose end the edge or a collision ends their work.
    ("evaders", "random", LOST | {"task.boundary": "remove", "sensing.radius": 0.8, "robot.count": 9}),
    ("evaders", "random", LOST | {"task.on_collision": "stop", "sensing.radius": 1.0, "robot.radius": 0.15}),
]


@pytest.mark.parametrize(("scenario", "policy", "overrides"), CASES)
def test_a_rogue_is_an_ordinary_target_that_is_detected_at_the_end_of_its_path(scenario, policy, overrides):
    # Oracle: speed, walls and distances in float64 from the recorded robots, and the simulation's own detection.
    short = lissajous_env.scenario(scenario, **{**SHORT, **overrides})
    for seed in (4, 5):
        rogue = missed_rogue(baselines.make(policy, short, 2), short, seed)
        assert fault_of(rogue) is None
        detection = first_detection(rogue.played, rogue.path)
        assert rogue.detected == (detection is not None)
        if detection is not None:
            assert rogue.undetected == pytest.approx(detection * short.task.step, abs=2e-3)
        assert rogue.undetected >= rogue.path.steps * short.task.step - 1e-6
        assert rogue.undetected <= rogue.upper_bound + 1e-6


@pytest.mark.parametrize(
    ("scenario", "policy", "seed", "within", "overrides"),
    [
        ("evaders", "kuramoto-mpcc", 0, 0.4, {"task.duration": 10.0}),
        ("evaders-fast", "random", 5, 0.2, {}),  # moves 2.2 cells in a step, past gaps that open for a moment
        # The first passes a gap of millimetres past fast robots; a tick of the second lasts six steps.
        pytest.param("evaders", "random", 2, 0.4, {"task.duration": 16.0}, marks=pytest.mark.long),
        pytest.param("team", "sweep", 31, 0.8, {}, marks=pytest.mark.long),
    ],
)
def test_the_rogue_of_the_reported_worst_case_is_found(scenario, policy, seed, within, overrides):
    # Oracle: the contamination stage, which computes the worst case on another grid, and the simulation.
    rogue = missed(scenario, policy, seed, **overrides)
    assert rogue.undetected >= rogue.on_grid - within


# The page and the command.


def test_the_page_shows_the_rogue():
    rogue = missed("evaders", "kuramoto-mpcc", **SHORT)
    recording = record(baselines.make("kuramoto-mpcc", rogue.played.scenario), rogue.played.scenario)
    times = [score["detection_time_mean"] for score in (recording.score, rogue.played.score)]
    assert times[0] == pytest.approx(times[1], nan_ok=True)

    def shown(html):
        data = json.loads(html.partition('id="data"')[2].partition(">")[2].partition("</script>")[0])
        return data["episodes"][0]["rogue"]

    drawn = shown(Replay(recording, missed=rogue).html())
    assert (drawn["begin"], drawn["every"]) == (rogue.path.appears_at, 1)
    np.testing.assert_allclose(drawn["places"], rogue.path.places, atol=5e-4)
    assert (drawn["until"] - drawn["begin"]) * 0.1 == pytest.approx(rogue.undetected, abs=1e-3)
    assert shown(Replay(recording).html()) is None


def test_the_command(tmp_path, capfd):
    out = tmp_path / "rogue.html"
    exploit("evaders", "still", episodes=2, out=out, common=PlayOptions(True, overrides=(("task.duration=8",),)))
    printed = json.loads(capfd.readouterr().out)
    assert [row["seed"] for row in printed["episodes"]] == [0, 1]
    assert printed["episodes"][0]["undetected"] == pytest.approx(7.9)
    assert printed["episodes"][0]["upper_bound"] >= 7.9
    assert out.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_without_a_rogue_the_command_prints_its_results_and_fails_to_write_a_page(tmp_path, capsys):
    # Oracle: sensors that reach over the whole rectangle.
    changes = "--set", "sensing.radius=100", "task.duration=1", "task.contamination=(30,20)"
    code, out, error = called(capsys, "exploit", "ideal", "still", *changes, "--json", "--out", tmp_path / "a.html")
    assert (code, json.loads(out)["episodes"], json.loads(out)["wrote"]) == (1, [{"seed": 0}], None)
    assert "a.html was not written, because no rogue is undetected at any moment" in error


def test_bad_input_of_the_command_is_refused_by_name(capsys):
    for arguments, words in (
        (("evaders", "swep"), "policy must be"),
        (("sweep", "still"), "scenario must be given before the policy"),
        (("failure", "kuramoto", "--set", "task.contamination=None"), "task.contamination"),
    ):
        code, _, error = called(capsys, "exploit", *arguments)
        assert code == 2, arguments
        assert words in error
