"""Write a recording as a rosbag2 file (MCAP), which Foxglove and RViz open.

Topics, in the frame `map`, whose origin is the middle of the rectangle:

| topic | type | content |
|---|---|---|
| `/robot_K/odom` | nav_msgs/Odometry | pose; speed and yaw rate |
| `/robot_K/command` | sensor_msgs/JointState | command from this time on, of a car steering [rad] and throttle |
| `/robot_K/phase` | std_msgs/Float64 | phase theta of (1) [rad] |
| `/robot_K/status` | std_msgs/UInt8 | 0 working, 1 failed, 2 removed |
| `/markers` | visualization_msgs/MarkerArray | curve, rectangle, bodies, headings, sensing discs, targets |
| `/lissajous/episode` | std_msgs/String | JSON: scenario, seed, policy, begin [s] |

The episode begins at `START` on the clock of the log. If it is itself a log that was scored, unknown poses and commands
are left out, and speeds that were computed from the poses have -1 as their first covariance.
"""

import json
import math
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from lissajous_env.episodes.recording import Recording
from lissajous_env.logs.inputs import INPUTS, inputs_of
from lissajous_env.logs.markers import Shape, ground_shapes, robot_shapes, target_shape
from lissajous_env.logs.messages import rosbags, type_store
from lissajous_env.logs.poses import TOPICS
from lissajous_env.logs.reading import COMMAND, EPISODE, PHASE, STATUS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.storage.files import replacing
from lissajous_env.world.state import REMOVED, WORKING

START = 1.0
"""Time of the reset [s]; ROS interprets 0 as no time."""


