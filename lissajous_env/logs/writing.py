"""Write a log as a rosbag2 file (MCAP), which tools of ROS 2 open.

docs/robots.md lists the topics, whose frame has its origin in the middle of the rectangle.
"""

import heapq
import json
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from lissajous_env.episodes.recording import Recording
from lissajous_env.logs.commands import COMMAND_NAMES, commands_of_actions
from lissajous_env.logs.log import Log, Series, Track
from lissajous_env.logs.messages import blank, rosbags, set_odometry, set_stamp, type_store
from lissajous_env.logs.poses import TOPICS
from lissajous_env.logs.reading import COMMAND, EPISODE, PHASE, STATUS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.files import replacing

START = 1.0
"""Time of the first pose [s]; ROS interprets 0 as no time."""
FRAME = "map"
_ODOMETRY, _JOINTS = "nav_msgs/msg/Odometry", "sensor_msgs/msg/JointState"


def save_mcap(log: Log | Recording, path: str | Path) -> None:
    """Write a log, first under a temporary name; one without an episode begins when all of its robots have a pose.

    Raises:
        MissingExtraError: rosbags, of the extra `logs`, is not installed.
        OSError: the file cannot be written.
    """
    rosbag2 = rosbags()
    with tempfile.TemporaryDirectory(prefix="lissajous-", ignore_cleanup_errors=True) as folder:
        writer = rosbag2.Writer(Path(folder, "log"), version=9, storage_plugin=rosbag2.StoragePlugin.MCAP)
        writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
        connections, store = {}, type_store()
        with writer:
            for topic, time, message in _messages(log_of(log) if isinstance(log, Recording) else log):
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(connections[topic], round(time * 1e9), store.serialize_cdr(message, kind))
        (written,) = Path(folder, "log").glob("*.mcap")
        with replacing(path) as temporary:
            shutil.copyfile(written, temporary)


def log_of(recording: Recording) -> Log:
    """Return the log of a recorded episode, without commands where actions are velocities or the recording has none."""
    robots, names = range(recording.scenario.num_robots), recording.scenario.action_names
    time, score = START + recording.scenario.task.step * np.arange(len(recording)), recording.score
    has_commands = recording.scenario.task.action == "control" and np.isfinite(score["return_mean"])
    commands, robot = recording.action[1:].copy(), recording.scenario.resolve().robot
    if robot.kind in COMMAND_NAMES:  # else they are the actions
        commands[..., :2] = commands_of_actions(robot, commands[..., :2])
    return Log(
        "",
        tuple(Track(time, recording.position[:, k], recording.heading[:, k], recording.speed[:, k]) for k in robots),
        {k: Series(time[:-1], commands[:, k], names) for k in robots if has_commands},
        {k: Series(time, recording.phase[:, k]) for k in robots},
        {k: Series(time, recording.status[:, k]) for k in robots},
        episode_of(recording.scenario, int(score["seed"])) | {"policy": str(score.get("policy", ""))},
        START,
    )


def episode_of(scenario: Scenario, seed: int) -> dict[str, Any]:
    """Return what a log contains about its episode, beside the policy and the stamp of the first pose, `begin` [s]."""
    parts = scenario.resolve().to_dict()
    del parts["extensions"]  # a file must not cause imports
    return {"scenario": parts, "seed": seed}


def _messages(log: Log) -> Iterator[tuple[str, float, Any]]:
    """Return the topic, the time [s] and the message of everything in a log by time, the first pose at `START`."""
    later = START - min(float(track.time[0]) for track in log.tracks)
    about = [] if log.episode is None else [json.dumps(log.episode | {"begin": log.start + later})]
    topics = [(EPISODE, "std_msgs/msg/String", Series(np.array([log.start]), np.array([text]))) for text in about]
    for k, track in enumerate(log.tracks):
        rows = np.column_stack([track.position, track.heading, track.speed])
        topics.append((TOPICS[0].format(k), _ODOMETRY, Series(track.time, rows)))
    for k, series in log.commands.items():
        topics.append((COMMAND.format(k), _JOINTS if series.names else "std_msgs/msg/Float64MultiArray", series))
    topics += [(PHASE.format(k), "std_msgs/msg/Float64", series) for k, series in log.phases.items()]
    topics += [(STATUS.format(k), "std_msgs/msg/UInt8", series) for k, series in log.statuses.items()]
    return heapq.merge(*(_of_topic(*topic, later) for topic in topics), key=lambda message: message[1])


def _of_topic(topic: str, kind: str, series: Series, later: float) -> Iterator[tuple[str, float, Any]]:
    """Yield the messages of a topic, some time [s] later than in the log."""
    for time, value in zip((series.time + later).tolist(), series.value, strict=True):
        message = blank(kind)
        if kind == _ODOMETRY:
            x, y, z, heading, speed = value.tolist()
            set_odometry(message, time, (FRAME, topic.split("/")[1]), (x, y, z, heading), speed)
        elif kind == _JOINTS:
            set_stamp(message.header, time, FRAME)
            message.name, message.position = list(series.names), value.astype(float)
        else:
            message.data = value
        yield topic, time, message
