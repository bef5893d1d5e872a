"""Problem (11)-(15) on the device: its parameters, the car and the curve inside it, one stage and its derivatives.

A state is x, y [m], heading [rad], speed v [m/s], gamma [rad], a control is steering delta [rad], throttle tau.
"""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import warp as wp

from lissajous_env.curve import CurveStruct, point2, tangent2
from lissajous_env.fields import Checked, finite, non_negative, positive, whole, within
from lissajous_env.scenario import Robot
from lissajous_env.structs import struct_of

wp.set_module_options({"enable_backward": False, "max_unroll": 1})


@dataclass(frozen=True)
class MpccParameters(Checked):
    """What problem (11)-(15) holds besides the curve, and when the solver stops."""

    stages: int = whole(15, at_least=1, at_most=200)
    """M, stages of the horizon."""
    step: float = positive(0.1, "s")
    """Length of a stage [s]."""
    weight_lateral: float = non_negative(0.01, "1/(m s)^2")
    """Weight on the squared lateral error [1/(m s)^2].

    Differs from the paper: it prints the lateral and the lag weight in the reverse order, with which cars stall.
    """
    weight_lag: float = non_negative(0.025, "1/(m s)^2")
    """Weight on the squared lag error [1/(m s)^2]."""
    weight_steering: float = positive(0.01, "1/s^2")
    """q_4, weight on the squared steering angle [1/s^2]."""
    weight_throttle: float = positive(0.01, "1/s^2")
    """q_3, weight on the squared throttle [1/s^2]."""
    drag: float = positive(0.945, "1/s")
    """c, damping of the speed [1/s]."""
    drive: float = positive(36.81, "m/s^2")
    """alpha of the motor, acceleration per throttle [m/s^2]."""
    offset: float = non_negative(3.804, "m/s^2")
    """beta of the model, a linear fit around 1 m/s; the plant's is 3.681 with a dead zone [m/s^2]."""
    wheelbase: float = positive(0.175, "m")
    """l, distance between the axles [m]."""
    steering_max: float = within(math.pi / 9, 0, math.pi / 2, "rad")
    """Largest steering angle to either side [rad]."""
    throttle_min: float = finite(0.1)
    """Smallest throttle."""
    throttle_max: float = finite(0.25)
    """Largest throttle."""
    max_iterations: int = whole(100, at_least=1, at_most=10_000)
    """Iterations after which a start is given up."""
    starts: int = whole(2, at_least=1)
    """Starts."""
    tolerance: float = positive(1e-5)
    """A start has converged when an iteration lowers its cost by less than this fraction."""

    def _check_together(self) -> None:
        self._require(self.throttle_max > self.throttle_min, "throttle_max", "must be above throttle_min")

    @classmethod
    def of(cls, robot: Robot, **overrides: Any) -> "MpccParameters":
        """Take the car's constants from a robot, with the model's offset as its designer measured it."""
        shared = ("wheelbase", "steering_max", "throttle_min", "throttle_max", "drag", "drive")
        offset = robot.offset if robot.model_offset is None else robot.model_offset
        return cls(**{**{name: getattr(robot, name) for name in shared}, "offset": offset, **overrides})

    def replace(self, **overrides: Any) -> "MpccParameters":
        """Copy with some fields changed."""
        return dataclasses.replace(self, **overrides)


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
class Frame:
    """The curve at one gamma: r, its unit tangent, ||r'||, d||r'|| / d gamma, d(direction of r') / d gamma."""

    point: wp.vec2
    tangent: wp.vec2
    rate: float
    stretch: float
    turn: float


@wp.struct
class Stage:
    """Derivatives of a stage's end by its start's heading, speed and gamma, and by steering and throttle.

    By x and y they are unit vectors; by gamma only gamma's own, `by_gamma`, is not zero.
    """

    by_heading: vec5
    by_speed: vec5
    by_gamma: float
    by_steering: vec5
    by_throttle: vec5


