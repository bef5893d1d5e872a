"""Laws of the score of a log, on generated logs: what changes nothing, and what may never be made up.

A law is a function that writes a generated log twice and compares the two score rows, so no number is expected.
"""

import dataclasses
import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from log_messages import EPOCH, odometry, plain, stamped, write

import lissajous_env
from lissajous_env.logs.poses import TOPICS
from lissajous_env.logs.reading import read
from lissajous_env.logs.scoring import score
from lissajous_env.logs.writing import save_mcap

PAIR = {"robot.count": 2, "formation.p": 1, "formation.ring": (0, 1), "faults.schedule": (), "task.grid": (18, 8)}
SCENARIO = lissajous_env.scenario("experiment", **PAIR)
STEP = SCENARIO.task.step
CONTINUOUS = {
    "distance_mean": 1e-3, "speed_max": 1e-3, "min_separation": 1e-3, "lateral_error_mean": 1e-3,
    "spacing_factor": 1e-3, "contact_time": 1e-9, "outside_time": 1e-9, "phase_error": 2e-3,
    "detection_time_mean": 0.03, "idleness_mean": 0.03, "idleness_max": 0.11, "sensed_fraction": 0.02,
}  # fmt: skip
"""Columns with the differences that rounding may make; where a cell or a target is just reached, a step's."""


@dataclasses.dataclass
class Sample:
    """A pose of a robot."""

    robot: int
    time: float
    x: float
    y: float
    heading: float
    speed: float


@dataclasses.dataclass
class Story:
    """A generated log: the motion of two robots, and how it was recorded."""

    failed_at: float
    with_speed: bool
    header_begin: float
    logged_begin: float
    random: np.random.Generator
    samples: list[Sample] = dataclasses.field(repr=False)

    def messages(self, moved=lambda sample: sample, stamp=lambda t: t, logged=lambda t: t, z=0.0, names=(0, 1)):
        """Messages of poses, and of the status of robot 1, which has no stamp."""
        for sample in map(moved, self.samples):
            time, place = self.header_begin + stamp(sample.time), (sample.x, sample.y, sample.heading)
            message = odometry(time, *place, sample.speed, z=z) if self.with_speed else stamped(time, *place, z=z)
            yield f"/robot_{names[sample.robot]}/odom", message, self.logged_begin + logged(sample.time)
        for time, status in ((0.0, 0), (self.failed_at, 1), (self.failed_at + 1.0, 0)):
            yield f"/robot_{names[1]}/status", plain("UInt8", status), self.logged_begin + logged(time)


@st.composite
def stories(draw):
    """Robots that drive along smooth random paths, in two halves of the rectangle or in the same."""
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    period = draw(st.sampled_from([0.1, 0.05, 0.033]))
    begin = [draw(st.sampled_from([0.0, 1.0, 123.456, EPOCH])) for _ in range(2)]
    apart, forwards = draw(st.sampled_from([0.9, 0.1])), draw(st.sampled_from([1, -1]))
    samples = []
    for robot in range(2):
        rates, phases = random.uniform(0.3, 1.5, 2), random.uniform(0, 2 * np.pi, 4)
        times = np.arange(0, draw(st.floats(2.6, 3.5)), period) + random.uniform(0, 0.3 * period)
        times = times + random.uniform(-0.2, 0.2, len(times)) * period
        x = (2 * robot - 1) * apart + 0.3 * np.sin(rates[0] * times + phases[0])
        y = 0.3 * np.sin(rates[1] * times + phases[1])
        vx = 0.3 * rates[0] * np.cos(rates[0] * times + phases[0])
        vy = 0.3 * rates[1] * np.cos(rates[1] * times + phases[1])
        heading, speed = np.arctan2(forwards * vy, forwards * vx), forwards * np.hypot(vx, vy)
        samples += map(Sample, [robot] * len(times), *(v.tolist() for v in (times + 0.1, x, y, heading, speed)))
    samples.sort(key=lambda sample: sample.time)
    failed_at = draw(st.integers(5, 15)) * STEP + 0.5 * STEP
    return Story(failed_at, draw(st.booleans()), *begin, random, samples)


def scored(folder, *bags, topics=TOPICS, origin=(0.0, 0.0, 0.0)):
    paths = [write(folder / f"{len(list(folder.iterdir()))}", bag) for bag in bags]
    return score(read(paths, topics, origin=origin), SCENARIO, seeds=[3])


def differences(one, other):
    """Columns of two rows that differ."""
    names = [name for name in ("targets", "collisions") if one[name] != other[name]]
    for name, tolerance in CONTINUOUS.items():
        a, b = one[name], other[name]
        if math.isnan(a) != math.isnan(b) or abs(a - b) > tolerance * (1 + abs(a)):
            names.append((name, a, b))
    return names


def compare(folder, story, *bags, **how):
    assert differences(scored(folder, list(story.messages())).rows[0], scored(folder, *bags, **how).rows[0]) == []


def other_clocks(folder, story):
    moved, pace = story.random.choice([0.5, 100.0, 3600.0, 4e8]), story.random.choice([0.1, 0.5, 2.0, 10.0])
    compare(folder, story, list(story.messages(stamp=lambda t: t + moved)))
    compare(folder, story, list(story.messages(logged=lambda t: t / pace + moved)))


