"""Write a recording as a rosbag2 file (MCAP), which tools of ROS 2 open.

Topics, in the frame `map`, whose origin is the middle of the rectangle:

| topic | type | content |
|---|---|---|
| `/robot_K/odom` | nav_msgs/Odometry | pose and speed |
| `/robot_K/command` | sensor_msgs/JointState | command from this time on, of a car steering [rad] and throttle |
| `/robot_K/phase` | std_msgs/Float64 | phase theta of (1) [rad] |
| `/robot_K/status` | std_msgs/UInt8 | 0 working, 1 failed, 2 removed |
| `/lissajous/episode` | std_msgs/String | JSON: scenario, seed, policy, begin [s] |

The episode begins at `START` on the clock of the log. If it is itself a log that was scored, unknown poses and commands
are left out, and speeds that were computed from the poses have -1 as their first covariance.
"""

import json
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from lissajous_env.episodes.recording import Recording
from lissajous_env.logs.inputs import INPUTS, inputs_of
from lissajous_env.logs.messages import blank, rosbags, set_odometry, set_stamp, type_store
from lissajous_env.logs.poses import TOPICS
from lissajous_env.logs.reading import COMMAND, EPISODE, PHASE, STATUS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.files import replacing

START = 1.0
"""Time of the reset [s]; ROS interprets 0 as no time."""
FRAME = "map"


def save_mcap(recording: Recording, path: str | Path) -> None:
    """Write a recording as a log, first under a temporary name.

    Raises:
        MissingExtraError: rosbags, of the extra `logs`, is not installed.
        OSError: the file cannot be written.
    """
    rosbag2 = rosbags()
    folder = Path(tempfile.mkdtemp(prefix="lissajous-"))
    try:
        writer = rosbag2.Writer(folder / "log", version=9, storage_plugin=rosbag2.StoragePlugin.MCAP)
        writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
        connections, store = {}, type_store()
        with writer:
            for topic, time, message in _messages(recording):
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(connections[topic], round(time * 1e9), store.serialize_cdr(message, kind))
        (written,) = (folder / "log").glob("*.mcap")
        with replacing(path) as temporary:
            shutil.copyfile(written, temporary)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def episode_text(scenario: Scenario, seed: int, policy: str, begin: float) -> str:
    """Return the content of the topic `/lissajous/episode`; begin is the stamp of the first pose [s]."""
    parts = scenario.resolve().to_dict()
    del parts["extensions"]  # a file must not cause imports
    return json.dumps({"scenario": parts, "seed": seed, "policy": policy, "begin": begin})


def _messages(recording: Recording) -> Iterator[tuple[str, float, Any]]:
    """Yield the topic, the time [s] and the message of everything that is known of a recording."""
    seed, policy = int(recording.score["seed"]), str(recording.score.get("policy", ""))
    yield EPISODE, START, _plain("String", episode_text(recording.scenario, seed, policy, START))
    commands, unknown = (
        _commands(recording),
        {name: recording.is_unknown(name) for name in ("pose", "speed", "command")},
    )
    for moment, robot in np.ndindex(recording.status.shape):
        time = START + moment * recording.scenario.task.step
        if not unknown["pose"][moment, robot]:
            odometry, (x, y, z) = blank("nav_msgs/msg/Odometry"), recording.position[moment, robot].tolist()
            place = x, y, z, float(recording.heading[moment, robot])
            set_odometry(odometry, time, (FRAME, f"robot_{robot}"), place, float(recording.speed[moment, robot]))
            odometry.twist.covariance[0] = -1.0 if unknown["speed"][moment, robot] else 0.0
            yield TOPICS[0].format(robot), time, odometry
            yield PHASE.format(robot), time, _plain("Float64", float(recording.phase[moment, robot]))
            yield STATUS.format(robot), time, _plain("UInt8", int(recording.status[moment, robot]))
        if moment + 1 < len(recording) and not unknown["command"][moment, robot]:
            joints = blank("sensor_msgs/msg/JointState")
            set_stamp(joints.header, time, FRAME)
            joints.name, joints.position = (
                list(recording.scenario.action_names),
                commands[moment + 1, robot].astype(float),
            )
            yield COMMAND.format(robot), time, joints


def _plain(kind: str, value: Any) -> Any:
    """Return a message of std_msgs with one value."""
    message = blank(f"std_msgs/msg/{kind}")
    message.data = value
    return message


def _commands(recording: Recording) -> np.ndarray:
    """Return the actions of a recording, those of cars and differential drives in physical units."""
    if recording.scenario.task.action != "control":
        raise ValueError(f"task.action must be control for a log, got {recording.scenario.task.action}")
    commands = recording.action.copy()
    if recording.scenario.robot.kind in INPUTS:
        commands[..., :2] = inputs_of(recording.scenario.resolve().robot, np.ascontiguousarray(commands[..., :2]))
    return commands
