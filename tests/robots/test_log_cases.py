"""Logs as other tools write them: each scores as the motion that it is of, with a note, or is refused by name.

Oracle: five robots on circles at 0.5 m/s, whose way, speed and smallest distance are known in closed form.
"""

import functools
import json
import math

import numpy as np
import pytest
from log_messages import (
    EPOCH,
    SPEED,
    array,
    circle,
    circles,
    joints,
    moments,
    odometry,
    plain,
    stamped,
    transform,
    transforms,
    write,
)  # fmt: skip

from lissajous_env.logs.poses import TOPICS
from lissajous_env.logs.reading import read
from lissajous_env.logs.scoring import score

LASTS = 4.0
TIMES = moments(LASTS)
RADIUS, CHORD = 0.2, 0.05
"""Radius of the circles, and time between the places of a step whose distances are summed."""


def chord_way(duration):
    """Way along the chords of a circle [m]."""
    return duration / CHORD * 2 * RADIUS * math.sin(SPEED / RADIUS * CHORD / 2)


shrunk = functools.partial(circles, times=TIMES)


def scored(tmp_path, *bags, topics=TOPICS, scenario="evaders", **how):
    paths = [write(tmp_path / f"bag_{k}", bag) for k, bag in enumerate(bags)]
    return score(read(paths, topics, **how), scenario)


def mismatches(result, duration=LASTS, notes=()):
    """Return the scores that are not those of the circles, and the words that no note contains."""
    row, lasts = result.rows[0], result.recording.duration
    holds = {
        f"duration {lasts}": lasts == pytest.approx(duration),
        f"distance_mean {row['distance_mean']}": row["distance_mean"] == pytest.approx(chord_way(duration), rel=1e-3),
        f"speed_max {row['speed_max']}": row["speed_max"] == pytest.approx(SPEED, rel=0.01),
        f"collisions {row['collisions']}": row["collisions"] == 0,
        f"outside_time {row['outside_time']}": row["outside_time"] == 0,
        f"min_separation {row['min_separation']}": row["min_separation"] > 0.8,
        f"idleness_mean {row['idleness_mean']}": row["idleness_mean"] < 0.9,
    }
    holds |= {f"{words} in {result.notes}": any(words in note for note in result.notes) for words in notes}
    return [words for words, hold in holds.items() if not hold]


def of_robots(make, times=TIMES):
    """Messages that `make(robot, time)` makes, recorded at that time."""
    return [(f"/robot_{k}/odom", make(k, t), EPOCH + t) for t in times for k in range(5)]


def extra(topic, make, times=TIMES):
    return [(topic.format(k), make(t), EPOCH + t) for t in times for k in range(5)]


DRIVEN = ("steering", "throttle")


def commanded(names, numbers, pace=1):
    """Messages of poses and of commands, whose names may change and whose stamps may stand still."""
    names_at = names if callable(names) else lambda t: names
    return shrunk() + extra("/robot_{}/command", lambda t: joints(EPOCH + pace * t, names_at(t), numbers))


def shifted(robot, t):
    """A pose of another robot, or of robot 3 with its clock an hour off."""
    return odometry(EPOCH + t + (3600 if robot == 3 else 0), *circle(robot, t))


def drifting(t):
    """Place of a frame of odometry, whose wheels slip."""
    return 1.0 + 0.2 * t, -2.0, 0.5 + 0.1 * t


def in_frame(frame, place):
    """A place in another frame, whose own place is given."""
    x, y = place[0] - frame[0], place[1] - frame[1]
    cos, sin = math.cos(frame[2]), math.sin(frame[2])
    return cos * x + sin * y, cos * y - sin * x, place[2] - frame[2]


