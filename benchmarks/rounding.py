"""The rounded form of the curve 3:2 (`lissajous_env.theory.closed_forms.rounded`): `python benchmarks/rounding.py`.

It is the curve of the form of that module nearest to (3) at equal gamma, between the walls of a scenario, on which

* no bend is tighter than `--bend` turning radii,
* cars slow down and accelerate by less than `BRAKING` and `PUSH` of what they can, and drive at `SLOWEST` or faster,
* robots at equal distances of gamma are at least `--apart` apart.

IPOPT solves this program from the Lissajous curve. The table shows the coefficients, the largest distance from (3) at
equal gamma, and the worst-case undetected time of points that move along the curve in formation, also with sensors
that reach less far. Some curves that are as near have gaps through which a rogue escapes if sensors reach a bit less.
"""

import math

import casadi as ca
import figures
import numpy as np

import lissajous_env
from baselines.policies.ideal_motion import worst_undetected_time
from lissajous_env.parameters.scenario import Scenario

BRAKING, PUSH, SLOWEST = 0.8, 0.7, 0.25
"""Shares of the deceleration of a car that coasts and of the strongest push of its motor, and least speed [m/s]."""
SAMPLES = 120
"""Points of a quarter of a lap, of which the others are mirror images, where the limits apply."""
ROUGHNESS = 1e-6
"""Weight of the squared second derivative, against that of the distance from (3)."""
REACHES = 1.0, 0.97, 0.93, 0.9
"""Sensing radii, over that of the scenario."""


def series(gamma: np.ndarray, coefficients: tuple, order: int) -> tuple:
    """Return x and y, or their derivatives by gamma of an order, of c_k and s_k in symbols or numbers [m]."""
    sides = []
    for first, turn, factors in zip((1, 2), (0.0, -np.pi / 2), coefficients, strict=True):
        k = np.arange(first, first + 2 * factors.shape[0], 2)
        sides.append(np.cos(gamma[:, None] * k + turn + order * np.pi / 2) * k**order @ factors)
    return tuple(sides)


def nearest(scenario: Scenario, harmonics: int, bend: float, apart: float) -> tuple[np.ndarray, np.ndarray]:
    """Return c_k and s_k [m] of the nearest curve that meets the limits.

    Raises:
        ValueError: IPOPT finds none.
    """
    curve, robot, rate = scenario.driven, scenario.robot, scenario.formation.phase_rate
    half = np.array([curve.half_width, curve.half_height])
    turning = robot.wheelbase / math.tan(robot.steering_max)
    count = harmonics // 2
    free = ca.MX.sym("coefficients", 2 * count)
    parts = free[:count], free[count:]
    gamma = np.linspace(0, np.pi / 2, SAMPLES)
    places = [_dm(series(gamma, _sides(count), order), parts) for order in range(3)]
    (x, y), (dx, dy), (ddx, ddy) = places
    square, along = dx**2 + dy**2, dx * ddx + dy * ddy
    speed = rate * ca.sqrt(square)
    push = robot.drag * speed + rate**2 * along / ca.sqrt(square)
    limits = [  # each between two bounds
        (x, -half[0], half[0]),
        (y, -half[1], half[1]),
        (bend * turning * (dx * ddy - dy * ddx) / square**1.5, -1.0, 1.0),
        (speed, SLOWEST, robot.top_speed),
        (rate * along / square, -BRAKING * robot.drag, np.inf),
        (push, -np.inf, PUSH * robot.drag * robot.top_speed),
    ]
    for k in range(1, scenario.num_robots // 2 + 1):
        shift = np.pi * k / scenario.num_robots
        one, other = (_dm(series(gamma + side * shift, _sides(count), 0), parts) for side in (-1, 1))
        limits.append(((one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2, apart**2, np.inf))
    wanted = half[0] * np.cos(curve.a * gamma), half[1] * np.sin(curve.b * gamma)
    cost = ca.sumsqr(x - wanted[0]) + ca.sumsqr(y - wanted[1]) + ROUGHNESS * (ca.sumsqr(ddx) + ca.sumsqr(ddy))
    begin = np.zeros(2 * count)
    begin[curve.a // 2], begin[count + curve.b // 2 - 1] = 0.97 * half
    options = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes"}
    terms, least, most = zip(*limits, strict=True)
    program = {"x": free, "f": cost / SAMPLES, "g": ca.vertcat(*terms)}
    solver = ca.nlpsol("rounding", "ipopt", program, options)
    solution = solver(x0=begin, lbg=np.repeat(least, SAMPLES), ubg=np.repeat(most, SAMPLES))
    if not solver.stats()["success"]:
        raise ValueError(f"limits must permit a curve, IPOPT ends with {solver.stats()['return_status']}")
    coefficients = np.array(solution["x"]).ravel()
    return coefficients[:count], coefficients[count:]


def _sides(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.eye(count), np.eye(count)


def _dm(matrices: tuple, parts: tuple) -> tuple:
    return tuple(ca.DM(matrix) @ part for matrix, part in zip(matrices, parts, strict=True))


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--scenario", default="evaders-walls")
    parser.add_argument("--harmonics", type=int, default=10)
    parser.add_argument("--bend", type=float, nargs="+", default=[1.1], help="least radii of bends, in turning radii")
    parser.add_argument("--apart", type=float, nargs="+", default=[0.39], help="least distances of robots [m]")
    options = parser.parse_args()
    scenario = lissajous_env.scenario(options.scenario)
    curve, step = scenario.driven, scenario.task.step
    period = 2 * math.pi / scenario.formation.phase_rate
    gamma = np.linspace(0, 2 * np.pi, round(period / step), endpoint=False)
    sizes = scenario.curve.half_width, scenario.curve.half_height
    rows = []
    for bend in options.bend:
        for apart in options.apart:
            c, s = nearest(scenario, options.harmonics, bend, apart)
            loop = np.stack([
                np.stack(series(gamma + 2 * np.pi * k / scenario.num_robots, (c, s), 0), axis=-1)
                for k in range(scenario.num_robots)
            ])  # fmt: skip
            wanted = [curve.half_width * np.cos(curve.a * gamma), curve.half_height * np.sin(curve.b * gamma)]
            off = np.hypot(*(loop[0].T - wanted)).max()
            worst = [
                worst_undetected_time(loop, sizes, scenario.sensing_radius * reach, scenario.rogue_speed, step, 20.0)
                for reach in REACHES
            ]
            cells = (
                ", ".join(f"{value:.3f}" for value in part) for part in (c / curve.half_width, s / curve.half_height)
            )
            rows.append([f"{bend:g}", f"{apart:g}", *cells, f"{off:.2f}", *(f"{time:.1f}" for time in worst)])
    columns = ["bend", "apart [m]", "c", "s", "off [m]", *(f"worst case at {reach:g} r_s [s]" for reach in REACHES)]
    figures.show(f"{scenario.name}, {options.harmonics} harmonics", {"columns": columns, "rows": rows})


if __name__ == "__main__":
    main()
