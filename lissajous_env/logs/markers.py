"""Shapes of robots and targets that RViz and Foxglove draw as markers, whichever library writes the messages."""

from typing import NamedTuple

import numpy as np

from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory.closed_forms import curve_point

ARROW, CYLINDER, LINE, LINES, SPHERES = 0, 3, 4, 5, 7
"""Types of visualization_msgs/Marker."""
ADD, DELETE = 0, 2
"""Actions of visualization_msgs/Marker."""
_FLAT = 0.01
_GREEN, _RED, _BLUE = (0.1, 0.6, 0.2, 1.0), (0.8, 0.2, 0.1, 1.0), (0.4, 0.4, 0.9, 0.7)

Place = tuple[float, float, float, float]
"""x, y, z [m] and heading [rad]."""


class Shape(NamedTuple):
    """A marker."""

    space: str
    """Namespace."""
    number: int
    """Number in the namespace."""
    kind: int
    """Type of visualization_msgs/Marker."""
    scale: tuple[float, float, float]
    """Extents [m]."""
    colour: tuple[float, float, float, float]
    """Red, green, blue, opacity, from 0 to 1."""
    place: Place = (0.0, 0.0, 0.0, 0.0)
    """Pose of the marker."""
    points: tuple[tuple[float, float], ...] = ()
    """x, y [m] of its points, for lines and spheres."""
    shown: bool = True
    """False to delete it."""

    @property
    def action(self) -> int:
        """Action of visualization_msgs/Marker."""
        return ADD if self.shown else DELETE


def ground_shapes(scenario: Scenario, number: int = 0) -> list[Shape]:
    """Return the rectangle and the curve."""
    curve = scenario.curve
    a, b = curve.half_width, curve.half_height
    width = 0.01 * min(a, b)
    corners = (a, b), (-a, b), (-a, -b), (a, -b), (a, b)
    line = curve_point(scenario.driven, np.linspace(0, 2 * np.pi, 400)).tolist()
    return [
        Shape("rectangle", number, LINE, (width, 0.0, 0.0), (0.5, 0.5, 0.5, 1.0), points=corners),
        Shape("curve", number, LINE, (width, 0.0, 0.0), _BLUE, points=tuple((x, y) for x, y in line)),
    ]


def robot_shapes(scenario: Scenario, robot: int, place: Place, works: bool, shown: bool = True) -> list[Shape]:
    """Return the body, the heading and the sensing disc of a robot; one that has failed is red and senses nothing."""
    body, disc = 2 * scenario.robot.radius, 2 * scenario.sensing_radius
    colour = _GREEN if works else _RED
    return [
        Shape("bodies", robot, CYLINDER, (body, body, body / 2), colour, place, shown=shown),
        Shape("headings", robot, ARROW, (body, body / 4, body / 4), colour, place, shown=shown),
        Shape("sensors", robot, CYLINDER, (disc, disc, _FLAT), (*_GREEN[:3], 0.12), place, shown=shown and works),
    ]


def link_shape(scenario: Scenario, robot: int, place: Place, neighbours: list[tuple[float, float]]) -> Shape:
    """Return the links of a robot to its ring neighbours, whose places are given [m]."""
    width = 0.01 * min(scenario.curve.half_width, scenario.curve.half_height)
    points = tuple(end for neighbour in neighbours for end in (place[:2], neighbour))
    return Shape("ring", robot, LINES, (width, 0.0, 0.0), _BLUE, points=points, shown=bool(points))


def target_shape(scenario: Scenario, places: np.ndarray) -> Shape:
    """Return the targets at places (K, 2) [m]."""
    size = 0.5 * scenario.robot.radius
    points = tuple((x, y) for x, y in places.tolist())
    return Shape("targets", 0, SPHERES, (size, size, size), (0.9, 0.5, 0.1, 1.0), points=points, shown=bool(points))
