"""Undocumented parts of Warp that `lissajous_env.device.warp_abi` uses; a failed test names the one that broke."""

import numpy as np
import pytest
import warp as wp

from lissajous_env.device import warp_abi
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.program import launcher


@wp.struct
class Pair:
    factor: wp.float32
    values: wp.array(dtype=wp.float32)


@wp.kernel
def scale(pair: Pair, power: float, scaled_out: wp.array(dtype=float)):
    k = wp.tid()
    scaled_out[k] = wp.pow(pair.factor, power) * pair.values[k]


@pytest.fixture
def pair():
    as_device("cpu")
    filled = Pair()
    filled.factor, filled.values = 2.0, wp.array([1.0, 2.0, 3.0], dtype=wp.float32, device="cpu")
    return filled


def test_a_kernel_has_names_of_arguments():
    assert warp_abi.names_of_arguments(scale) == ["pair", "power", "scaled_out"]


def test_a_struct_has_a_name_fields_and_bytes(pair):
    assert warp_abi.is_struct(pair)
    assert not warp_abi.is_struct(pair.values)
    assert list(warp_abi.fields_of(pair)) == ["factor", "values"]
    values = warp_abi.variables_of(Pair)["values"].type
    assert (values.dtype, values.ndim) == (wp.float32, 1)
    before = warp_abi.content_of(pair)
    pair.factor = 3.0
    assert warp_abi.content_of(pair) != before


def test_a_recorded_launch_has_the_function_and_its_arguments(pair):
    # Oracle: what Warp's own launch writes, and a graph that a user captures meanwhile: the call is no part of it.
    out = wp.zeros(3, dtype=wp.float32, device="cpu")
    with compile_quietly():
        recorded = wp.launch(scale, 3, [pair, 2.0], outputs=[out], device="cpu", record_cmd=True)
    call = warp_abi.Call(recorded)
    with wp.ScopedCapture("cpu") as capture:
        call()
    assert out.numpy().tolist() == [4.0, 8.0, 12.0]
    out.zero_()
    wp.capture_launch(capture.graph)
    assert not out.numpy().any()


def test_a_module_has_a_folder_in_the_cache():
    with compile_quietly():
        scale.module.load(wp.get_device("cpu"), 1)
    name = warp_abi.folder_of(scale.module, 1)
    assert name.startswith("wp_")


def test_a_struct_that_changes_between_two_launches_is_taken_as_it_is(pair):
    # Story: a policy launches its kernel with the same arguments, of which one has a new field value, then an array.
    # A user may capture it in a graph.
    out, launch = wp.zeros(3, dtype=wp.float32, device="cpu"), launcher("cpu")
    arguments = scale, 3, [pair, 1.0], [out]
    with compile_quietly():
        launch(*arguments)
    assert out.numpy().tolist() == [2.0, 4.0, 6.0]
    pair.factor = 10.0
    launch(*arguments)
    assert out.numpy().tolist() == [10.0, 20.0, 30.0]
    pair.values = wp.array(np.float32([7, 8, 9]), device="cpu")
    launch(*arguments)
    assert out.numpy().tolist() == [70.0, 80.0, 90.0]
    with wp.ScopedCapture("cpu") as capture:
        launch(*arguments)
    out.zero_()
    wp.capture_launch(capture.graph)
    assert out.numpy().tolist() == [70.0, 80.0, 90.0]
