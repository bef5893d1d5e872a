"""The solver of problem (11)-(15) on the device: one thread takes one problem to its optimum.

Method: iterative LQR with input bounds (control-limited differential dynamic programming; Tassa, Mansard, Todorov,
"Control-Limited Differential Dynamic Programming", ICRA 2014) with the Gauss-Newton Hessian of the cost. A backward
sweep linearises the stages and solves a 2 x 2 bounded quadratic program in each; a forward sweep rolls the model out
with the feedback found, and is halved until the true cost (11a) falls. Levenberg damping grows where that fails.

Scratch arrays are indexed [row, problem]; the host lays them out so that a problem's rows are neighbours on a CPU and
the problems of a row are neighbours on CUDA.
"""

import warp as wp

from baselines.mpcc_model import (
    MpccStruct,
    Speeds,
    Stage,
    advance,
    clip,
    control_cost,
    errors_at,
    frame_at,
    linearise,
    speeds_of,
    state_cost,
    vec5,
)
from lissajous_env.curve import CurveStruct, point2

wp.set_module_options({"enable_backward": False, "max_unroll": 1})

COLD, SHIFT, KEEP = wp.constant(0), wp.constant(1), wp.constant(2)
"""What to start a problem from: along the curve, the last control shifted by a stage, the control as it stands."""

WORST = wp.constant(3.0e38)
"""Cost reported where there is no solution: finite, and above every other."""


@wp.struct
class Scratch:
    """Working memory, [row, problem]; trajectories and controls come in two slots, the accepted and the tried."""

    state: wp.array2d(dtype=vec5)
    control: wp.array2d(dtype=wp.vec2)
    change: wp.array2d(dtype=wp.vec2)
    gain: wp.array2d(dtype=vec5)


@wp.func
def along_curve(p: MpccStruct, curve: CurveStruct, state: vec5, rate: float, phase_rate: float, ahead: float) -> wp.vec2:
    """Pure pursuit of the curve's point `ahead` [rad] past gamma, at the wanted rate."""
    to = point2(curve, state[4] + ahead) - wp.vec2(state[0], state[1])
    cos = wp.cos(state[2])
    sin = wp.sin(state[2])
    left = cos * to[1] - sin * to[0]
    front = cos * to[0] + sin * to[1]
    curvature = 2.0 * left / wp.max(wp.dot(to, to), 1.0e-4)
    # A point behind is reached by the tightest turn.
    steering = wp.where(front > 0.0, wp.atan(p.wheelbase * curvature), wp.sign(left) * p.steering_max)
    wanted = phase_rate * rate
    throttle = (p.offset + p.drag * state[3] + (wanted - state[3]) / (2.0 * p.step)) / p.drive
    return clip(p, wp.vec2(steering, throttle))


@wp.func
def transposed(s: Stage, drag: float, v: vec5) -> vec5:
    """A^T v, where A is the stage's derivative by its state."""
    return vec5(v[0], v[1], wp.dot(s.by_heading, v), wp.dot(s.by_speed, v), s.by_gamma * v[4])


@wp.func
def box_step(h11: float, h12: float, h22: float, g: wp.vec2, low: wp.vec2, high: wp.vec2) -> wp.vec2:
    """Minimise g.u + u.H u / 2 over low <= u <= high: the interior point, or else the best of the four edges."""
    det = h11 * h22 - h12 * h12
    best = wp.vec2((h12 * g[1] - h22 * g[0]) / det, (h12 * g[0] - h11 * g[1]) / det)
    if best[0] < low[0] or best[0] > high[0] or best[1] < low[1] or best[1] > high[1]:
        value = float(WORST)
        for edge in range(4):
            u = wp.vec2(0.0, 0.0)
            if edge < 2:
                u0 = wp.where(edge == 0, low[0], high[0])
                u = wp.vec2(u0, wp.clamp(-(g[1] + h12 * u0) / h22, low[1], high[1]))
            else:
                u1 = wp.where(edge == 2, low[1], high[1])
                u = wp.vec2(wp.clamp(-(g[0] + h12 * u1) / h11, low[0], high[0]), u1)
            q = wp.dot(g, u) + 0.5 * (h11 * u[0] * u[0] + 2.0 * h12 * u[0] * u[1] + h22 * u[1] * u[1])
            if q < value:
                value = q
                best = u
    return best


