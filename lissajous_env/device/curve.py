"""The curve on the device: position, derivatives and the local projection of a point onto it.

It is the Lissajous curve or, with harmonics, any closed curve as a Fourier series.

Here gamma [rad] is the parameter of the curve; the phase theta of a robot that coordinates by (1) gives
gamma = alpha theta (Lemma 2).
"""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.stage import named_struct
from lissajous_env.device.structs import to_struct
from lissajous_env.device.trig import TWO_PI, cos_sin
from lissajous_env.settings.parts import Curve


@named_struct("curve")
class CurveStruct:
    """`Curve` on a device."""

    half_width: wp.float32
    """Half of the rectangle's width [m]."""
    half_height: wp.float32
    """Half of the rectangle's height [m]."""
    reach_x: wp.float32
    """Half of the width of the curve, A of (3): that of the rectangle without the inset [m]."""
    reach_y: wp.float32
    """Half of the height of the curve, B of (3) [m]."""
    a: wp.int32
    b: wp.int32
    """Frequencies of (3), along x and y."""
    half_depth: wp.float32
    """Half of the depth of the curve, C of (10) [m]; 0 in the plane."""
    c: wp.int32
    """Frequency of (10), along z."""
    harmonics: wp.array(dtype=wp.vec4)
    """(K,) cosine and sine of x, then of y [m]; empty for the Lissajous curve."""


def curve_struct(curve: Curve, device: Any) -> Any:
    """Copy the curve of a resolved scenario to a device."""
    filled: Any = to_struct(CurveStruct, curve)
    driven = curve.driven
    filled.reach_x, filled.reach_y = driven.half_width, driven.half_height
    rows = np.array(driven.harmonics, dtype=np.float32).reshape(-1, 4)
    filled.harmonics = wp.array(rows, dtype=wp.vec4, device=device)
    return filled


@wp.func
def into_rectangle(place: wp.vec2, curve: CurveStruct) -> wp.vec2:
    """Return the nearest place in the rectangle [m]."""
    x = wp.clamp(place[0], -curve.half_width, curve.half_width)
    return wp.vec2(x, wp.clamp(place[1], -curve.half_height, curve.half_height))


_TURNS_PER_RADIAN = wp.constant(0.15915494309189535)
_TWO_PI_64 = wp.constant(wp.float64(6.283185307179586))
_TURNS_PER_RADIAN_64 = wp.constant(wp.float64(0.15915494309189535))


@wp.func
def wrap_phase(phase: wp.float64) -> wp.float64:
    """Wrap a phase to [0, 2 pi) [rad]."""
    wrapped = phase - _TWO_PI_64 * wp.floor(phase * _TURNS_PER_RADIAN_64)
    return wp.where(wrapped >= _TWO_PI_64 or wrapped < wp.float64(0.0), wp.float64(0.0), wrapped)


@wp.func
def curve_parameter(alpha: float, phase: wp.float64) -> float:
    """Return gamma = alpha theta (Lemma 2), wrapped to one turn [rad].

    A phase is of double precision: alpha a, which is 4947 in `swarm`, multiplies its last bit.
    """
    return float(wrap_phase(wp.float64(alpha) * phase))


@wp.func
def wrap(angle: float) -> float:
    """Wrap an angle to [-pi, pi] [rad]."""
    return angle - TWO_PI * wp.floor(angle * _TURNS_PER_RADIAN + 0.5)


@wp.func
def series(curve: CurveStruct, gamma: float, order: int) -> wp.vec2:
    """Return the curve of the harmonics [m], or its first or second derivative [m/rad], [m/rad^2]."""
    total = wp.vec2(0.0, 0.0)
    for k in range(curve.harmonics.shape[0]):
        row = curve.harmonics[k]
        n = float(k + 1)
        turn = cos_sin(n * gamma)
        if order == 1:
            turn = n * wp.vec2(-turn[1], turn[0])
        elif order == 2:
            turn = -n * n * turn
        total += wp.vec2(row[0] * turn[0] + row[1] * turn[1], row[2] * turn[0] + row[3] * turn[1])
    return total


@wp.func
def lissajous(curve: CurveStruct, gamma: float) -> wp.vec2:
    """r = (A cos(a gamma), B sin(b gamma)) [m], equation (3)."""
    across = cos_sin(float(curve.a) * gamma)
    up = cos_sin(float(curve.b) * gamma)
    return wp.vec2(curve.reach_x * across[0], curve.reach_y * up[1])


@wp.func
def point2(curve: CurveStruct, gamma: float) -> wp.vec2:
    """r [m], equation (3) or that of the harmonics."""
    if curve.harmonics.shape[0] > 0:
        return series(curve, gamma, 0)
    return lissajous(curve, gamma)


@wp.func
def point(curve: CurveStruct, gamma: float) -> wp.vec3:
    """r = (A cos(a gamma), B sin(b gamma), C sin(c gamma)) [m], equations (3) and (10)."""
    plane = point2(curve, gamma)
    return wp.vec3(plane[0], plane[1], curve.half_depth * cos_sin(float(curve.c) * gamma)[1])


@wp.func
def tangent2(curve: CurveStruct, gamma: float) -> wp.vec2:
    """r' = (-A a sin(a gamma), B b cos(b gamma)) [m/rad]."""
    if curve.harmonics.shape[0] > 0:
        return series(curve, gamma, 1)
    a = float(curve.a)
    b = float(curve.b)
    return wp.vec2(-curve.reach_x * a * cos_sin(a * gamma)[1], curve.reach_y * b * cos_sin(b * gamma)[0])


@wp.func
def newton(away: wp.vec2, tangent: wp.vec2, bend: wp.vec2, gamma: float, largest_step: float) -> float:
    """Return gamma after one step of `project` towards a place at the offset `away` from the point at gamma [m]."""
    square = wp.dot(tangent, tangent)
    lag = wp.dot(tangent, away) / wp.max(square - wp.dot(bend, away), 0.5 * square)
    return gamma + wp.clamp(lag, -largest_step, largest_step)


@wp.func
def project_lissajous(curve: CurveStruct, x: float, y: float, gamma: float, largest_step: float) -> float:
    """Do what `project` does, on a Lissajous curve."""
    a = float(curve.a)
    b = float(curve.b)
    across = cos_sin(a * gamma)
    up = cos_sin(b * gamma)
    nearest = wp.vec2(curve.reach_x * across[0], curve.reach_y * up[1])
    tangent = wp.vec2(-curve.reach_x * a * across[1], curve.reach_y * b * up[0])
    bend = wp.vec2(-a * a * nearest[0], -b * b * nearest[1])
    return newton(wp.vec2(x, y) - nearest, tangent, bend, gamma, largest_step)


@wp.func
def project(curve: CurveStruct, position: wp.vec2, gamma: float, largest_step: float) -> float:
    """Move gamma by one Newton step towards the nearest point, where r'.(q - r) = 0, by at most `largest_step` [rad].

    The curve crosses itself, so the nearest point of the whole curve may lie on another branch; a robot carries its
    gamma and only ever corrects it locally. Beyond half of the radius of curvature the step is that of Gauss-Newton,
    doubled: there the second derivative vanishes and the nearest point is about to jump.
    """
    if curve.harmonics.shape[0] == 0:
        return project_lissajous(curve, position[0], position[1], gamma, largest_step)
    away = position - series(curve, gamma, 0)
    return newton(away, series(curve, gamma, 1), series(curve, gamma, 2), gamma, largest_step)
