"""Markers of an episode for RViz and Foxglove."""

import math
from typing import Any

import numpy as np

from lissajous_env.episodes.recording import Recording
from lissajous_env.theory.closed_forms import curve_point
from lissajous_env.world.state import REMOVED, WORKING

_ARROW, _CYLINDER, _LINE, _SPHERES = 0, 3, 4, 7
_ADD, _DELETE = 0, 2
_FLAT = 0.01


def pose_of(types: Any, x: float, y: float, z: float, heading: float) -> Any:
    """Return the pose of a place [m] and a heading [rad]."""
    turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))
    return types["geometry_msgs/msg/Pose"](position=types["geometry_msgs/msg/Point"](x=x, y=y, z=z), orientation=turn)


class Markers:
    """Markers of the moments of a recording."""

    def __init__(self, recording: Recording, types: Any):
        self._recording, self._types = recording, types
        self._scenario = recording.scenario.resolve()

    def of(self, moment: int, header: Any) -> list[Any]:
        """Return the markers that change at a moment; at the first also those that never do."""
        made = self._ground(header) if moment == 0 else []
        for robot in range(self._scenario.num_robots):
            made += self._robot(robot, moment, header)
        return [*made, *self._targets(moment, header)]

    def _ground(self, header: Any) -> list[Any]:
        curve = self._scenario.curve
        a, b = curve.half_width, curve.half_height
        corners = np.array([(a, b), (-a, b), (-a, -b), (a, -b), (a, b)])
        line = curve_point(curve, np.linspace(0, 2 * np.pi, 400))
        width = 0.01 * min(a, b)
        rectangle = self._marker(header, "rectangle", 0, _LINE, (width, 0, 0), (0.5, 0.5, 0.5, 1), points=corners)
        return [rectangle, self._marker(header, "curve", 0, _LINE, (width, 0, 0), (0.4, 0.4, 0.9, 0.7), points=line)]

    def _robot(self, robot: int, moment: int, header: Any) -> list[Any]:
        recording, scenario = self._recording, self._scenario
        status = int(recording.status[moment, robot])
        there = _DELETE if status == int(REMOVED) else _ADD
        x, y, z = recording.position[moment, robot].tolist()
        place = x, y, z, float(recording.heading[moment, robot])
        body, disc = 2 * scenario.robot.radius, 2 * scenario.sensing_radius
        works = status == int(WORKING)
        colour = (0.1, 0.6, 0.2, 1.0) if works else (0.8, 0.2, 0.1, 1.0)
        senses = there if works else _DELETE
        return [
            self._marker(header, "bodies", robot, _CYLINDER, (body, body, body / 2), colour, place, action=there),
            self._marker(header, "headings", robot, _ARROW, (body, body / 4, body / 4), colour, place, action=there),
            self._marker(header, "sensors", robot, _CYLINDER, (disc, disc, _FLAT), (0.1, 0.6, 0.2, 0.12), place,
                         action=senses),
        ]  # fmt: skip

    def _targets(self, moment: int, header: Any) -> list[Any]:
        recording = self._recording
        there = (recording.appears_at <= moment) & (recording.found_at > moment)
        size = 0.5 * self._scenario.robot.radius
        points = recording.target_position[moment][there]
        action = _ADD if len(points) else _DELETE
        scale, colour = (size, size, size), (0.9, 0.5, 0.1, 1.0)
        return [self._marker(header, "targets", 0, _SPHERES, scale, colour, points=points, action=action)]

    def _marker(
        self,
        header: Any,
        space: str,
        number: int,
        shape: int,
        scale: tuple[float, float, float],
        colour: tuple[float, float, float, float],
        place: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
        points: Any = (),
        action: int = _ADD,
    ) -> Any:
        types = self._types
        point, rgba = types["geometry_msgs/msg/Point"], types["std_msgs/msg/ColorRGBA"]
        duration = types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
        stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
        no_picture = types["sensor_msgs/msg/CompressedImage"](
            header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=""), format="", data=np.zeros(0, np.uint8)
        )
        return types["visualization_msgs/msg/Marker"](
            header=header,
            ns=space,
            id=number,
            type=shape,
            action=action,
            pose=pose_of(types, *place),
            scale=types["geometry_msgs/msg/Vector3"](x=float(scale[0]), y=float(scale[1]), z=float(scale[2])),
            color=rgba(r=colour[0], g=colour[1], b=colour[2], a=colour[3]),
            lifetime=duration,
            frame_locked=False,
            points=[point(x=float(x), y=float(y), z=0.0) for x, y in points],
            colors=[],
            texture_resource="",
            texture=no_picture,
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=types["visualization_msgs/msg/MeshFile"](filename="", data=np.zeros(0, np.uint8)),
            mesh_use_embedded_materials=False,
        )