class _Topics:
    """Topics of a log that is being written, each made when it is first used."""

    def __init__(self, writer: Any, store: Any):
        self._writer, self._store, self._made = writer, store, {}
        self.types = store.types

    def write(self, topic: str, kind: str, time: float, **fields: Any) -> None:
        """Write a message of a type at a time [s]."""
        if topic not in self._made:
            self._made[topic] = self._writer.add_connection(topic, kind, typestore=self._store)
        message = self.types[kind](**fields)
        stored = self._store.serialize_cdr(message, kind)
        self._writer.write(self._made[topic], nanoseconds(time), stored)

    def header(self, time: float) -> Any:
        """Return the header of a message of a time [s]."""
        whole = nanoseconds(time)
        stamp = self.types["builtin_interfaces/msg/Time"](sec=whole // 10**9, nanosec=whole % 10**9)
        return self.types["std_msgs/msg/Header"](stamp=stamp, frame_id="map")


def nanoseconds(time: float) -> int:
    """Return a time [s] in whole nanoseconds."""
    return round(time * 1e9)


def save_mcap(recording: Recording, path: str | Path) -> None:
    """Write a recording as a log, first under a temporary name.

    Raises:
        MissingExtraError: rosbags, of the extra `logs`, is not installed.
        OSError: the file cannot be written.
    """
    rosbag2 = rosbags()
    store, folder = type_store(), Path(tempfile.mkdtemp(prefix="lissajous-"))
    try:
        writer = rosbag2.Writer(folder / "log", version=9, storage_plugin=rosbag2.StoragePlugin.MCAP)
        writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
        with writer:
            _write(recording, _Topics(writer, store))
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
    topics.write(EPISODE, "std_msgs/msg/String", START, data=about)
    commands = _commands(recording)
    step = recording.scenario.task.step
    unknown = {name: recording.is_unknown(name) for name in ("pose", "speed", "command")}
    for moment in range(len(recording)):
        time = START + moment * step
        for robot in range(recording.scenario.num_robots):
            if not unknown["pose"][moment, robot]:
                _write_robot(recording, topics, robot, moment, time, bool(unknown["speed"][moment, robot]))
            if moment + 1 < len(recording) and not unknown["command"][moment, robot]:
                values = commands[moment + 1, robot].astype(float)
                topics.write(
                    COMMAND.format(robot),
                    "sensor_msgs/msg/JointState",
                    time,
                    header=topics.header(time),
                    name=list(recording.scenario.action_names),
                    position=values,
                    velocity=np.zeros(0),
                    effort=np.zeros(0),
                )
        header = topics.header(time)
        markers = [_marker(topics.types, header, shape) for shape in _shapes(recording, moment)]
        topics.write("/markers", "visualization_msgs/msg/MarkerArray", time, markers=markers)


def _shapes(recording: Recording, moment: int) -> list[Shape]:
    """Return the shapes that change at a moment; at the first also those that never do."""
    scenario = recording.scenario.resolve()
    shapes = ground_shapes(scenario) if moment == 0 else []
    for robot in range(scenario.num_robots):
        status = int(recording.status[moment, robot])
        x, y, z = recording.position[moment, robot].tolist()
        place = x, y, z, float(recording.heading[moment, robot])
        shapes += robot_shapes(scenario, robot, place, status == int(WORKING), status != int(REMOVED))
    present = (recording.appears_at <= moment) & (recording.found_at > moment)
    return [*shapes, target_shape(scenario, recording.target_position[moment][present])]


def _marker(types: Any, header: Any, shape: Shape) -> Any:
    """Return the message of a shape; this library has no defaults of fields."""
    zero = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    no_header = types["std_msgs/msg/Header"](stamp=zero, frame_id="")
    nothing = np.zeros(0, np.uint8)
    point, colour = types["geometry_msgs/msg/Point"], types["std_msgs/msg/ColorRGBA"]
    return types["visualization_msgs/msg/Marker"](
        header=header,
        ns=shape.space,
        id=shape.number,
        type=shape.kind,
        action=shape.action,
        pose=_pose(types, *shape.place),
        scale=types["geometry_msgs/msg/Vector3"](*shape.scale),
        color=colour(*shape.colour),
        lifetime=types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0),
        frame_locked=False,
        points=[point(x, y, 0.0) for x, y in shape.points],
        colors=[],
        texture_resource="",
        texture=types["sensor_msgs/msg/CompressedImage"](header=no_header, format="", data=nothing),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=types["visualization_msgs/msg/MeshFile"](filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )


def _pose(types: Any, x: float, y: float, z: float, heading: float) -> Any:
    turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))
    return types["geometry_msgs/msg/Pose"](position=types["geometry_msgs/msg/Point"](x=x, y=y, z=z), orientation=turn)


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
    types, before = topics.types, max(moment - 1, 0)
    heading = float(recording.heading[moment, robot])
    turn = math.remainder(heading - float(recording.heading[before, robot]), 2 * math.pi)
    x, y, z = recording.position[moment, robot].tolist()
    pose = _pose(types, x, y, z, heading)
    twist = _twist(types, float(recording.speed[moment, robot]), turn / recording.scenario.task.step)
    unknown, measured = np.zeros(36), np.zeros(36)
    measured[0] = -1.0 if without_speed else 0.0
    topics.write(
        TOPICS[0].format(robot),
        "nav_msgs/msg/Odometry",
        time,
        header=topics.header(time),
        child_frame_id=f"robot_{robot}",
        pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=unknown),
        twist=types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=measured),
    )
    phase, status = float(recording.phase[moment, robot]), int(recording.status[moment, robot])
    topics.write(PHASE.format(robot), "std_msgs/msg/Float64", time, data=phase)
    topics.write(STATUS.format(robot), "std_msgs/msg/UInt8", time, data=status)


def _twist(types: Any, speed: float, yaw_rate: float) -> Any:
    vector = types["geometry_msgs/msg/Vector3"]
    linear, angular = vector(x=speed, y=0.0, z=0.0), vector(x=0.0, y=0.0, z=yaw_rate)
    return types["geometry_msgs/msg/Twist"](linear=linear, angular=angular)
