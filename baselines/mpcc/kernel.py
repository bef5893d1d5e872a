"""The solver of problem (11)-(15) on the device: each thread solves one problem to its optimum.

Method: iterative LQR with input bounds (control-limited differential dynamic programming; Tassa, Mansard, Todorov,
"Control-Limited Differential Dynamic Programming", ICRA 2014) with the Gauss-Newton Hessian of the cost. A backward
sweep linearises the stages and solves a bounded quadratic program of two inputs in each. A forward sweep simulates the
model with the resulting feedback, and its step is halved until the true cost (11a) decreases. If it does not decrease,
the Levenberg damping grows.

Scratch arrays are indexed [row, problem]. The host lays them out so that the rows of a problem are adjacent on a CPU,
and the problems of a row are adjacent on CUDA.
"""

from typing import Any

import warp as wp

from baselines.mpcc.frame import frame_at, oscillation_of, place_at
from baselines.mpcc.model import (
    MpccStruct,
    Speeds,
    Table,
    advance,
    clip,
    control_cost,
    errors_at,
    linearise,
    phase_per_metre,
    speeds_of,
    state_cost,
    vec5,
)
from baselines.mpcc.quadratic import (
    Quadratic,
    add_outer,
    add_state_cost,
    box_step,
    pulled_back,
    times,
    times3,
    transposed,
)
from lissajous_env.device.compilation import CONTRACTED
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.trig import cos_sin

wp.set_module_options(CONTRACTED)

EARLY, SHIFT, KEEP, CLOSE = wp.constant(0), wp.constant(1), wp.constant(2), wp.constant(3)
"""Initial guesses of the inputs: along the curve braking early, the last control shifted by the time since then, the
last control unchanged, close along the curve."""

PROBE = wp.constant(0.13)
"""Share of the throttle's range by which `probe` opens it."""

PROBE_MARGIN = wp.constant(1.1)
"""Factor of the best cost below which the cost of a probe must be for the probe to be optimised."""

NEAREST = wp.constant(0.003)
"""Square of the smallest distance to a pursued point, in wheelbases."""

WORST = wp.constant(3.0e38)
"""Cost that is reported without a solution; it is finite and above every other."""


@wp.struct
class Scratch:
    """Working memory, [row, problem]; trajectories and controls have two slots, one accepted and one tried."""

    state: wp.array2d(dtype=vec5)
    control: wp.array2d(dtype=wp.vec2)
    change: wp.array2d(dtype=wp.vec2)
    gain: wp.array2d(dtype=vec5)


@wp.func
def backward(
    p: MpccStruct,
    rk: Speeds,
    curve: Any,
    table: Table,
    phase_rate: float,
    damping: float,
    slot: int,
    k: int,
    scratch: Scratch,
) -> float:
    """Sweep from the last stage to the first, write changes and gains, and return the expected decrease of the cost."""
    M = p.stages
    expected = float(0.0)
    end = scratch.state[slot * (M + 1) + M, k]
    last = frame_at(curve, end[4])
    value = add_state_cost(p, last, end, errors_at(last, end, phase_rate), Quadratic())
    for back in range(M):
        i = M - 1 - back
        z = scratch.state[slot * (M + 1) + i, k]
        u = scratch.control[slot * M + i, k]
        frame = frame_at(curve, z[4])
        stage = linearise(p, rk, table, z, u)
        b0 = times3(value, stage.by_steering)
        b1 = times(value, stage.by_throttle)
        d = stage.by_steering
        h11 = d[0] * b0[0] + d[1] * b0[1] + d[2] * b0[2] + 2.0 * p.weight_steering
        h12 = d[0] * b1[0] + d[1] * b1[1] + d[2] * b1[2]
        h22 = wp.dot(stage.by_throttle, b1) + 2.0 * p.weight_throttle
        g = wp.vec2(
            d[0] * value.s[0] + d[1] * value.s[1] + d[2] * value.s[2] + 2.0 * p.weight_steering * u[0],
            wp.dot(stage.by_throttle, value.s) + 2.0 * p.weight_throttle * u[1],
        )
        q0 = transposed(stage, b0)
        q1 = transposed(stage, b1)

        e11 = damping * h11
        e22 = damping * h22
        d11 = h11 + e11
        d22 = h22 + e22
        low = wp.vec2(-p.steering_max, p.throttle_min) - u
        high = wp.vec2(p.steering_max, p.throttle_max) - u
        du = box_step(d11, h12, d22, g, low, high)
        free0 = du[0] > low[0] and du[0] < high[0]
        free1 = du[1] > low[1] and du[1] < high[1]
        # gains of the inputs that are not at their bounds
        c11 = wp.where(free0, 1.0 / d11, 0.0)
        c22 = wp.where(free1, 1.0 / d22, 0.0)
        c12 = float(0.0)
        if free0 and free1:
            inverse = 1.0 / (d11 * d22 - h12 * h12)
            c11 = d22 * inverse
            c22 = d11 * inverse
            c12 = -h12 * inverse
        k0 = -(q0 * c11 + q1 * c12)
        k1 = -(q0 * c12 + q1 * c22)
        scratch.change[i, k] = du
        scratch.gain[2 * i, k] = k0
        scratch.gain[2 * i + 1, k] = k1

        # V = Q + K^T H K + K^T Qux + Qux^T K, where (H + E) K = -Qux on the free inputs and K = 0 on the others;
        # likewise for the gradient
        q0 -= e11 * k0
        q1 -= e22 * k1
        value = pulled_back(value, stage)
        value.s = value.s + q0 * du[0] + q1 * du[1]
        value = add_outer(add_outer(value, q0, k0), q1, k1)
        value = add_state_cost(p, frame, z, errors_at(frame, z, phase_rate), value)
        expected -= wp.dot(g, du) + 0.5 * (h11 * du[0] * du[0] + h22 * du[1] * du[1]) + h12 * du[0] * du[1]
    return expected


