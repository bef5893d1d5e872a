"""Problem (11)-(15): its parameters, the car and the curve inside it, its cost, one stage and its derivatives.

A state is x, y [m], heading [rad], speed v [m/s], gamma [rad]; a control is steering delta [rad] and throttle tau.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from baselines.mpcc.frame import Frame
from baselines.similarity import EXPERIMENT, motion_scale
from lissajous_env.device.structs import struct_of
from lissajous_env.device.trig import cos_sin
from lissajous_env.parameters.scenario import Curve, Scenario
from lissajous_env.settings.checks import Checked, number, whole
from lissajous_env.theory import closed_forms


@dataclass(frozen=True)
class MpccParameters(Checked):
    """Parameters of problem (11)-(15) besides the curve, and of the solver.

    The weights are those of the paper's experiment; `MpccParameters.of` scales them to another scenario.
    """

    stages: int = whole(15, 1, 200)
    """M, stages of the horizon."""
    step: float = number(0.1, 1e-4, 100, "s")
    """Length of a stage [s]. The paper does not print it, but it matters: see `lissajous reproduce printed`."""
    weight_lateral: float = number(0.01, 0, 1e6, "1/(m s)^2")
    """Weight on the squared lateral error [1/(m s)^2].

    Differs from the paper: it prints the lateral and the lag weight in the reverse order, with which cars come far
    nearer to one another than it reports: `lissajous reproduce printed`.
    """
    weight_lag: float = number(0.025, 0, 1e6, "1/(m s)^2")
    """Weight on the squared lag error [1/(m s)^2]."""
    weight_steering: float = number(0.01, 1e-20, 1e6, "1/s^2")
    """q_3, weight on the squared steering angle [1/s^2]."""
    weight_throttle: float = number(0.01, 1e-20, 1e6, "1/s^2")
    """q_4, weight on the squared throttle [1/s^2]."""
    drag: float = number(0.945, 1e-3, 1e3, "1/s")
    """c, damping of the speed [1/s]; printed as 0.94."""
    drive: float = number(36.81, 1e-6, 1e6, "m/s^2")
    """alpha of the motor, acceleration per throttle [m/s^2]; printed as 36.8."""
    offset: float = number(3.804, 0, 1e6, "m/s^2")
    """beta of the model, a linear fit around 1 m/s; the plant's is 3.681 with a dead zone [m/s^2]."""
    wheelbase: float = number(0.175, 1e-6, 1e3, "m")
    """l, distance between the axles [m]."""
    steering_max: float = number(math.pi / 9, 1e-3, 1.57, "rad")
    """Largest steering angle to either side [rad]."""
    throttle_min: float = number(0.1, -1e3, 1e3)
    """Smallest throttle."""
    throttle_max: float = number(0.25, -1e3, 1e3)
    """Largest throttle."""
    max_iterations: int = whole(100, 1, 10_000)
    """Largest number of iterations from one start."""
    tolerance: float = number(1e-4, 1e-12, 1)
    """Relative decrease of the cost in an iteration below which a start has converged."""
    poor: float = number(0.05, 0, 1e6)
    """Fraction of (M + 1) phase_rate^2, the cost of standing still, above which another start is tried too.

    Only such problems have several optima: those before tight turns, where a car can slow down early or late.
    """
    shift: float = number(1.0, 0, 1)
    """Share of a stage that passes between two solves, by which the last solution is shifted as a new start."""

    def _check_together(self) -> None:
        self._require(self.throttle_max > self.throttle_min, "throttle_max", "must be above throttle_min")

    @classmethod
    def of(cls, scenario: Scenario, **overrides: Any) -> "MpccParameters":
        """Return the parameters for the cars of a scenario, scaled from those of the paper's experiment.

        The error of the phase rate is relative to omega, the position errors are relative to the scale of the motion,
        and the inputs are relative to their largest values. A stage lasts as long as a control step, or longer where
        slow cars need more time for a turn. The car's constants are those of the scenario, with the offset of the model
        as its designer measured it. Throttles at which the model brakes, but the motor of a car is off, are left out.
        """
        robot, tuned = scenario.robot, EXPERIMENT.robot
        rate, scale = scenario.formation.phase_rate / EXPERIMENT.formation.phase_rate, motion_scale(scenario)
        step = overrides.get("step", max(min(cls.step * scale.time, 1 / robot.drag), scenario.task.step))
        offset = robot.offset if robot.model_offset is None else robot.model_offset
        parameters = {
            "step": step,
            "shift": min(scenario.task.step / step, 1.0),
            "weight_lateral": cls.weight_lateral * (rate / scale.length) ** 2,
            "weight_lag": cls.weight_lag * (rate / scale.length) ** 2,
            "weight_steering": cls.weight_steering * (rate * (tuned.steering_max / robot.steering_max)) ** 2,
            "weight_throttle": cls.weight_throttle * (rate * (tuned.full_throttle / robot.full_throttle)) ** 2,
            "throttle_min": max(robot.throttle_min, min(robot.dead_zone, offset / robot.drive)),
            "throttle_max": robot.full_throttle,
            "offset": offset,
        }
        shared = ("wheelbase", "steering_max", "drag", "drive")
        return cls(**{**{name: getattr(robot, name) for name in shared}, **parameters, **overrides})


