"""Lower bounds of the mean detection time: what no policy can beat that knows nothing of where a target is.

After a time t, m discs of radius r that move at a speed v have swept at most m (pi r^2 + 2 r v t) of an area A, so a
target whose place is uniform on it is undetected with at least the share that is left; the mean time is at least the
integral of that share over time. Where targets move at a speed u, discs meet them at v + u at most.
"""

import math


def mean_time_inside(area: float, num_robots: int, radius: float, speed: float) -> float:
    """(A - m pi r^2)^2 / (4 m r v A) [s], of targets that appear anywhere in an area.

    Args:
        area: A [m^2].
        num_robots: m.
        radius: r, of a robot's sensor [m].
        speed: v, top speed of a robot, with that of a target where they move [m/s].
    """
    left = max(area - num_robots * math.pi * radius**2, 0.0)
    return left**2 / (4 * num_robots * radius * speed * area)


def mean_time_on_boundary(length: float, num_robots: int, radius: float, speed: float) -> float:
    """(P - 2 m r)^2 / (2 m v P) [s], of targets that appear anywhere on a boundary, by robots that go along it.

    Equally spaced laps meet it. It is no bound at corners, where a robot that cuts them sees both sides: four of them
    make some per cent.

    Args:
        length: P [m].
        num_robots: m.
        radius: r, of a robot's sensor [m].
        speed: v, top speed of a robot, with that of a target along the boundary where they move [m/s].
    """
    left = max(length - 2 * num_robots * radius, 0.0)
    return left**2 / (2 * num_robots * speed * length)
