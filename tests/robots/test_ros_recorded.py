"""A team over ROS 2 that is recorded as any recorder would: the log scores as the world node printed."""

import json
import subprocess
import time

import pytest

pytest.importorskip("rclpy", reason='ROS 2 is not installed: pip install ".[ros]"')
pytest.importorskip("rosbags")
from ros_team import PATIENCE, in_ros, process

from baselines.ros import library as ros
from lissajous_env.logs.messages import rosbags, type_store
from lissajous_env.logs.reading import read
from lissajous_env.logs.scoring import score

ROBOTS, LASTS = 2, 3.0
KINDS = {"odom": ros.Odometry, "status": ros.UInt8, "command": ros.JointState}
TEAM = (
    "launch", "--pace", 0.5, "--duration", LASTS, "--seed", 3, "--json", "--quiet", "--set", "robot.count=2",
    "formation.p=1", "formation.ring=(0,1)", "faults.schedule=((1,1,2),)",
)  # fmt: skip


class Recorder:
    """A node that writes what it receives with the time of the system's clock, as recorders do."""

    def __init__(self, folder):
        library, self.store = rosbags(), type_store()
        self.node = ros.Node("recorder", use_global_arguments=False)
        self.writer = library.Writer(folder, version=9, storage_plugin=library.StoragePlugin.MCAP)
        self.writer.open()
        topics = {f"/robot_{k}/{name}": kind for k in range(ROBOTS) for name, kind in KINDS.items()}
        for topic, kind in (topics | {"/lissajous/episode": ros.String}).items():
            quality = ros.LASTING if kind in (ros.UInt8, ros.String) else 100
            self.node.create_subscription(kind, topic, self._writes(topic, kind), quality, raw=True)

    def _writes(self, topic, kind):
        name = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
        connection = self.writer.add_connection(topic, name, typestore=self.store)
        return lambda raw: self.writer.write(connection, time.time_ns(), raw)

    def record(self, team):
        """Record until a process has ended; return what it printed."""
        executor = ros.make_executor()
        executor.add_node(self.node)
        ends = time.monotonic() + PATIENCE
        while team.poll() is None and time.monotonic() < ends:
            executor.spin_once(timeout_sec=0.1)
        executor.shutdown()
        self.node.destroy_node()
        self.writer.close()
        return team.communicate(timeout=10)


def test_a_recorded_launch_at_half_pace_scores_as_the_world_printed(tmp_path):
    # Oracle: the simulation in the world's node, which knows nothing of the log.
    with in_ros():
        recorder = Recorder(tmp_path / "log")
        team = process(*TEAM, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        try:
            output, error = recorder.record(team)
        finally:
            team.kill()
            team.wait()
    assert team.returncode == 0, error
    printed, scored = json.loads(output), score(read(tmp_path / "log"))
    (row,) = scored.rows
    assert scored.recording.duration == pytest.approx(LASTS)
    schedule = scored.recording.scenario.faults.schedule
    assert [(robot, end - begin) for robot, begin, end in schedule] == [(1, pytest.approx(1.0))]
    for name in ("targets", "collisions", "detected_fraction", "seed"):
        assert row[name] == printed[name], name
    for name in ("detection_time_mean", "idleness_mean", "coverage_time", "lateral_error_mean", "phase_error"):
        wanted = float("nan") if printed[name] is None else printed[name]
        assert row[name] == pytest.approx(wanted, rel=1e-3, abs=1e-3, nan_ok=True), name
    for name in ("distance_mean", "speed_max", "min_separation"):
        assert row[name] == pytest.approx(printed[name], rel=2e-3), name
