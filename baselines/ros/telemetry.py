"""Diagnostics and markers of a robot's node."""

import math
from typing import Any

from baselines.onboard import Onboard, Output
from baselines.ros import library as ros
from baselines.ros.conversions import set_pose, stamp_of
from baselines.ros.frames import Origin
from lissajous_env.logs.markers import Shape, ground_shapes, link_shape, robot_shapes


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


def markers(
    onboard: Onboard, output: Output, neighbours: list[tuple[float, float]], frame: str, origin: Origin, time: float
) -> Any:
    """Return the markers of a robot for RViz and Foxglove: curve, body, sensing disc, links to its ring neighbours.

    Args:
        onboard: The robot's policy.
        output: The output of its latest step.
        neighbours: x, y [m] that its neighbours sent.
        frame: Frame of the laboratory.
        origin: The middle of the rectangle in this frame.
        time: Time [s].
    """
    scenario, robot = onboard.scenario, onboard.robot
    shapes = ground_shapes(scenario, robot)
    if output.message is not None:
        heading = math.atan2(output.row[3], output.row[2])
        place = output.message.x, output.message.y, 0.0, heading
        shapes += robot_shapes(scenario, robot, place, not output.stopped)
        shapes.append(link_shape(scenario, robot, place, neighbours))
    return ros.MarkerArray(markers=[marker(shape, frame, time, origin) for shape in shapes])


def marker(shape: Shape, frame: str, time: float, origin: Origin = Origin()) -> Any:  # noqa: B008 - it never changes
    """Return the message of a shape at a time [s]."""
    x, y, z, heading = shape.place
    message = ros.Marker(ns=shape.space, id=shape.number, type=shape.kind, action=shape.action)
    message.header.stamp, message.header.frame_id = stamp_of(time), frame
    if shape.points:
        message.pose.orientation.w = 1.0
        message.points = [ros.Point(x=u, y=v, z=0.0) for u, v, _ in (origin.outside(*end) for end in shape.points)]
    else:
        set_pose(message.pose, *origin.outside(x, y, heading))
        message.pose.position.z = z
    message.scale.x, message.scale.y, message.scale.z = shape.scale
    red, green, blue, opacity = shape.colour
    message.color = ros.ColorRGBA(r=red, g=green, b=blue, a=opacity)
    return message