MpccStruct = struct_of(MpccParameters)

vec5 = wp.types.vector(length=5, dtype=wp.float32)


@wp.struct
class Speeds:
    """The four Runge-Kutta stages of the linear speed: v_i = from_speed_i v + from_push_i f, f = alpha tau - beta.

    `weight` holds h (1, 2, 2, 1) / 6, so that an increment is dot(weight, rates).
    """

    weight: wp.vec4
    from_speed: wp.vec4
    from_push: wp.vec4


@wp.struct
class Table:
    """1 / ||r'(gamma)|| as cubic pieces over equal cells of gamma; their number is a power of two, `last` + 1.

    The Runge-Kutta stages of gamma depend on one another, and evaluating a piece is faster than sines, a root and a
    quotient.
    """

    pieces: wp.array(dtype=wp.vec4)
    per_radian: float
    last: int


def tabulate(curve: Curve, device: Any) -> Any:
    """Fit the pieces to value and slope at both ends of each cell; they are exact to float32."""
    curve = curve.driven
    count = 512 << ((len(curve.harmonics) or max(curve.a, curve.b)) - 1).bit_length()
    width = 2 * math.pi / count
    gamma = width * np.arange(count + 1)
    speed = closed_forms.curve_speed(curve, gamma)
    first, second = closed_forms.curve_derivatives(curve, gamma)
    # d||r'|| / d gamma = r'.r'' / ||r'||
    f, d = 1 / speed, -width * np.sum(first * second, axis=-1) / speed**3
    rise = f[1:] - f[:-1]
    pieces = np.stack([f[:-1], d[:-1], 3 * rise - 2 * d[:-1] - d[1:], d[:-1] + d[1:] - 2 * rise], axis=1)
    table = Table()
    table.pieces = wp.array(pieces.astype(np.float32), dtype=wp.vec4, device=device)
    table.per_radian, table.last = count / (2 * math.pi), count - 1
    return table


@wp.struct
class Stage:
    """Derivatives of a stage's end by its start's heading, speed and gamma, and by steering and throttle.

    Those by x and y are unit vectors. Constant derivatives are left out: by heading, that of the heading is 1 and those
    of speed and gamma are 0; by gamma, only that of gamma is not 0; by steering, those of speed and gamma are 0.
    """

    by_heading: wp.vec2
    by_speed: vec5
    by_gamma: float
    by_steering: wp.vec3
    by_throttle: vec5


@wp.func
def speeds_of(p: MpccStruct) -> Speeds:
    """Return the Runge-Kutta stages of v' = -c v + f over one step, per unit of v and of f."""
    h = p.step
    s = Speeds()
    s.weight = wp.vec4(h / 6.0, h / 3.0, h / 3.0, h / 6.0)
    d2 = 1.0 - 0.5 * h * p.drag
    d3 = 1.0 - 0.5 * h * p.drag * d2
    s.from_speed = wp.vec4(1.0, d2, d3, 1.0 - h * p.drag * d3)
    e3 = 0.5 * h * d2
    s.from_push = wp.vec4(0.0, 0.5 * h, e3, h * (1.0 - p.drag * e3))
    return s