@wp.func
def backward(
    p: MpccStruct, rk: Speeds, curve: CurveStruct, phase_rate: float, damping: float, slot: int, k: int, scratch: Scratch
) -> float:
    """Sweep from the last stage to the first; writes changes and gains, returns the expected fall of the cost."""
    M = p.stages
    expected = float(0.0)
    # value function's gradient and Hessian, by columns
    s = vec5()
    c0 = vec5()
    c1 = vec5()
    c2 = vec5()
    c3 = vec5()
    c4 = vec5()
    for back in range(M + 1):
        i = M - back
        z = scratch.state[slot * (M + 1) + i, k]
        frame = frame_at(curve, z[4])
        if back > 0:
            u = scratch.control[slot * M + i, k]
            stage = linearise(p, rk, curve, z, u, frame)
            # Q-function: V A and V B by columns, then A^T and B^T from the left
            a2 = c0 * stage.by_heading[0] + c1 * stage.by_heading[1] + c2
            a3 = (
                c0 * stage.by_speed[0] + c1 * stage.by_speed[1] + c2 * stage.by_speed[2]
                + c3 * stage.by_speed[3] + c4 * stage.by_speed[4]
            )
            b0 = c0 * stage.by_steering[0] + c1 * stage.by_steering[1] + c2 * stage.by_steering[2]
            b1 = (
                c0 * stage.by_throttle[0] + c1 * stage.by_throttle[1] + c2 * stage.by_throttle[2]
                + c3 * stage.by_throttle[3] + c4 * stage.by_throttle[4]
            )
            h11 = wp.dot(stage.by_steering, b0) + 2.0 * p.weight_steering
            h12 = wp.dot(stage.by_steering, b1)
            h22 = wp.dot(stage.by_throttle, b1) + 2.0 * p.weight_throttle
            g = wp.vec2(
                wp.dot(stage.by_steering, s) + 2.0 * p.weight_steering * u[0],
                wp.dot(stage.by_throttle, s) + 2.0 * p.weight_throttle * u[1],
            )
            q0 = transposed(stage, p.drag, b0)
            q1 = transposed(stage, p.drag, b1)
            s = transposed(stage, p.drag, s)
            n4 = transposed(stage, p.drag, c4 * stage.by_gamma)
            c0 = transposed(stage, p.drag, c0)
            c1 = transposed(stage, p.drag, c1)
            c2 = transposed(stage, p.drag, a2)
            c3 = transposed(stage, p.drag, a3)
            c4 = n4

            d11 = h11 * (1.0 + damping)
            d22 = h22 * (1.0 + damping)
            low = wp.vec2(-p.steering_max, p.throttle_min) - u
            high = wp.vec2(p.steering_max, p.throttle_max) - u
            du = box_step(d11, h12, d22, g, low, high)
            free0 = du[0] > low[0] and du[0] < high[0]
            free1 = du[1] > low[1] and du[1] < high[1]
            k0 = vec5()
            k1 = vec5()
            if free0 and free1:
                det = d11 * d22 - h12 * h12
                k0 = (q1 * h12 - q0 * d22) / det
                k1 = (q0 * h12 - q1 * d11) / det
            elif free0:
                k0 = -q0 / d11
            elif free1:
                k1 = -q1 / d22
            scratch.change[i, k] = du
            scratch.gain[2 * i, k] = k0
            scratch.gain[2 * i + 1, k] = k1

            # V = Q + K^T H du + K^T g + Qux^T du, and likewise for the Hessian
            r = wp.vec2(h11 * du[0] + h12 * du[1] + g[0], h12 * du[0] + h22 * du[1] + g[1])
            s = s + k0 * r[0] + k1 * r[1] + q0 * du[0] + q1 * du[1]
            t0 = k0 * h11 + k1 * h12 + q0
            t1 = k0 * h12 + k1 * h22 + q1
            c0 = c0 + k0 * t0[0] + k1 * t1[0] + q0 * k0[0] + q1 * k1[0]
            c1 = c1 + k0 * t0[1] + k1 * t1[1] + q0 * k0[1] + q1 * k1[1]
            c2 = c2 + k0 * t0[2] + k1 * t1[2] + q0 * k0[2] + q1 * k1[2]
            c3 = c3 + k0 * t0[3] + k1 * t1[3] + q0 * k0[3] + q1 * k1[3]
            c4 = c4 + k0 * t0[4] + k1 * t1[4] + q0 * k0[4] + q1 * k1[4]
            expected -= wp.dot(g, du) + 0.5 * wp.dot(r - g, du)

        # the state's own cost: gradient and Gauss-Newton Hessian of its three squares
        e = errors_at(frame, z, phase_rate)
        t = frame.tangent
        inverse = 1.0 / frame.rate
        j = vec5(0.0, 0.0, 0.0, -inverse, z[3] * frame.stretch * inverse * inverse)
        lag = vec5(t[0], t[1], 0.0, 0.0, frame.turn * e[2] - frame.rate)
        lat = vec5(-t[1], t[0], 0.0, 0.0, -frame.turn * e[1])
        wj = j * 2.0
        wlag = lag * (2.0 * p.weight_lag)
        wlat = lat * (2.0 * p.weight_lateral)
        s = s + wj * e[0] + wlag * e[1] + wlat * e[2]
        c0 = c0 + wlag * lag[0] + wlat * lat[0]
        c1 = c1 + wlag * lag[1] + wlat * lat[1]
        c3 = c3 + wj * j[3]
        c4 = c4 + wj * j[4] + wlag * lag[4] + wlat * lat[4]
    return expected


