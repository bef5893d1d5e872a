"""Diagnostics and markers of a robot's node."""

from typing import Any

import numpy as np

from baselines.onboard import Onboard, Output
from baselines.ros import library as ros
from baselines.ros.conversions import set_pose, stamp_of
from baselines.ros.frames import Origin
from lissajous_env.theory.closed_forms import curve_point

_LINE_PLACES = 200
_GREEN, _RED, _BLUE = (0.1, 0.6, 0.2, 1.0), (0.8, 0.2, 0.1, 1.0), (0.4, 0.4, 0.9, 0.7)


def diagnostics(name: str, onboard: Onboard, reason: str, values: dict[str, Any], time: float) -> Any:
    """Return the state of a robot: OK while it drives, a warning with the reason where it is stopped."""
    level = ros.DiagnosticStatus.WARN if reason else ros.DiagnosticStatus.OK
    status = ros.DiagnosticStatus(level=level, name=f"lissajous: {name}", message=reason or "drives", hardware_id=name)
    for key, value in ({"robot": onboard.robot, "scenario": onboard.scenario.name} | values).items():
        shown = f"{value:.4g}" if isinstance(value, float) else str(value)
        status.values.append(ros.KeyValue(key=key, value=shown))
    message = ros.DiagnosticArray(status=[status])
    message.header.stamp = stamp_of(time)
    return message


class RobotMarkers:
    """Markers of a robot for RViz and Foxglove: its curve, body, sensing disc, and links to its ring neighbours.

    Args:
        onboard: The robot's policy.
        frame: Frame of the laboratory.
        origin: The middle of the rectangle in this frame.
    """

    def __init__(self, onboard: Onboard, frame: str, origin: Origin):
        self._onboard, self._frame, self._origin = onboard, frame, origin
        curve = onboard.scenario.curve
        a, b = curve.half_width, curve.half_height
        self._width = 0.01 * min(a, b)
        gamma = np.linspace(0, 2 * np.pi, _LINE_PLACES)
        self._curve = self._points(curve_point(curve, gamma).tolist())
        self._rectangle = self._points([(a, b), (-a, b), (-a, -b), (a, -b), (a, b)])

    def of(self, output: Output, neighbours: list[tuple[float, float]], time: float) -> Any:
        """Return the markers of a robot after a step, with the places [m] that its neighbours sent."""
        scenario, robot, width = self._onboard.scenario, self._onboard.robot, self._width
        made = [
            self._line("curve", robot, self._curve, _BLUE),
            self._line("rectangle", robot, self._rectangle, (0.5, 0.5, 0.5, 1.0)),
        ]
        if output.message is not None:
            place, body, disc = output.message[4:6], 2 * scenario.robot.radius, 2 * scenario.sensing_radius
            colour = _RED if output.stopped else _GREEN
            made.append(self._cylinder("bodies", robot, place, (body, body, body / 2), colour))
            made.append(self._cylinder("sensors", robot, place, (disc, disc, 0.01), (*colour[:3], 0.12)))
            pairs = self._points([each for other in neighbours for each in (place, other)])
            links = self._marker("ring", robot, ros.Marker.LINE_LIST, (width, 0.0, 0.0), _BLUE)
            links.points = pairs
            if not pairs:
                links.action = ros.Marker.DELETE
            made.append(links)
        for marker in made:
            marker.header.stamp = stamp_of(time)
        return ros.MarkerArray(markers=made)

    def _points(self, places: list[Any]) -> list[Any]:
        inside = [self._origin.outside(*place)[:2] for place in places]
        return [ros.Point(x=float(x), y=float(y), z=0.0) for x, y in inside]

    def _line(self, space: str, number: int, points: list[Any], colour: tuple[float, ...]) -> Any:
        marker = self._marker(space, number, ros.Marker.LINE_STRIP, (self._width, 0.0, 0.0), colour)
        marker.points = points
        return marker

    def _cylinder(self, space: str, number: int, place: Any, size: Any, colour: tuple[float, ...]) -> Any:
        marker = self._marker(space, number, ros.Marker.CYLINDER, size, colour)
        set_pose(marker.pose, *self._origin.outside(*place))
        return marker

    def _marker(self, space: str, number: int, shape: int, size: Any, colour: tuple[float, ...]) -> Any:
        marker = ros.Marker(ns=space, id=number, type=shape, action=ros.Marker.ADD)
        marker.header.frame_id = self._frame
        marker.pose.orientation.w = 1.0
        marker.scale.x, marker.scale.y, marker.scale.z = map(float, size)
        r, g, b, a = map(float, colour)
        marker.color = ros.ColorRGBA(r=r, g=g, b=b, a=a)
        return marker
