"""Find the robots of a log, their numbers and topics, by the names that a user gives."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from lissajous_env.logs.messages import Bags
from lissajous_env.logs.poses import KINDS, Poses
from lissajous_env.wording import few_of, nearest

ODOMETRY = ("/robot_{}/odom",)


class Robot(NamedTuple):
    """A robot of a log."""

    label: str
    """Its number in the names of the log."""
    topic: str
    """Topic of its poses."""
    part: str | None = None
    """Its frame or place in a topic with the poses of several robots."""
    bag: int | None = None
    """Number of the file with its poses; None for any."""


def robots_of(bags: Bags, poses: Poses, topics: Sequence[str], name: str) -> tuple[list[Robot], list[str]]:
    """Return the robots of a log in the order of their numbers or of the given names, and notes.

    Args:
        bags: The files.
        poses: The poses in them.
        topics: Names of topics, each of which may be followed by a colon and a part; or one such name with {}.
        name: Name of the log.

    Raises:
        ValueError: a topic is missing, of another type, or named twice.
    """
    twice = [topic for k, topic in enumerate(topics) if topic in topics[:k]]
    if twice:
        raise ValueError(f"topics must name each topic once, got {twice[0]} twice")
    patterns = [topic for topic in topics if "{}" in topic]
    if patterns and (len(topics) > 1 or topics[0].count("{}") > 1 or "{" in topics[0].replace("{}", "")):
        raise ValueError(f"topics must be names, or one name in which {{}} stands once for a number, got {topics}")
    if not patterns:
        return _named(bags, poses, topics, name), []
    (pattern,) = topics
    robots = _numbered(bags, poses, pattern, name)
    shared = poses.topics
    if not robots and tuple(topics) == ODOMETRY and len(shared) == 1 and poses.is_shared(shared[0]):
        robots = _named(bags, poses, shared, name)
        return robots, [f"the poses are those of {shared[0]}, because there is no topic {pattern}"]
    if not robots:
        _require(bags, poses, pattern.partition(":")[0].replace("{}", "0"), name)
    return robots, _missing(robots)


def _numbered(bags: Bags, poses: Poses, pattern: str, name: str) -> list[Robot]:
    """Return the robots whose names match a pattern, in the order of their numbers."""
    topic, _, part = pattern.partition(":")
    if part:
        _require(bags, poses, topic, name)
        names = poses.parts(topic) if part == "{}" else poses.frames(topic)
    else:
        names = list(bags.kinds)
    begin, end = (part or topic).split("{}")
    number = re.compile(re.escape(begin) + r"(\d+)" + re.escape(end))
    matches = sorted((int(match[1]), match[1], name) for name in names if (match := number.fullmatch(name)))
    for *_, numbered in matches:
        _require(bags, poses, topic if part else numbered, name)
    return [Robot(label, topic if part else named, named if part else None) for _, label, named in matches]


def _named(bags: Bags, poses: Poses, topics: Sequence[str], name: str) -> list[Robot]:
    """Return the robots of some topics in their order."""
    robots: list[Robot] = []
    for given in topics:
        topic, _, part = given.partition(":")
        _require(bags, poses, topic, name)
        holders = bags.holders(topic)
        if part:
            robots.append(Robot("", topic, part))
        elif poses.is_shared(topic):
            robots += [Robot("", topic, part) for part in poses.parts(topic)]
        elif len(topics) == 1 and len(holders) > 1:
            robots += [Robot("", topic, None, bag) for bag in holders]
        else:
            robots.append(Robot("", topic))
    usual = re.compile(re.escape(ODOMETRY[0].partition("{}")[0]) + r"(\d+)/.*")
    numbers = [match[1] for robot in robots if robot.part is None and (match := usual.fullmatch(robot.topic))]
    if len(set(numbers)) < len(robots):
        numbers = [re.sub(r"\D*(\d+).*", r"\1", robot.part or "") for robot in robots]
    if len(set(numbers)) < len(robots) or not all(number.isdigit() for number in numbers):
        numbers = [str(k) for k in range(len(robots))]
    labelled = [robot._replace(label=number) for robot, number in zip(robots, numbers, strict=True)]
    by_number = len(topics) == 1 and all(robot.part is not None for robot in labelled)
    return sorted(labelled, key=lambda robot: int(robot.label)) if by_number else labelled


def _require(bags: Bags, poses: Poses, topic: str, name: str) -> None:
    if topic not in bags.kinds:
        rule = f"topics must be topics of poses in {name}, which has {few_of(poses.topics) or 'none'}"
        raise ValueError(f"{rule}, got {topic}{nearest(topic, poses.topics)}")
    if not bags.kinds[topic] & set(KINDS):
        got = few_of(sorted(bags.kinds[topic]))
        raise ValueError(f"topic {topic} of {name} must be of type {', '.join(KINDS)}, got {got}")


def _missing(robots: Sequence[Robot]) -> list[str]:
    numbers = [int(robot.label) for robot in robots]
    missing = sorted(set(range(min(numbers), max(numbers))) - set(numbers))
    if not missing:
        return []
    return [f"the robots' numbers are {few_of(numbers)}; there is no robot {few_of(missing)} in the log"]