@wp.func
def forward(
    p: MpccStruct, rk: Speeds, curve: CurveStruct, phase_rate: float, length: float, slot: int, k: int, scratch: Scratch
) -> float:
    """Roll out u + length * change + gain (z - old z) into the other slot; returns the cost (11a)."""
    M = p.stages
    cost = float(0.0)
    z = scratch.state[slot * (M + 1), k]
    other = 1 - slot
    for i in range(M):
        old = scratch.state[slot * (M + 1) + i, k]
        u = scratch.control[slot * M + i, k] + length * scratch.change[i, k]
        dz = z - old
        u = clip(p, u + wp.vec2(wp.dot(scratch.gain[2 * i, k], dz), wp.dot(scratch.gain[2 * i + 1, k], dz)))
        frame = frame_at(curve, z[4])
        scratch.state[other * (M + 1) + i, k] = z
        scratch.control[other * M + i, k] = u
        cost += state_cost(p, errors_at(frame, z, phase_rate)) + control_cost(p, u)
        z = advance(p, rk, curve, z, u, frame.rate)
    scratch.state[other * (M + 1) + M, k] = z
    return cost + state_cost(p, errors_at(frame_at(curve, z[4]), z, phase_rate))


@wp.func
def lay_out(
    p: MpccStruct, rk: Speeds, curve: CurveStruct, start: vec5, phase_rate: float, ahead: float, k: int, scratch: Scratch
) -> float:
    """Roll a first trajectory into slot 0: the controls that stand there, or where `ahead` > 0 along the curve."""
    M = p.stages
    cost = float(0.0)
    z = start
    for i in range(M):
        frame = frame_at(curve, z[4])
        u = clip(p, scratch.control[i, k])
        if ahead > 0.0:
            u = along_curve(p, curve, z, frame.rate, phase_rate, ahead)
        scratch.state[i, k] = z
        scratch.control[i, k] = u
        cost += state_cost(p, errors_at(frame, z, phase_rate)) + control_cost(p, u)
        z = advance(p, rk, curve, z, u, frame.rate)
    scratch.state[M, k] = z
    return cost + state_cost(p, errors_at(frame_at(curve, z[4]), z, phase_rate))