@wp.func
def speeds_of(p: MpccStruct) -> Speeds:
    """Runge-Kutta stages of v' = -c v + f over one step, per unit of v and of f."""
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
def frame_at(curve: CurveStruct, gamma: float) -> Frame:
    """Evaluate the curve and how its tangent stretches and turns."""
    a = float(curve.a)
    b = float(curve.b)
    sin_a = wp.sin(a * gamma)
    cos_a = wp.cos(a * gamma)
    sin_b = wp.sin(b * gamma)
    cos_b = wp.cos(b * gamma)
    first = wp.vec2(-curve.half_width * a * sin_a, curve.half_height * b * cos_b)
    second = wp.vec2(-curve.half_width * a * a * cos_a, -curve.half_height * b * b * sin_b)
    f = Frame()
    f.point = wp.vec2(curve.half_width * cos_a, curve.half_height * sin_b)
    f.rate = wp.length(first)
    f.tangent = first / f.rate
    f.stretch = wp.dot(f.tangent, second)
    f.turn = (f.tangent[0] * second[1] - f.tangent[1] * second[0]) / f.rate
    return f


@wp.func
def errors_at(frame: Frame, state: vec5, phase_rate: float) -> wp.vec3:
    """Error of the phase rate, gamma' - v / ||r'|| of (15), lag error and lateral error (left of the curve above 0)."""
    off = wp.vec2(state[0], state[1]) - frame.point
    t = frame.tangent
    return wp.vec3(phase_rate - state[3] / frame.rate, wp.dot(t, off), t[0] * off[1] - t[1] * off[0])


@wp.func
def state_cost(p: MpccStruct, errors: wp.vec3) -> float:
    """J + q_lag e_lag^2 + q_lat e_lat^2 of (11a)."""
    return errors[0] * errors[0] + p.weight_lag * errors[1] * errors[1] + p.weight_lateral * errors[2] * errors[2]


@wp.func
def control_cost(p: MpccStruct, control: wp.vec2) -> float:
    """q_3 tau^2 + q_4 delta^2 of (11a)."""
    return p.weight_steering * control[0] * control[0] + p.weight_throttle * control[1] * control[1]


@wp.func
def clip(p: MpccStruct, control: wp.vec2) -> wp.vec2:
    """Hold a control inside (11c)."""
    return wp.vec2(
        wp.clamp(control[0], -p.steering_max, p.steering_max), wp.clamp(control[1], p.throttle_min, p.throttle_max)
    )


@wp.func
def inverse_rate(curve: CurveStruct, gamma: float) -> float:
    """1 / ||r'(gamma)|| [rad/m]."""
    return 1.0 / wp.length(tangent2(curve, gamma))


@wp.func
def travels(p: MpccStruct, speeds: wp.vec4) -> wp.vec4:
    """Distance from the start of the step to each of its Runge-Kutta stages."""
    half = 0.5 * p.step
    return wp.vec4(0.0, half * speeds[0], half * speeds[1], p.step * speeds[2])


@wp.func
def advance(
    p: MpccStruct, rk: Speeds, curve: CurveStruct, state: vec5, control: wp.vec2, frame_rate: float
) -> vec5:
    """One Runge-Kutta step of (12), gamma' = v / ||r'(gamma)|| by (14) as its last row.

    The model is smooth: nothing keeps v from passing below 0, which full braking can do by up to 0.13 m/s.
    """
    push = p.drive * control[1] - p.offset
    v = rk.from_speed * state[3] + rk.from_push * push
    heading = travels(p, v) * (wp.tan(control[0]) / p.wheelbase)
    turned = wp.dot(rk.weight, v) * (wp.tan(control[0]) / p.wheelbase)
    e = state[2]
    cos = wp.vec4(wp.cos(e), wp.cos(e + heading[1]), wp.cos(e + heading[2]), wp.cos(e + heading[3]))
    sin = wp.vec4(wp.sin(e), wp.sin(e + heading[1]), wp.sin(e + heading[2]), wp.sin(e + heading[3]))
    wv = wp.cw_mul(rk.weight, v)
    half = 0.5 * p.step
    g1 = v[0] / frame_rate
    g2 = v[1] * inverse_rate(curve, state[4] + half * g1)
    g3 = v[2] * inverse_rate(curve, state[4] + half * g2)
    g4 = v[3] * inverse_rate(curve, state[4] + p.step * g3)
    return vec5(
        state[0] + wp.dot(wv, cos),
        state[1] + wp.dot(wv, sin),
        e + turned,
        state[3] + push * p.step - p.drag * wp.dot(rk.weight, v),
        state[4] + wp.dot(rk.weight, wp.vec4(g1, g2, g3, g4)),
    )