FIXED = {
    "stamps are never set": (of_robots(lambda k, t: odometry(0, *circle(k, t))), ("41 poses without a stamp",)),
    "stamps are not set at first, of a robot for most of the log": (
        of_robots(lambda k, t: odometry(0.0 if t < (0.25 if k else 2.55) else EPOCH + t, *circle(k, t))),
        ("robot 0: times of 26 poses without a stamp", "3 poses without a stamp"),
    ),
    "a twist is never filled": (of_robots(lambda k, t: odometry(EPOCH + t, *circle(k, t), 0.0)), ("computed from",)),
    "robots reverse": (shrunk(make=lambda t, x, y, h: odometry(t, x, y, h + math.pi, -SPEED)), ()),
    "speeds without a sign": (shrunk(make=lambda t, x, y, h: odometry(t, x, y, h + math.pi)), ("do not match",)),
    "headings are never set": (shrunk(make=lambda t, x, y, h: stamped(t, x, y, 0)), ("were not logged",)),
    "quaternions are zero": (shrunk(make=lambda t, x, y, h: odometry(t, x, y, h, length=0.0)), ("headings are",)),
    "quaternions are long": (shrunk(make=lambda t, x, y, h: odometry(t, x, y, h, length=2.0)), ("not of length 1",)),
    "poses without speeds": (shrunk(make=stamped), ("were not logged",)),
    "poses that are published five times": (
        of_robots(lambda k, t: stamped(EPOCH + t, *circle(k, int(10 * t + 1e-6) / 10)), moments(LASTS, 0.02)), (),
    ),
    "poses that are NaN or far beyond all floats of 32 bits": (
        of_robots(lambda k, t: odometry(EPOCH + t, (math.nan, 1e300)[k] if k < 2 and 1.9 < t < 2 else circle(k, t)[0],
                                        *circle(k, t)[1:])), ("2 messages", "not finite or above 1e+12"),
    ),
    "a status of another type": (
        shrunk() + extra("/robot_{}/status", lambda t: plain("Bool", True)), ("/robot_0/status", "std_msgs/msg/Bool")
    ),
    "a status without a meaning": (
        shrunk() + extra("/robot_{}/status", lambda t: plain("UInt8", 3)), ("unknown status 3",)
    ),
    "commands with other names": (
        commanded(["left", "right"], [0.1, 0.2]),
        ("because of robot 0: commands must be steering [rad] and throttle, got left, right",),
    ),
    "commands whose names change": (
        commanded(lambda t: "cd" if t > 2 else "ab", [0.1, 0.2]), ("other names or another length than the first",),
    ),
    "commands with one stamp": (commanded(DRIVEN, [0.1, 0.2], 0), ("stamps of /robot_0/command are all the same",)),
    "commands in degrees": (commanded(DRIVEN, [20.0, 0.2]), ("is it in degrees",)),
    "a scenario of another version": (
        [*shrunk(), ("/lissajous/episode", plain("String", '{"scenario": {"later": 1}, "seed": 0}'), EPOCH)], ()
    ),
    "numbers with a gap": ([(topic.replace("4", "9"), *rest) for topic, *rest in shrunk()], ()),
    "frames": (
        [("/tf", transforms(transform(EPOCH + t, *circle(k, t), f"{name}_{k}")), EPOCH + t)
         for t in TIMES for k in range(5) for name in ("car", "goal")],
        (), ["/tf:car_{}"],
    ),
    "a tree of frames": (
        [("/tf", transforms(
            transform(EPOCH + t, *in_frame(drifting(t), circle(k, t)), f"robot_{k}/base_link", f"robot_{k}/odom"),
            transform(EPOCH + t, *drifting(t), f"robot_{k}/odom")), EPOCH + t) for t in TIMES for k in range(5)],
        (),
    ),
    "an array of poses": (
        [("/poses", array(EPOCH + t, [circle(k, t) for k in range(5)]), EPOCH + t) for t in TIMES], ()
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", FIXED)
def test_a_log_scores_as_the_motion_that_it_is_of(case, tmp_path):
    messages, notes, *topics = FIXED[case]
    assert mismatches(scored(tmp_path, messages, topics=(*topics, TOPICS)[0]), notes=notes) == []


def test_a_clock_that_is_set_while_recording_is_refused(tmp_path):
    reset = [
        (f"/robot_{k}/odom", odometry(1 + t + 0.037 * run, *circle(k, t + 3 * run)), EPOCH + t + 6 * run)
        for run in range(2) for t in TIMES for k in range(5)
    ]  # fmt: skip
    with pytest.raises(ValueError, match=r"robot 0 must rise .* a jump of 3\.96 s back, recorded at 1700000006"):
        scored(tmp_path / "reset", reset)
    for jump, words in ((600.0, "ahead"), (-0.4, "back"), (-2.0, "back")):
        set_late = of_robots(lambda k, t, jump=jump: odometry(EPOCH + t + jump * (t > 2.45), *circle(k, t)))
        with pytest.raises(ValueError, match=rf"jump of {abs(jump + 0.1):.3g} s {words}, recorded at 1700000002\.5"):
            scored(tmp_path / str(jump), set_late)
    days = [("/robot_0/odom", odometry(EPOCH + 86_400 * t, *circle(0, t)), EPOCH + 86_400 * t) for t in TIMES]
    assert read(write(tmp_path / "days", days)).notes == ()


def in_json(topic, kind):
    """Bytes of an MCAP file with a channel of ROS 2, and those of the same channel in JSON with a binary schema."""
    size = len(topic).to_bytes(4, "little") + topic.encode()
    yield size + b"\x03\0\0\0cdr", size + b"\x03\0\0\0jsn"
    name = len(kind).to_bytes(4, "little") + kind.encode()
    yield name + b"\x07\0\0\0ros2msg", name + b"\x07\0\0\0jschema"
    yield b"uint8 data", b"\xff\xfent8 data"


@pytest.mark.parametrize("folder", [False, True])
def test_a_channel_of_another_encoding_is_ignored_with_a_note(tmp_path, folder):
    statuses = [("/robot_1/status", plain("UInt8", 1), EPOCH + t) for t in TIMES]
    write(tmp_path / "log", [*shrunk(), *statuses])
    (path,) = (tmp_path / "log").glob("*.mcap")
    data = path.read_bytes()
    for before, after in in_json("/robot_1/status", "std_msgs/msg/UInt8"):
        assert before in data
        data = data.replace(before, after)
    path.write_bytes(data)
    about = tmp_path / "log" / "metadata.yaml"
    about.write_text(about.read_text().replace("serialization_format: cdr", "serialization_format: json", 1))
    result = score(read(tmp_path / "log" if folder else path), "evaders")
    words = "41 messages of /robot_1/status are ignored: type std_msgs/msg/UInt8 in the encoding jsn is not understood"
    assert mismatches(result, notes=(words,)) == []
    assert (result.recording.status == 0).all()


@pytest.mark.parametrize("mode", ["NONE", "MESSAGE", "FILE"])
def test_messages_that_are_cut_off_are_left_out_with_a_note(tmp_path, mode):
    def cut(topic, time, data):
        return data[:60] if topic == "/robot_2/odom" and EPOCH + 1.95 < time < EPOCH + 2.25 else data

    write(tmp_path / "log", [*shrunk(), *extra("/robot_{}/status", lambda t: plain("UInt8", 0))], cut, mode)
    words = "3 messages of /robot_2/odom are ignored: cut off or damaged, of type nav_msgs/msg/Odometry"
    assert mismatches(score(read(tmp_path / "log"), "evaders"), notes=(words,)) == []
    write(tmp_path / "all", shrunk(), lambda topic, _, data: data[:60] if topic == "/robot_2/odom" else data)
    with pytest.raises(ValueError, match="topic /robot_2/odom of all must have at least 2 poses, got 0") as raised:
        read(tmp_path / "all")
    assert "undamaged" not in str(raised.value)


def test_the_begin_of_an_episode_counts_rather_than_the_time_of_its_message(tmp_path):
    def log(begin):
        text = json.dumps({"scenario": {}, "seed": 0, "begin": begin})
        message = ("/lissajous/episode", plain("String", text), EPOCH + 0.7)
        return read(write(tmp_path / f"begin {begin}", [*shrunk(), message]))

    assert log(EPOCH + 0.51).begin == pytest.approx(EPOCH + 0.5)
    assert log(1.0).begin == pytest.approx(EPOCH + 0.7)
    with pytest.raises(ValueError, match=r"and a finite begin \[s\] on /lissajous/episode, got .*soon"):
        log("soon")


def test_commands_have_the_times_of_their_stamps_and_are_of_the_robot_in_the_same_file(tmp_path):
    # Oracle: what was written; the recorder receives the commands 0.3 s late, and a clock that is 50 s off is named.
    bags = []
    for k, late in ((0, 0.0), (1, 50.0)):
        bags.append([("/odom", odometry(EPOCH + t, *circle(k, t)), EPOCH + t) for t in TIMES])
        for t in TIMES:
            message = joints(EPOCH + t + late, ["steering", "throttle"], [0.1 * k, 0.01 * t])
            bags[-1] += [("/command", message, EPOCH + t + 0.3), ("/command", plain("Bool", True), EPOCH + t)]
    log = read([write(tmp_path / f"bag_{k}", bag) for k, bag in enumerate(bags)], "/odom", "/command")
    for k, track in enumerate(log.tracks):
        np.testing.assert_allclose(track.position[:, :2], [circle(k, t)[:2] for t in TIMES])
    np.testing.assert_allclose(log.commands[0].time - EPOCH, TIMES, atol=1e-6)
    np.testing.assert_allclose(log.commands[1].time - EPOCH, TIMES + 0.3, atol=1e-6)
    np.testing.assert_allclose(log.commands[1].value[:, 0], 0.1)
    assert any("the stamps of /command differ by 49.7 s" in note for note in log.notes)
    assert any("82 messages of /command are ignored: type std_msgs/msg/Bool" in note for note in log.notes)


def test_a_robot_whose_clock_differs_is_named(tmp_path):
    for n, ahead, words, now in ((5, (3,), "3 is 1.5 s ahead of", 0), (4, (0, 1), "2 is 1.5 s behind", 1.5)):
        poses = of_robots(lambda k, t, ahead=ahead: odometry(EPOCH + t + 1.5 * (k in ahead), *circle(k, t)))
        phases = extra("/robot_{}/phase", lambda t: plain("Float64", t))
        log = read(write(tmp_path / str(n), [record for record in poses if int(record[0][7]) < n] + phases))
        assert any(f"the clock of robot {words} those of the others" in note for note in log.notes)
        np.testing.assert_allclose(log.phases[0].time - EPOCH, TIMES + now, atol=1e-6)


def test_a_jump_is_named(tmp_path):
    jumping = of_robots(lambda k, t: odometry(EPOCH + t, circle(k, t)[0] + (k == 1 and t > 2), *circle(k, t)[1:]))
    result = scored(tmp_path, jumping)
    assert any("robot 1: 1 jump that" in note and "1700000002.0" in note for note in result.notes)
    assert result.rows[0]["speed_max"] == pytest.approx(SPEED)
    assert (result.recording.status[:, 1].max(), result.recording.status[-1, 1]) == (1, 0)
    glitch = of_robots(lambda k, t: odometry(EPOCH + t, circle(k, t)[0] + 9 * (k == 1 and t == 2), *circle(k, t)[1:]))
    assert scored(tmp_path / "glitch", glitch).rows[0]["distance_mean"] == pytest.approx(chord_way(LASTS), rel=5e-3)


def test_a_log_ends_with_the_first_robot_unless_that_one_has_failed(tmp_path):
    def shortened(left, more=()):
        poses = [record for record in shrunk() if "robot_1" not in record[0] or record[2] < EPOCH + LASTS - left]
        return scored(tmp_path / str(left), poses + list(more))

    assert shortened(0.25).recording.duration == pytest.approx(LASTS - 0.3)
    assert any("robot 1: no pose after" in note for note in shortened(2.0).notes)
    removed = [("/robot_1/status", plain("UInt8", 2), EPOCH + 1.5)]
    gone = shortened(2.5, removed)
    assert not any("no pose after" in note for note in gone.notes)
    assert gone.recording.status[:, 1].tolist() == [0] * 15 + [2] * 26, "as before the first message, robots work"


def test_a_hint_says_that_an_origin_is_missing(tmp_path):
    far = shrunk(make=lambda t, x, y, h: odometry(t, x + 435_000, y + 5.4e6, h))
    assert any("--origin" in note for note in scored(tmp_path / "without", far).notes)
    assert mismatches(scored(tmp_path / "with", far, origin=(435_000.0, 5.4e6, 0.0))) == []


def test_headings_in_a_tree_of_frames_are_those_in_its_root(tmp_path):
    track = read(write(tmp_path / "log", FIXED["a tree of frames"][0])).tracks[1]
    np.testing.assert_allclose(np.cos(track.heading - [circle(1, t)[2] for t in TIMES]), 1, atol=1e-9)


def test_robots_are_in_the_order_of_their_numbers(tmp_path):
    log = read(write(tmp_path / "log", [(topic.replace("_1", "_10"), *rest) for topic, *rest in shrunk()]))
    assert log.labels == ("0", "2", "3", "4", "10")
    np.testing.assert_allclose(log.tracks[4].position[0, :2], circle(1, 0.0)[:2])
    assert len(read(write(tmp_path / "later", of_robots(shifted))).tracks) == 5, "one by one, robots can be identified"


REFUSED = {
    "frames": (
        of_robots(lambda k, t: odometry(EPOCH + t, *circle(k, t), frame="map" if k else "odom")), {},
        "must be in one frame, got robot 0: odom; robots 1, 2, 3 and 4: map",
    ),
    "an hour": (of_robots(shifted), {}, "got those of robot 3 from 1700003600.000"),
    "a missing robot": ([record for record in shrunk() if record[0][7] != "2"], {}, "got 4: robots 0, 1, 3 and 4"),
    "twice": (shrunk(), {"topics": ["/robot_0/odom"] * 2}, "at least one topic, each of them once, got"),
    "braces": (shrunk(), {"topics": ["/robot_{}/{}"]}, "stands once for a number"),
    "unknown": (shrunk(), {"topics": ["/car_{}/odom"]}, "got /car_0/odom"),
    "type": (extra("/phase", lambda t: plain("Float64", t)), {"topics": ["/phase"]}, "must be of type nav_msgs"),
    "no topic": (shrunk(), {"topics": ()}, "at least one topic, each of them once, got ()"),
    "origin": (shrunk(), {"origin": (math.nan, 0.0, 0.0)}, "origin must be three finite numbers"),
    "all NaN": (
        of_robots(lambda k, t: odometry(EPOCH + t, math.nan, 0.0, 0.0)), {},
        "got 0; 41 messages of /robot_0/odom are ignored",
    ),
    "too long": (
        [(f"/robot_{k}/odom", odometry(t, *circle(k, t)), t) for k in range(5) for t in (0.0, 1.0, 50_000.0)],
        {}, "longest time without a pose is 49999 s, of robot 4",
    ),
    "array": (
        [("/poses", array(EPOCH + t, [circle(k, t) for k in range(5 - (t > 2))]), EPOCH + t) for t in TIMES],
        {"topics": ["/poses"]}, "must have as many poses in every message, got 5 in 21 and fewer in 20",
    ),
    "no part": (
        [("/tf", transforms(*(transform(EPOCH + t, *circle(0, t), f"{name}_0") for name in ("car", "goal"))), EPOCH + t)
         for t in TIMES],
        {}, "as in /tf:car_{}, which has /tf of car_0, goal_0, got '/tf'",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_log_is_refused_by_name(case, tmp_path):
    messages, how, words = REFUSED[case]
    with pytest.raises(ValueError, match=r"\w") as caught:
        scored(tmp_path, messages, **how)
    assert words in str(caught.value)
    assert "undamaged" not in str(caught.value)