def poses_that_are_recorded_late_or_in_bursts(folder, story):
    random = story.random
    burst = random.choice([0.0, 0.3, 1.5])
    for sample in story.samples[len(story.samples) // 3 :]:  # robots stop, and noise makes ways in any order longer
        sample.x, sample.y = random.normal([1.8 * sample.robot - 0.9, 0.0], 0.005).tolist()
    # The status is recorded on a clock that the poses give only roughly, so it is left out on both sides.
    poses = [record for record in story.messages() if "odom" in record[0]]
    late = [
        (topic, message, time + random.uniform(0, 0.2) if not burst else math.ceil(time / burst) * burst)
        for topic, message, time in poses
    ]
    assert differences(scored(folder, poses).rows[0], scored(folder, late).rows[0]) == []


def stamps_that_are_doubled_or_moved_by_microseconds(folder, story):
    random, doubled = story.random, []
    for topic, message, time in story.messages(stamp=lambda t: t + random.uniform(-3e-6, 3e-6)):
        doubled += [(topic, message, time)] * random.integers(1, 3)
    compare(folder, story, doubled)


def nothing_is_made_up_in_a_gap(folder, story):
    begin = story.random.uniform(0.4, 1.2)
    end = begin + story.random.uniform(0.8, 1.2)
    whole = scored(folder, list(story.messages()))
    story.samples = [s for s in story.samples if s.robot == 0 or not begin < s.time < end]
    got = scored(folder, list(story.messages()))
    less_is_known(whole, got)
    assert any("robot 1: gaps" in note for note in got.notes)


def an_end_of_messages_is_a_failure(folder, story):
    whole = scored(folder, list(story.messages()))
    # A log ends with the robot that ends first, so that the other one may have later poses, which do not count.
    end = whole.log.start - story.header_begin + whole.recording.duration
    story.samples = [s for s in story.samples if (s.time < end + 1e-6 if s.robot == 0 else s.time < 1.5)]
    got = scored(folder, list(story.messages()))
    assert any("robot 1: no pose after" in note for note in got.notes)
    first, last = (max(s.time for s in story.samples if s.robot == robot) for robot in (1, 0))
    assert first < 1.5
    assert got.recording.duration > last - story.samples[0].time - 2 * STEP - 0.1
    assert (got.recording.status[-5:, 1] == 1).all()
    less_is_known(whole, got)


def less_is_known(whole, got):
    """Nothing is in the second score that is not in the first."""
    a, b = whole.rows[0], got.rows[0]
    assert b["collisions"] <= a["collisions"]
    assert b["contact_time"] <= a["contact_time"] + 1e-9
    assert b["distance_mean"] <= max(a["distance_mean"] * 1.001 + 1e-6, a["distance_mean"] * 1.002)
    assert b["speed_max"] <= a["speed_max"] * 1.01 + 1e-3
    if not math.isnan(b["min_separation"]):
        assert b["min_separation"] >= a["min_separation"] - 1e-3


def channels_and_files(folder, story):
    parts = [(*record, int(story.random.integers(0, 3))) for record in story.messages()]
    compare(folder, story, parts)
    compare(folder, story, *([record for record in parts if record[3] == k] for k in range(3)))
    compare(folder, story, *([record for record in parts if f"robot_{k}" in record[0]] for k in (1, 0)))


def numbers_in_any_order(folder, story):
    low, high = sorted(story.random.choice(50, 2, replace=False).tolist())
    compare(folder, story, list(story.messages(names=(low, high))))
    compare(folder, story, list(story.messages(names=(high, low))), topics=[f"/robot_{k}/odom" for k in (high, low)])


def a_rigid_motion_with_its_origin_and_heights(folder, story):
    x, y = story.random.choice([0.0, 10.0, 435_000.0]), story.random.choice([0.0, -3.0, 5.4e6])
    turn = story.random.uniform(-np.pi, np.pi)
    cos, sin = math.cos(turn), math.sin(turn)

    def moved(sample):
        place = {"x": x + cos * sample.x - sin * sample.y, "y": y + sin * sample.x + cos * sample.y}
        return dataclasses.replace(sample, **place, heading=sample.heading + turn)

    messages = list(story.messages(moved=moved, z=float(story.random.uniform(-5, 5))))
    compare(folder, story, messages, origin=(float(x), float(y), float(turn)))


def written_and_scored_again(folder, story):
    if story.random.random() < 0.5:
        story.samples = [s for s in story.samples if s.robot == 0 or not 0.8 < s.time < 1.6]
    first = scored(folder, list(story.messages()))
    again = folder / "again.mcap"
    save_mcap(first.log, again)
    log = read(again)
    second = score(log)
    assert differences(first.rows[0], second.rows[0]) == []
    assert not log.commands
    assert story.with_speed or all(np.isnan(track.speed).all() for track in log.tracks)
    np.testing.assert_array_equal(first.recording.status, second.recording.status)


LAWS = (
    other_clocks,
    poses_that_are_recorded_late_or_in_bursts,
    stamps_that_are_doubled_or_moved_by_microseconds,
    nothing_is_made_up_in_a_gap,
    an_end_of_messages_is_a_failure,
    channels_and_files,
    numbers_in_any_order,
    a_rigid_motion_with_its_origin_and_heights,
    written_and_scored_again,
)
GENERATED = {"suppress_health_check": list(HealthCheck), "database": None, "derandomize": True,
             "phases": (Phase.generate, Phase.shrink)}  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
@settings(max_examples=3, **GENERATED)
@given(story=stories())
def test_the_score_of_a_log_obeys(law, story):
    with tempfile.TemporaryDirectory() as folder:
        law(Path(folder), story)
        assert list(Path(folder).rglob("*.mcap")), "a law that scores no log would hold always"