@wp.func
def errors_at(frame: Frame, state: vec5, phase_rate: float) -> wp.vec3:
    """Return the rate error phase_rate - v / ||r'|| of (15), lag error, and lateral error, above 0 on the left."""
    off = wp.vec2(state[0], state[1]) - frame.point
    t = frame.tangent
    return wp.vec3(phase_rate - state[3] * frame.inverse, wp.dot(t, off), t[0] * off[1] - t[1] * off[0])


@wp.func
def state_cost(p: MpccStruct, errors: wp.vec3) -> float:
    """Return e_rate^2 + q_lag e_lag^2 + q_lat e_lat^2 of (11a), for the errors of `errors_at`."""
    return errors[0] * errors[0] + p.weight_lag * errors[1] * errors[1] + p.weight_lateral * errors[2] * errors[2]


@wp.func
def control_cost(p: MpccStruct, control: wp.vec2) -> float:
    """Return q_3 delta^2 + q_4 tau^2 of (11a)."""
    return p.weight_steering * control[0] * control[0] + p.weight_throttle * control[1] * control[1]


@wp.func
def clip(p: MpccStruct, control: wp.vec2) -> wp.vec2:
    """Clip a control to its bounds (11c)."""
    return wp.vec2(
        wp.clamp(control[0], -p.steering_max, p.steering_max), wp.clamp(control[1], p.throttle_min, p.throttle_max)
    )


@wp.func
def phase_per_metre(table: Table, x: float) -> float:
    """Return 1 / ||r'|| [rad/m] at gamma = x cells."""
    cell = wp.floor(x)
    t = x - cell
    c = table.pieces[int(cell) & table.last]
    return (c[0] + c[1] * t) + (t * t) * (c[2] + c[3] * t)


@wp.func
def phase_per_metre_slope(table: Table, x: float) -> wp.vec2:
    """Return 1 / ||r'|| [rad/m] and its derivative by gamma [1/m] at gamma = x cells."""
    cell = wp.floor(x)
    t = x - cell
    c = table.pieces[int(cell) & table.last]
    value = (c[0] + c[1] * t) + (t * t) * (c[2] + c[3] * t)
    return wp.vec2(value, (c[1] + t * (2.0 * c[2] + 3.0 * c[3] * t)) * table.per_radian)


@wp.func
def travels(p: MpccStruct, speeds: wp.vec4) -> wp.vec4:
    """Return the distance from the start of the step to each of its Runge-Kutta stages."""
    half = 0.5 * p.step
    return wp.vec4(0.0, half * speeds[0], half * speeds[1], p.step * speeds[2])


@wp.func
def cos_sin_4(heading: float, turned: wp.vec4):
    """Return the cosines and sines of the heading at the four Runge-Kutta stages."""
    d1 = cos_sin(heading)
    d2 = cos_sin(heading + turned[1])
    d3 = cos_sin(heading + turned[2])
    d4 = cos_sin(heading + turned[3])
    return wp.vec4(d1[0], d2[0], d3[0], d4[0]), wp.vec4(d1[1], d2[1], d3[1], d4[1])


@wp.func
def advance(p: MpccStruct, rk: Speeds, table: Table, state: vec5, control: wp.vec2) -> vec5:
    """Return the state after one Runge-Kutta step of (12), with gamma' = v / ||r'(gamma)|| by (14) as its last row.

    The model is smooth, so v may fall below 0; full braking leads to up to 0.13 m/s below it.
    """
    push = p.drive * control[1] - p.offset
    v = rk.from_speed * state[3] + rk.from_push * push
    steer = cos_sin(control[0])
    curvature = steer[1] / (steer[0] * p.wheelbase)
    turned = wp.dot(rk.weight, v) * curvature
    cos, sin = cos_sin_4(state[2], travels(p, v) * curvature)
    wv = wp.cw_mul(rk.weight, v)
    # gamma is summed in cells of the table, which saves a product in each stage
    x = state[4] * table.per_radian
    full = v * (p.step * table.per_radian)
    half = 0.5 * full
    g1 = phase_per_metre(table, x)
    g2 = phase_per_metre(table, x + half[0] * g1)
    g3 = phase_per_metre(table, x + half[1] * g2)
    g4 = phase_per_metre(table, x + full[2] * g3)
    return vec5(
        state[0] + wp.dot(wv, cos),
        state[1] + wp.dot(wv, sin),
        state[2] + turned,
        state[3] + push * p.step - p.drag * wp.dot(rk.weight, v),
        state[4] + wp.dot(wv, wp.vec4(g1, g2, g3, g4)),
    )