@wp.kernel
def solve(
    p: MpccStruct,
    curve: CurveStruct,
    first: int,
    state: wp.array2d(dtype=float),
    phase_rate: wp.array(dtype=float),
    scratch: Scratch,
    begin: wp.array(dtype=int),
    control_out: wp.array3d(dtype=float),
    trajectory_out: wp.array3d(dtype=float),
    cost_out: wp.array(dtype=float),
    iterations_out: wp.array(dtype=int),
    failed_out: wp.array(dtype=int),
    failures_out: wp.array(dtype=int),
):
    """Solve problem `first` + thread from each of its starts and keep the best."""
    k = first + wp.tid()
    M = p.stages
    rk = speeds_of(p)
    rate = phase_rate[k]
    start = vec5(state[k, 0], state[k, 1], state[k, 2], state[k, 3], state[k, 4])
    sane = wp.isfinite(rate)
    for i in range(5):
        sane = sane and wp.isfinite(start[i])

    best = float(WORST)
    total = int(0)
    source = begin[k]
    attempt = int(0)
    if source == COLD:
        attempt = int(1)
    attempts = wp.where(sane, p.starts, 0)
    while attempt < attempts:
        if attempt == 0:
            for i in range(M):
                from_stage = wp.where(source == SHIFT, wp.min(i + 1, M - 1), i)
                scratch.control[i, k] = wp.vec2(control_out[k, from_stage, 0], control_out[k, from_stage, 1])
        ahead = float(0.0)
        if attempt == 1:
            ahead = 0.15
        if attempt == 2:
            ahead = 0.3
        if attempt == 3:
            ahead = 0.07
        if attempt > 3:
            side = wp.where(attempt % 2 == 0, 1.0, -1.0) * p.steering_max
            for i in range(M):
                scratch.control[i, k] = wp.vec2(
                    wp.where(i < 5, side, wp.where(attempt < 6, 0.0, -side)), (p.offset + p.drag * start[3]) / p.drive
                )
        cost = lay_out(p, rk, curve, start, rate, ahead, k, scratch)
        slot = int(0)
        damping = float(0.0)
        iteration = int(0)
        going = bool(wp.isfinite(cost))
        while going:
            iteration += 1
            expected = backward(p, rk, curve, rate, damping, slot, k, scratch)
            length = float(1.0)
            tried = float(WORST)
            fall = float(0.0)
            searching = bool(expected > 1.0e-7 * cost)
            accepted = bool(False)
            while searching:
                tried = forward(p, rk, curve, rate, length, slot, k, scratch)
                fall = cost - tried
                accepted = fall > 0.01 * length * expected
                length *= 0.5
                searching = not accepted and length > 0.04
            if accepted:
                slot = 1 - slot
                cost = tried
                if length > 0.4:
                    damping = wp.where(damping > 1.0e-3, damping * 0.2, 0.0)
                going = fall > p.tolerance * cost
            else:
                damping = wp.max(4.0 * damping, 1.0e-2)
                going = expected > p.tolerance * cost and damping < 1.0e4
            going = going and iteration < p.max_iterations
        total += iteration
        if cost < best:
            best = cost
            for i in range(M):
                u = scratch.control[slot * M + i, k]
                control_out[k, i, 0] = u[0]
                control_out[k, i, 1] = u[1]
            for i in range(M + 1):
                z = scratch.state[slot * (M + 1) + i, k]
                for j in range(5):
                    trajectory_out[k, i, j] = z[j]
        attempt += 1

    cost_out[k] = best
    iterations_out[k] = total
    begin[k] = SHIFT
    failed_out[k] = 0