@wp.func
def forward(
    p: MpccStruct,
    rk: Speeds,
    curve: Any,
    table: Table,
    phase_rate: float,
    length: float,
    slot: int,
    k: int,
    scratch: Scratch,
) -> float:
    """Simulate u + length * change + gain (z - old z) into the other slot, and return the cost (11a)."""
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
        z = advance(p, rk, table, z, u)
    scratch.state[other * (M + 1) + M, k] = z
    return cost + state_cost(p, errors_at(frame_at(curve, z[4]), z, phase_rate))


@wp.func
def along_curve(p: MpccStruct, curve: Any, table: Table, state: vec5, phase_rate: float, early: bool) -> wp.vec2:
    """Return the control of pure pursuit of a point ahead on the curve.

    With `early` the car slows down before the turns: its speed is that for a part of the rate at another point ahead.
    Otherwise it stays close to the curve, at the full rate where it is.
    """
    oscillation = oscillation_of(curve)
    ahead = wp.where(early, 0.9, 0.24) * oscillation
    lead = wp.where(early, 0.3, 0.0) * oscillation
    pace = wp.where(early, 0.6, 1.0) * phase_rate
    to = place_at(curve, state[4] + ahead) - wp.vec2(state[0], state[1])
    facing = cos_sin(state[2])
    left = facing[0] * to[1] - facing[1] * to[0]
    front = wp.dot(facing, to)
    # The tightest turn leads to a point behind the car.
    pursuit = wp.atan(2.0 * p.wheelbase * left / wp.max(wp.dot(to, to), NEAREST * p.wheelbase * p.wheelbase))
    steering = wp.where(front > 0.0, pursuit, wp.sign(left) * p.steering_max)
    wanted = pace / phase_per_metre(table, (state[4] + lead) * table.per_radian)
    throttle = (p.offset + p.drag * state[3] + (wanted - state[3]) / (2.0 * p.step)) / p.drive
    return clip(p, wp.vec2(steering, throttle))


@wp.func
def lay_out(
    p: MpccStruct,
    rk: Speeds,
    curve: Any,
    table: Table,
    start: vec5,
    phase_rate: float,
    kind: int,
    slot: int,
    k: int,
    scratch: Scratch,
    control: wp.array3d(dtype=float),
) -> float:
    """Simulate a first trajectory into a slot, from a guess in `control` or along the curve, and return its cost."""
    M = p.stages
    cost = float(0.0)
    z = start
    for i in range(M):
        frame = frame_at(curve, z[4])
        u = wp.vec2(0.0, 0.0)
        if kind == SHIFT or kind == KEEP:  # noqa: SIM109
            j = wp.where(kind == SHIFT, wp.min(i + 1, M - 1), i)
            u = wp.vec2(control[k, j, 0], control[k, j, 1])
            if kind == SHIFT and p.shift < 1.0:
                # of a control that is constant in each stage, the mean over the shifted stage
                u = p.shift * u + (1.0 - p.shift) * wp.vec2(control[k, i, 0], control[k, i, 1])
            u = clip(p, u)
        else:
            u = along_curve(p, curve, table, z, phase_rate, kind == EARLY)
        scratch.state[slot * (M + 1) + i, k] = z
        scratch.control[slot * M + i, k] = u
        cost += state_cost(p, errors_at(frame, z, phase_rate)) + control_cost(p, u)
        z = advance(p, rk, table, z, u)
    scratch.state[slot * (M + 1) + M, k] = z
    return cost + state_cost(p, errors_at(frame_at(curve, z[4]), z, phase_rate))


@wp.func
def probe(
    p: MpccStruct, rk: Speeds, curve: Any, table: Table, phase_rate: float, slot: int, k: int, scratch: Scratch
) -> float:
    """Open the first throttle a little, simulate with the gains into the other slot, and return the cost.

    A car that coasts towards a tight turn can be in a local optimum at the throttle's lower bound, close to a better
    one inside the bounds.
    """
    for i in range(p.stages):
        scratch.change[i, k] = wp.vec2(0.0, 0.0)
    scratch.change[0, k] = wp.vec2(0.0, PROBE * (p.throttle_max - p.throttle_min))
    return forward(p, rk, curve, table, phase_rate, 1.0, slot, k, scratch)


