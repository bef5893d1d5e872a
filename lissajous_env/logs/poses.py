"""Poses of the robots that a user names.

The poses of a robot have the name of their topic, or of a topic and a part of it: "/tf:car_2" for the frame car_2,
"/poses:2" for the third pose of an array.
"""

import functools
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from lissajous_env.logs.bags import Bags, Samples
from lissajous_env.logs.samples import ARRAY, POSES, TRANSFORMS, poses_of
from lissajous_env.wording import few_of, nearest

TOPICS = ("/robot_{}/odom",)
"""Topics of poses by default."""
FEWEST = 2
"""Least number of poses of a robot."""
SHARED = {ARRAY, TRANSFORMS}
"""Types of topics with the poses of several robots."""
_BODIES = ("base_link", "base_footprint")


class LoggedRobot(NamedTuple):
    """A robot of a log."""

    label: str
    """Its number in the names of the log."""
    bag: int | None
    """Number of the only file with its topics; None for any."""
    poses: Samples
    """Its poses, as `lissajous_env.logs.samples.poses_of` returns them."""


def robots_of(bags: Bags, log: str, topics: Sequence[str]) -> list[LoggedRobot]:
    """Return the robots in the order of their numbers or of the given names.

    Args:
        bags: The files.
        log: Their name.
        topics: Names of topics, each of which may be followed by a colon and a part; or one such name with {}.

    Raises:
        ValueError: a topic is missing, of another type, or named twice, or has too few poses.
    """
    twice = [topic for k, topic in enumerate(topics) if topic in topics[:k]]
    if twice:
        raise ValueError(f"topics must name each topic once, got {twice[0]} twice")
    if "{" in "".join(topics) and (len(topics) > 1 or topics[0].count("{}") != 1 or topics[0].count("{") != 1):
        raise ValueError(f"topics must be names, or one name in which {{}} stands once for a number, got {topics}")
    poses_of_topic = functools.cache(lambda topic: _poses_of(bags, log, topic))

    def robot(label: str, name: str, bag: int | None = None) -> LoggedRobot:
        topic, _, part = name.partition(":")
        parts = poses_of_topic(topic)
        if parts and part not in parts:
            rule = f"topics must name poses of {log}, as in {topic}:car_{{}}, which has {topic} of {few_of(parts)}"
            raise ValueError(f"{rule}, got {name}")
        poses = parts.get(part)
        if poses is not None and bag is not None:
            poses = poses.take(poses.bag == bag)
        if poses is None or len(poses) < FEWEST:
            got = "; ".join([str(0 if poses is None else len(poses)), *bags.notes()])
            raise ValueError(f"topic {name} of {log} must have at least {FEWEST} poses, got {got}")
        return LoggedRobot(label, bag, poses)

    topic, _, part = topics[0].partition(":")
    if "{}" in topics[0]:
        names = [f"{topic}:{part}" for part in poses_of_topic(topic)] if part else list(bags.kinds)
        number = re.compile(re.escape(topics[0]).replace(r"\{\}", r"(\d+)"))
        matches = [(match[1], name) for name in names if (match := number.fullmatch(name))]
        shared = [topic for topic, kinds in bags.kinds.items() if kinds & SHARED and not topic.endswith("_static")]
        if not matches and tuple(topics) == TOPICS and len(shared) == 1:
            return robots_of(bags, log, shared)
        numbered = sorted(matches, key=lambda match: int(match[0])) or [("0", topics[0].replace("{}", "0"))]
        return [robot(*match) for match in numbered]
    sources: list[tuple[str, int | None]] = [(name, None) for name in topics]
    if len(topics) == 1 and not part:
        if SHARED & bags.kinds.get(topic, set()) and (pattern := _pattern(poses_of_topic(topic))):
            return robots_of(bags, log, [f"{topic}:{pattern}"])
        if len(files := bags.files_with(topic)) > 1:
            sources = [(topic, bag) for bag in files]
    first = [re.search(r"\d+", name.rpartition(":")[2]) for name, _ in sources]
    numbers = [match[0] for match in first if match]
    if len(set(numbers)) < len(sources):
        numbers = list(map(str, range(len(sources))))
    return [robot(number, *source) for number, source in zip(numbers, sources, strict=True)]


def _pattern(parts: Iterable[str]) -> str:
    """Return the one pattern with {} of the places or frames of a topic that are robots; "" if it is unclear."""
    patterns = {re.sub(r"\d+", "{}", part, count=1) for part in parts if re.search(r"\d", part)}
    likely = {pattern for pattern in patterns if pattern.endswith(_BODIES)} or patterns
    return likely.pop() if len(likely) == 1 else ""


def _poses_of(bags: Bags, log: str, topic: str) -> dict[str, Samples]:
    """Return the poses of a topic by their parts; a topic of one robot has the part ""."""
    kinds = bags.kinds.get(topic)
    if kinds is None:
        topics = sorted(topic for topic, kinds in bags.kinds.items() if kinds & POSES.keys())
        rule = f"topics must be topics of poses in {log}, which has {few_of(topics) or 'none'}"
        raise ValueError(f"{rule}, got {topic}{nearest(topic, topics)}")
    if not kinds & POSES.keys():
        raise ValueError(f"topic {topic} of {log} must be of type {', '.join(POSES)}, got {few_of(sorted(kinds))}")
    return poses_of(bags, topic)
