"""The curve that the contouring controller follows, with its derivatives: a Lissajous curve or one of harmonics."""

import warp as wp

from lissajous_env.device.curve import CurveStruct, lissajous, series
from lissajous_env.device.trig import cos_sin


@wp.struct
class Frame:
    """The curve at one gamma: r, its unit tangent, 1 / ||r'||, and d(1 / ||r'||) and d(direction of r') by d gamma."""

    point: wp.vec2
    tangent: wp.vec2
    inverse: float
    slope: float
    turn: float


@wp.struct
class Series:
    """A curve of harmonics, a type of its own: kernels are compiled for each kind of curve, whose rounding differs."""

    curve: CurveStruct


@wp.func
def frame_of(point: wp.vec2, first: wp.vec2, second: wp.vec2) -> Frame:
    """Return the frame at a point of the curve from its first and second derivative by gamma."""
    f = Frame()
    f.point = point
    f.inverse = 1.0 / wp.length(first)
    f.tangent = first * f.inverse
    f.slope = -wp.dot(f.tangent, second) * f.inverse * f.inverse
    f.turn = (f.tangent[0] * second[1] - f.tangent[1] * second[0]) * f.inverse
    return f


@wp.func
def frame_at(curve: CurveStruct, gamma: float) -> Frame:  # pyright: ignore[reportRedeclaration]
    """Evaluate the curve and how its tangent stretches and turns."""
    a = float(curve.a)
    b = float(curve.b)
    across = cos_sin(a * gamma)
    up = cos_sin(b * gamma)
    first = wp.vec2(-curve.reach_x * a * across[1], curve.reach_y * b * up[0])
    second = wp.vec2(-curve.reach_x * a * a * across[0], -curve.reach_y * b * b * up[1])
    return frame_of(wp.vec2(curve.reach_x * across[0], curve.reach_y * up[1]), first, second)


@wp.func
def frame_at(of: Series, gamma: float) -> Frame:  # noqa: F811
    """Evaluate a curve of harmonics and how its tangent stretches and turns."""
    return frame_of(series(of.curve, gamma, 0), series(of.curve, gamma, 1), series(of.curve, gamma, 2))


@wp.func
def place_at(curve: CurveStruct, gamma: float) -> wp.vec2:  # pyright: ignore[reportRedeclaration]
    """Return the place on the Lissajous curve [m]."""
    return lissajous(curve, gamma)


@wp.func
def place_at(of: Series, gamma: float) -> wp.vec2:  # noqa: F811
    """Return the place on a curve of harmonics [m]."""
    return series(of.curve, gamma, 0)


@wp.func
def oscillation_of(curve: CurveStruct) -> float:  # pyright: ignore[reportRedeclaration]
    """Return the change of gamma in an oscillation of the curve, divided by 2 pi [rad]."""
    return 1.0 / float(wp.max(curve.a, curve.b))


@wp.func
def oscillation_of(of: Series) -> float:  # noqa: F811
    """Return the same for the Lissajous curve that the harmonics stand for."""
    return 1.0 / float(wp.max(of.curve.a, of.curve.b))