@wp.func
def rate_by(v: float, inverse: wp.vec2, from_speed: float, from_push: float, by: wp.vec3) -> wp.vec3:
    """Return the derivative of v / ||r'(gamma)|| by gamma, speed and push at the start; `by` is that of gamma."""
    along = v * inverse[1]
    return wp.vec3(along * by[0], along * by[1] + from_speed * inverse[0], along * by[2] + from_push * inverse[0])


@wp.func
def linearise(p: MpccStruct, rk: Speeds, table: Table, state: vec5, control: wp.vec2) -> Stage:
    """Differentiate `advance` through the stages of its Runge-Kutta step."""
    push = p.drive * control[1] - p.offset
    v = rk.from_speed * state[3] + rk.from_push * push
    w = rk.weight
    steer = cos_sin(control[0])
    secant = 1.0 / steer[0]
    curvature = steer[1] * secant / p.wheelbase
    by_steering = secant * secant / p.wheelbase
    travel = travels(p, v)
    cos, sin = cos_sin_4(state[2], curvature * travel)
    wv_cos = wp.cw_mul(wp.cw_mul(w, v), cos)
    wv_sin = wp.cw_mul(wp.cw_mul(w, v), sin)
    ws = wp.cw_mul(w, rk.from_speed)
    wf = wp.cw_mul(w, rk.from_push)
    travel_s = travels(p, rk.from_speed) * curvature
    travel_f = travels(p, rk.from_push) * curvature

    # gamma: the chain through the four stages, each by (gamma, speed, push) of the start
    half = 0.5 * p.step
    own = wp.vec3(1.0, 0.0, 0.0)
    x = state[4] * table.per_radian
    cells = v * (half * table.per_radian)
    m1 = phase_per_metre_slope(table, x)
    d1 = rate_by(v[0], m1, 1.0, 0.0, own)
    m2 = phase_per_metre_slope(table, x + cells[0] * m1[0])
    d2 = rate_by(v[1], m2, rk.from_speed[1], rk.from_push[1], own + half * d1)
    m3 = phase_per_metre_slope(table, x + cells[1] * m2[0])
    d3 = rate_by(v[2], m3, rk.from_speed[2], rk.from_push[2], own + half * d2)
    m4 = phase_per_metre_slope(table, x + 2.0 * cells[2] * m3[0])
    d4 = rate_by(v[3], m4, rk.from_speed[3], rk.from_push[3], own + p.step * d3)
    gamma_by = own + w[0] * d1 + w[1] * d2 + w[2] * d3 + w[3] * d4

    sum_s = ws[0] + ws[1] + ws[2] + ws[3]
    sum_f = wf[0] + wf[1] + wf[2] + wf[3]
    s = Stage()
    s.by_heading = wp.vec2(
        -(wv_sin[0] + wv_sin[1] + wv_sin[2] + wv_sin[3]), wv_cos[0] + wv_cos[1] + wv_cos[2] + wv_cos[3]
    )
    s.by_speed = vec5(
        wp.dot(ws, cos) - wp.dot(wv_sin, travel_s),
        wp.dot(ws, sin) + wp.dot(wv_cos, travel_s),
        curvature * sum_s,
        1.0 - p.drag * sum_s,
        gamma_by[1],
    )
    s.by_gamma = gamma_by[0]
    s.by_steering = by_steering * wp.vec3(-wp.dot(wv_sin, travel), wp.dot(wv_cos, travel), wp.dot(w, v))
    s.by_throttle = p.drive * vec5(
        wp.dot(wf, cos) - wp.dot(wv_sin, travel_f),
        wp.dot(wf, sin) + wp.dot(wv_cos, travel_f),
        curvature * sum_f,
        p.step - p.drag * sum_f,
        gamma_by[2],
    )
    return s
