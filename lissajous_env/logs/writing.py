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


class _Topics:
    """Topics of a log that is being written, each made when it is first used."""

    def __init__(self, writer: Any):
        self._writer, self._made = writer, {}

    def write(self, topic: str, time: float, message: Any, **fields: Any) -> None:
        """Write a message at a time [s], with some of its fields."""
        kind, store = message.__msgtype__, type_store()
        for name, value in fields.items():
            setattr(message, name, value)
        if topic not in self._made:
            self._made[topic] = self._writer.add_connection(topic, kind, typestore=store)
        self._writer.write(self._made[topic], round(time * 1e9), store.serialize_cdr(message, kind))


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
        with writer:
            _write(recording, _Topics(writer))
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


def _write(recording: Recording, topics: _Topics) -> None:
    seed, policy = int(recording.score["seed"]), str(recording.score.get("policy", ""))
    about = episode_text(recording.scenario, seed, policy, START)
    topics.write(EPISODE, START, blank("std_msgs/msg/String"), data=about)
    commands = _commands(recording)
    step = recording.scenario.task.step
    unknown = {name: recording.is_unknown(name) for name in ("pose", "speed", "command")}
    for moment in range(len(recording)):
        time = START + moment * step
        for robot in range(recording.scenario.num_robots):
            if not unknown["pose"][moment, robot]:
                _write_robot(recording, topics, robot, moment, time, bool(unknown["speed"][moment, robot]))
            if moment + 1 < len(recording) and not unknown["command"][moment, robot]:
                message = blank("sensor_msgs/msg/JointState")
                set_stamp(message.header, time, FRAME)
                names, values = list(recording.scenario.action_names), commands[moment + 1, robot].astype(float)
                topics.write(COMMAND.format(robot), time, message, name=names, position=values)


def _commands(recording: Recording) -> np.ndarray:
    """Return the actions of a recording, those of cars and differential drives in physical units."""
    if recording.scenario.task.action != "control":
        raise ValueError(f"task.action must be control for a log, got {recording.scenario.task.action}")
    commands = recording.action.copy()
    if recording.scenario.robot.kind in INPUTS:
        commands[..., :2] = inputs_of(recording.scenario.resolve().robot, np.ascontiguousarray(commands[..., :2]))
    return commands


def _write_robot(
    recording: Recording, topics: _Topics, robot: int, moment: int, time: float, without_speed: bool
) -> None:
    heading = float(recording.heading[moment, robot])
    x, y, z = recording.position[moment, robot].tolist()
    odometry, speed = blank("nav_msgs/msg/Odometry"), float(recording.speed[moment, robot])
    set_odometry(odometry, time, (FRAME, f"robot_{robot}"), (x, y, z, heading), speed)
    odometry.twist.covariance[0] = -1.0 if without_speed else 0.0
    topics.write(TOPICS[0].format(robot), time, odometry)
    phase, status = float(recording.phase[moment, robot]), int(recording.status[moment, robot])
    topics.write(PHASE.format(robot), time, blank("std_msgs/msg/Float64"), data=phase)
    topics.write(STATUS.format(robot), time, blank("std_msgs/msg/UInt8"), data=status)
