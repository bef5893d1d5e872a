"""`cos_sin` and `atan2` against float64 NumPy."""

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.trig import atan2, cos_sin

wp.set_module_options(OPTIONS)


@wp.kernel
def cos_sin_of(angle: wp.array(dtype=float), out: wp.array(dtype=wp.vec2)):
    out[wp.tid()] = cos_sin(angle[wp.tid()])


def on_device(angles):
    angles = np.asarray(angles, dtype=np.float32)
    out = wp.empty(len(angles), dtype=wp.vec2, device="cpu")
    wp.launch(cos_sin_of, dim=len(angles), inputs=[wp.array(angles, dtype=float, device="cpu"), out], device="cpu")
    return out.numpy(), angles.astype(np.float64)


def test_it_is_cosine_and_sine_up_to_ten_thousand_radians():
    # Oracle: NumPy in float64, of the very float32 angle. The bound is that of the docstring.
    spread = np.linspace(-1e4, 1e4, 1_000_001)
    quarters = np.arange(-6000, 6001) * np.pi / 2
    close = np.concatenate([quarters + shift for shift in (-1e-3, -1e-6, 0, 1e-6, 1e-3)])
    eighths = np.arange(-12000, 12001) * np.pi / 4
    got, angles = on_device(np.concatenate([spread, close, eighths, np.linspace(-7, 7, 100_001)]))
    expected = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    assert np.abs(got - expected).max() < 2e-7


def test_the_axes_are_exact_and_nothing_is_above_one():
    # Oracle: the definition; an observation of 1.0000001 would lie outside its space.
    got, _ = on_device([0.0, -0.0])
    assert got.tolist() == [[1, 0], [1, 0]]
    got, _ = on_device(np.linspace(-100, 100, 2_000_001))
    assert np.abs(got).max() <= 1


@wp.kernel
def angles_of(place: wp.array(dtype=wp.vec2), out: wp.array(dtype=float)):
    out[wp.tid()] = atan2(place[wp.tid()][1], place[wp.tid()][0])


def test_it_is_the_angle_of_a_place_near_and_far():
    # Oracle: NumPy in float64, of the very float32 places. The bound is that of the docstring.
    rng = np.random.default_rng(0)
    turn, size = rng.uniform(-np.pi, np.pi, 300_000), 10 ** rng.uniform(-12, 12, 300_000)
    axes = [[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [-1, -1], [1, -1], [0, 0]]
    places = np.concatenate([np.stack([np.cos(turn), np.sin(turn)], axis=-1) * size[:, None], axes]).astype(np.float32)
    out = wp.empty(len(places), dtype=float, device="cpu")
    wp.launch(angles_of, dim=len(places), inputs=[wp.array(places, dtype=wp.vec2, device="cpu"), out], device="cpu")
    expected = np.arctan2(places[:, 1].astype(np.float64), places[:, 0].astype(np.float64))
    assert np.abs(out.numpy() - expected).max() < 4e-7
