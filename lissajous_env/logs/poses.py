"""Poses of the robots that a user names.

The poses of a robot have the name of their topic, or of a topic and a part of it: "/tf:car_2" for the frame car_2,
"/poses:2" for the third pose of an array.
"""

import re
from collections.abc import Iterable, Sequence
from itertools import product
from typing import NamedTuple

from lissajous_env.logs.bags import Bags, Samples
from lissajous_env.logs.samples import ARRAY, TRANSFORMS, poses_of
from lissajous_env.wording import few_of, require

TOPICS = ("/robot_{}/odom",)
"""Topics of poses by default."""
SHARED = {ARRAY, TRANSFORMS}
"""Types of topics with the poses of several robots."""
_BODIES = ("base_link", "base_footprint")
Source = tuple[str, str, int | None]
"""Number of a robot in the names of the log, name of its poses, and number of the only file with them; None for any."""


class LoggedRobot(NamedTuple):
    """A robot of a log."""

    label: str
    """Its number in the names of the log."""
    bag: int | None
    """Number of the only file with its topics; None for any."""
    poses: Samples
    """Its poses, as `lissajous_env.logs.samples.poses_of` returns them."""


def robots_of(bags: Bags, topics: Sequence[str]) -> list[LoggedRobot]:
    """Return the robots in the order of their numbers or of the given names.

    Args:
        bags: The files.
        topics: Names of topics, each of which may be followed by a colon and a part; or one such name with {}.

    Raises:
        ValueError: a topic is missing, of another type, or named twice, or has too few poses.
    """
    require(0 < len(topics) == len(set(topics)), "topics", "must name at least one topic, each of them once", topics)
    is_pattern = "{" in "".join(topics)
    is_clear = len(topics) == topics[0].count("{}") == topics[0].count("{") == 1
    rule = "must be names, or one name in which {} stands once for a number"
    require(is_clear or not is_pattern, "topics", rule, topics)
    sources = _numbered(bags, topics[0]) if is_pattern else _named(bags, topics)
    return [LoggedRobot(label, bag, _poses(bags, name, bag)) for label, name, bag in sources]


def _numbered(bags: Bags, pattern: str) -> list[Source]:
    """Return the robots whose numbers stand for {} in a name; if the default has none, of the only shared topic."""
    topic, _, part = pattern.partition(":")
    names = [f"{topic}:{part}" for part in poses_of(bags, topic)] if part else list(bags.kinds)
    number = re.compile(re.escape(pattern).replace(r"\{\}", r"(\d{1,9})"))
    matches = [(match[1], name, None) for name in names if (match := number.fullmatch(name))]
    shared = [topic for topic, kinds in bags.kinds.items() if kinds & SHARED and not topic.endswith("_static")]
    if not matches and pattern == TOPICS[0] and len(shared) == 1:
        return _named(bags, shared)
    return sorted(matches, key=lambda match: int(match[0])) or [("0", pattern.replace("{}", "0"), None)]


def _named(bags: Bags, topics: Sequence[str]) -> list[Source]:
    """Return the robots with some names; of a single name without a part, those of its parts or of its files."""
    topic, _, part = topics[0].partition(":")
    files: list[int | None] = [None]
    if len(topics) == 1 and not part:
        if SHARED & bags.kinds.get(topic, set()) and (pattern := _pattern(poses_of(bags, topic))):
            return _numbered(bags, f"{topic}:{pattern}")
        files = [*bags.files_with(topic)] if len(bags.files_with(topic)) > 1 else files
    sources = list(product(topics, files))
    numbers = [number[0] for name, _ in sources if (number := re.search(r"\d+", name.rpartition(":")[2]))]
    if len(set(numbers)) < len(sources):
        numbers = list(map(str, range(len(sources))))
    return [(number, *source) for number, source in zip(numbers, sources, strict=True)]


def _poses(bags: Bags, name: str, bag: int | None) -> Samples:
    """Return the poses of a robot, by the name of its topic, or of a topic and a part of it, and its file."""
    topic, _, part = name.partition(":")
    parts = poses_of(bags, topic)
    rule = f"must name poses of {bags.name}, as in {topic}:car_{{}}, which has {topic} of {few_of(parts)}"
    require(not parts or part in parts, "topics", rule, name)
    poses = parts.get(part)
    if poses is not None and bag is not None:
        poses = poses.take(poses.bag == bag)
    if poses is None or len(poses) < 2:
        got = "; ".join([str(0 if poses is None else len(poses)), *bags.notes()])
        raise ValueError(f"topic {name} of {bags.name} must have at least 2 poses, got {got}")
    return poses


def _pattern(parts: Iterable[str]) -> str:
    """Return the one pattern with {} of the places or frames of a topic that are robots; "" if it is unclear."""
    patterns = {re.sub(r"\d+", "{}", part, count=1) for part in parts if re.search(r"\d", part)}
    likely = {pattern for pattern in patterns if pattern.endswith(_BODIES)} or patterns
    return likely.pop() if len(likely) == 1 else ""