@wp.func
def descend(
    p: MpccStruct,
    rk: Speeds,
    curve: Any,
    table: Table,
    phase_rate: float,
    first_cost: float,
    first_slot: int,
    best: float,
    k: int,
    scratch: Scratch,
):
    """Iterate to convergence, unless the cost will not fall below `best`; return cost, slot and iterations."""
    cost = first_cost
    slot = first_slot
    damping = float(0.0)
    iteration = wp.int32(0)
    going = bool(wp.isfinite(cost))
    while going:
        iteration += 1
        expected = backward(p, rk, curve, table, phase_rate, damping, slot, k, scratch)
        length = float(1.0)
        tried = float(WORST)
        accepted = bool(False)
        searching = bool(expected > 0.3 * p.tolerance * cost)
        while searching:
            tried = forward(p, rk, curve, table, phase_rate, length, slot, k, scratch)
            accepted = cost - tried > 0.01 * length * expected
            length *= 0.5
            searching = not accepted and length > 0.04
        if accepted:
            going = cost - tried > p.tolerance * tried
            slot = 1 - slot
            cost = tried
            if length > 0.4:  # a half, after the first and full step
                damping = wp.where(damping > 1.0e-3, 0.2 * damping, 0.0)
        else:
            damping = wp.max(4.0 * damping, 1.0e-2)
            going = expected > p.tolerance * cost and damping < 1.0e4
        hopeless = iteration > 1 and cost - expected > best
        going = going and not hopeless and iteration < p.max_iterations
    return cost, slot, iteration


@wp.kernel
def solve(
    p: MpccStruct,
    curve: Any,
    table: Table,
    first: int,
    state: wp.array2d(dtype=float),
    phase_rate: wp.array(dtype=float),
    scratch: Scratch,
    begin: wp.array(dtype=int),
    control_out: wp.array3d(dtype=float),
    trajectory_out: wp.array3d(dtype=float),
    cost_out: wp.array(dtype=float),
    iterations_out: wp.array(dtype=int),
):
    """Solve problem `first` + thread from up to three starts, and store the best solution."""
    k = first + wp.tid()
    M = p.stages
    rk = speeds_of(p)
    rate = phase_rate[k]
    start = vec5(state[k, 0], state[k, 1], state[k, 2], state[k, 3], state[k, 4])
    sane = wp.isfinite(rate)
    for j in range(5):
        sane = sane and wp.isfinite(start[j])

    best = float(WORST)
    iterations = wp.int32(0)
    if sane:
        kind = begin[k]
        poor = p.poor * float(M + 1) * rate * rate
        limit = poor
        if kind == SHIFT:
            # A warm start that costs about as much as the last solution is still near its optimum.
            limit = wp.max(poor, 2.0 * cost_out[k])
        # the guess, and where that is poor the better of it and the start along the curve
        cost = float(WORST)
        slot = wp.int32(0)
        laid = kind
        for side in range(2):
            if side == 0 or (kind != EARLY and not cost < limit):
                start_cost = lay_out(
                    p, rk, curve, table, start, rate, wp.where(side == 0, kind, EARLY), side, k, scratch, control_out
                )
                if not cost <= start_cost:
                    cost = start_cost
                    slot = side
                    laid = wp.where(side == 0, kind, EARLY)
        # descend from this start, then from its probe, and if that is still poor from the other start
        for attempt in range(3):
            worth = bool(attempt == 0)
            if attempt == 1 and best < WORST:
                u = scratch.control[slot * M, k]
                if u[1] <= p.throttle_min and best > 0.5 * poor:
                    cost = probe(p, rk, curve, table, rate, slot, k, scratch)
                    slot = 1 - slot
                    worth = cost < PROBE_MARGIN * best
            if attempt == 2 and not best < limit:
                cost = lay_out(
                    p, rk, curve, table, start, rate, wp.where(laid == EARLY, CLOSE, EARLY), 0, k, scratch, control_out
                )
                slot = 0
                worth = True
            if worth:
                cost, slot, count = descend(p, rk, curve, table, rate, cost, slot, best, k, scratch)
                iterations += count
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

    cost_out[k] = best
    iterations_out[k] = iterations
    failed = not best < WORST
    begin[k] = wp.where(failed, EARLY, SHIFT)
    if failed:
        for i in range(M):
            control_out[k, i, 0] = 0.0
            control_out[k, i, 1] = p.throttle_min
        for i in range(M + 1):
            for j in range(5):
                trajectory_out[k, i, j] = wp.where(wp.isfinite(start[j]), start[j], 0.0)


solve_lissajous = wp.overload(solve, {"curve": CurveStruct})
"""The kernel for a Lissajous curve; `baselines.mpcc.solver` has that for curves of harmonics."""
