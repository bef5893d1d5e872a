"""The quadratic functions that the backward sweep of the contouring controller passes from stage to stage."""

import warp as wp

from baselines.mpcc.model import Frame, MpccStruct, Stage, vec5


@wp.struct
class Quadratic:
    """A quadratic function of the state, s.z + z.V z / 2; the rows of the symmetric V begin at its diagonal."""

    s: vec5
    x: vec5
    y: wp.vec4
    heading: wp.vec3
    speed: wp.vec2
    gamma: float


@wp.func
def times(q: Quadratic, u: vec5) -> vec5:
    """Return V u."""
    return vec5(
        q.x[0] * u[0] + q.x[1] * u[1] + q.x[2] * u[2] + q.x[3] * u[3] + q.x[4] * u[4],
        q.x[1] * u[0] + q.y[0] * u[1] + q.y[1] * u[2] + q.y[2] * u[3] + q.y[3] * u[4],
        q.x[2] * u[0] + q.y[1] * u[1] + q.heading[0] * u[2] + q.heading[1] * u[3] + q.heading[2] * u[4],
        q.x[3] * u[0] + q.y[2] * u[1] + q.heading[1] * u[2] + q.speed[0] * u[3] + q.speed[1] * u[4],
        q.x[4] * u[0] + q.y[3] * u[1] + q.heading[2] * u[2] + q.speed[1] * u[3] + q.gamma * u[4],
    )


@wp.func
def times3(q: Quadratic, u: wp.vec3) -> vec5:
    """Return V (u, 0, 0)."""
    return vec5(
        q.x[0] * u[0] + q.x[1] * u[1] + q.x[2] * u[2],
        q.x[1] * u[0] + q.y[0] * u[1] + q.y[1] * u[2],
        q.x[2] * u[0] + q.y[1] * u[1] + q.heading[0] * u[2],
        q.x[3] * u[0] + q.y[2] * u[1] + q.heading[1] * u[2],
        q.x[4] * u[0] + q.y[3] * u[1] + q.heading[2] * u[2],
    )


@wp.func
def transposed(stage: Stage, v: vec5) -> vec5:
    """Return A^T v, where A is the stage's derivative by its state."""
    h = stage.by_heading
    return vec5(v[0], v[1], h[0] * v[0] + h[1] * v[1] + v[2], wp.dot(stage.by_speed, v), stage.by_gamma * v[4])


@wp.func
def pulled_back(q: Quadratic, stage: Stage) -> Quadratic:
    """Return A^T s and A^T V A: the same function, of the stage's start."""
    h = stage.by_heading
    by_heading = times3(q, wp.vec3(h[0], h[1], 1.0))
    by_speed = transposed(stage, times(q, stage.by_speed))
    g = stage.by_gamma
    r = Quadratic()
    r.s = transposed(stage, q.s)
    r.x = vec5(q.x[0], q.x[1], by_heading[0], by_speed[0], g * q.x[4])
    r.y = wp.vec4(q.y[0], by_heading[1], by_speed[1], g * q.y[3])
    r.heading = wp.vec3(h[0] * by_heading[0] + h[1] * by_heading[1] + by_heading[2], by_speed[2], g * by_heading[4])
    r.speed = wp.vec2(by_speed[3], by_speed[4])
    r.gamma = g * g * q.gamma
    return r


@wp.func
def add_outer(q: Quadratic, u: vec5, w: vec5) -> Quadratic:
    """Return V + u w^T, where u w^T is one term of a symmetric sum."""
    r = Quadratic()
    r.s = q.s
    r.x = q.x + u[0] * w
    r.y = q.y + u[1] * wp.vec4(w[1], w[2], w[3], w[4])
    r.heading = q.heading + u[2] * wp.vec3(w[2], w[3], w[4])
    r.speed = q.speed + u[3] * wp.vec2(w[3], w[4])
    r.gamma = q.gamma + u[4] * w[4]
    return r


@wp.func
def add_state_cost(p: MpccStruct, frame: Frame, state: vec5, errors: wp.vec3, q: Quadratic) -> Quadratic:
    """Add the gradient and the Gauss-Newton Hessian of `state_cost`."""
    t = frame.tangent
    # e_rate by speed and gamma; lag and lateral error by x, y and gamma
    rate_v = -frame.inverse
    rate_g = -state[3] * frame.slope
    lag_g = frame.turn * errors[2] - 1.0 / frame.inverse
    lat_g = -frame.turn * errors[1]
    wr = 2.0 * errors[0]
    wlag = 2.0 * p.weight_lag
    wlat = 2.0 * p.weight_lateral
    lag = wlag * errors[1]
    lat = wlat * errors[2]
    r = Quadratic()
    r.s = q.s + vec5(
        lag * t[0] - lat * t[1], lag * t[1] + lat * t[0], 0.0, wr * rate_v, wr * rate_g + lag * lag_g + lat * lat_g
    )
    r.x = q.x + vec5(
        wlag * t[0] * t[0] + wlat * t[1] * t[1],
        (wlag - wlat) * t[0] * t[1],
        0.0,
        0.0,
        wlag * lag_g * t[0] - wlat * lat_g * t[1],
    )
    r.y = q.y + wp.vec4(wlag * t[1] * t[1] + wlat * t[0] * t[0], 0.0, 0.0, wlag * lag_g * t[1] + wlat * lat_g * t[0])
    r.heading = q.heading
    r.speed = q.speed + 2.0 * rate_v * wp.vec2(rate_v, rate_g)
    r.gamma = q.gamma + 2.0 * rate_g * rate_g + wlag * lag_g * lag_g + wlat * lat_g * lat_g
    return r


@wp.func
def box_step(h11: float, h12: float, h22: float, g: wp.vec2, low: wp.vec2, high: wp.vec2) -> wp.vec2:
    """Minimise g.u + u.H u / 2 over low <= u <= high.

    A bound that the free minimum violates is active at the bounded minimum; if two are violated, the better edge is
    returned.
    """
    inverse = 1.0 / (h11 * h22 - h12 * h12)
    free = wp.vec2((h12 * g[1] - h22 * g[0]) * inverse, (h12 * g[0] - h11 * g[1]) * inverse)
    clamped = wp.vec2(wp.clamp(free[0], low[0], high[0]), wp.clamp(free[1], low[1], high[1]))
    if clamped[0] == free[0] and clamped[1] == free[1]:
        return free
    on0 = wp.vec2(clamped[0], wp.clamp(-(g[1] + h12 * clamped[0]) / h22, low[1], high[1]))
    on1 = wp.vec2(wp.clamp(-(g[0] + h12 * clamped[1]) / h11, low[0], high[0]), clamped[1])
    q0 = wp.dot(g, on0) + 0.5 * (h11 * on0[0] * on0[0] + h22 * on0[1] * on0[1]) + h12 * on0[0] * on0[1]
    q1 = wp.dot(g, on1) + 0.5 * (h11 * on1[0] * on1[0] + h22 * on1[1] * on1[1]) + h12 * on1[0] * on1[1]
    take0 = clamped[0] != free[0] and (clamped[1] == free[1] or q0 <= q1)
    return wp.where(take0, on0, on1)