@wp.func
def rate_by(v: float, frame: Frame, from_speed: float, from_push: float, by: wp.vec3) -> wp.vec3:
    """Derivative of v / ||r'(gamma)|| by the start's gamma, speed and push, where `by` is that of gamma."""
    inverse = 1.0 / frame.rate
    return wp.vec3(0.0, from_speed, from_push) * inverse - by * (v * frame.stretch * inverse * inverse)


@wp.func
def linearise(p: MpccStruct, rk: Speeds, curve: CurveStruct, state: vec5, control: wp.vec2, frame: Frame) -> Stage:
    """Differentiate `advance`, stage by stage of its Runge-Kutta step."""
    push = p.drive * control[1] - p.offset
    v = rk.from_speed * state[3] + rk.from_push * push
    w = rk.weight
    tangent = wp.tan(control[0])
    curvature = tangent / p.wheelbase
    by_steering = (1.0 + tangent * tangent) / p.wheelbase
    travel = travels(p, v)
    e = state[2]
    cos = wp.vec4(
        wp.cos(e), wp.cos(e + curvature * travel[1]), wp.cos(e + curvature * travel[2]), wp.cos(e + curvature * travel[3])
    )
    sin = wp.vec4(
        wp.sin(e), wp.sin(e + curvature * travel[1]), wp.sin(e + curvature * travel[2]), wp.sin(e + curvature * travel[3])
    )
    wv_cos = wp.cw_mul(wp.cw_mul(w, v), cos)
    wv_sin = wp.cw_mul(wp.cw_mul(w, v), sin)
    ws = wp.cw_mul(w, rk.from_speed)
    wf = wp.cw_mul(w, rk.from_push)
    travel_s = travels(p, rk.from_speed) * curvature
    travel_f = travels(p, rk.from_push) * curvature

    # gamma: the chain through the four stages, each by (gamma, speed, push) of the start
    half = 0.5 * p.step
    own = wp.vec3(1.0, 0.0, 0.0)
    d1 = rate_by(v[0], frame, 1.0, 0.0, own)
    f2 = frame_at(curve, state[4] + half * v[0] / frame.rate)
    d2 = rate_by(v[1], f2, rk.from_speed[1], rk.from_push[1], own + half * d1)
    f3 = frame_at(curve, state[4] + half * v[1] / f2.rate)
    d3 = rate_by(v[2], f3, rk.from_speed[2], rk.from_push[2], own + half * d2)
    f4 = frame_at(curve, state[4] + p.step * v[2] / f3.rate)
    d4 = rate_by(v[3], f4, rk.from_speed[3], rk.from_push[3], own + p.step * d3)
    gamma_by = own + w[0] * d1 + w[1] * d2 + w[2] * d3 + w[3] * d4

    s = Stage()
    s.by_heading = vec5(-(wv_sin[0] + wv_sin[1] + wv_sin[2] + wv_sin[3]), wv_cos[0] + wv_cos[1] + wv_cos[2] + wv_cos[3], 1.0, 0.0, 0.0)
    s.by_speed = vec5(
        wp.dot(ws, cos) - wp.dot(wv_sin, travel_s),
        wp.dot(ws, sin) + wp.dot(wv_cos, travel_s),
        curvature * (ws[0] + ws[1] + ws[2] + ws[3]),
        1.0 - p.drag * (ws[0] + ws[1] + ws[2] + ws[3]),
        gamma_by[1],
    )
    s.by_gamma = gamma_by[0]
    s.by_steering = by_steering * vec5(-wp.dot(wv_sin, travel), wp.dot(wv_cos, travel), wp.dot(w, v), 0.0, 0.0)
    s.by_throttle = p.drive * vec5(
        wp.dot(wf, cos) - wp.dot(wv_sin, travel_f),
        wp.dot(wf, sin) + wp.dot(wv_cos, travel_f),
        curvature * (wf[0] + wf[1] + wf[2] + wf[3]),
        p.step - p.drag * (wf[0] + wf[1] + wf[2] + wf[3]),
        gamma_by[2],
    )
    return s
