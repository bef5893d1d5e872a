"""The same source on CUDA: compiled for it everywhere, and compared with the CPU where there is a device."""

import importlib

import numpy as np
import pytest
import warp as wp

import baselines
import lissajous_env
from lissajous_env.device import as_device, compile_quietly

DEVICE_CODE = (
    *(f"lissajous_env.{m}" for m in ("robot", "targets", "collision", "coverage", "tally", "observation")),
    *(
        f"baselines.{m}"
        for m in (
            "arc",
            "consensus",
            "coordinated",
            "kuramoto",
            "mpcc_kernel",
            "patrol",
            "safety_kernel",
            "tracked_reference",
            "vector_field",
        )
    ),
)


@pytest.mark.parametrize("name", DEVICE_CODE)
def test_every_kernel_compiles_for_cuda(name, tmp_path):
    """Oracle: NVIDIA's own compiler, which Warp carries; it needs no device."""
    as_device("cpu")
    with compile_quietly():
        wp.compile_aot_module(importlib.import_module(name), arch=90, module_dir=tmp_path, use_ptx=True)
    assert any(path.stat().st_size > 1000 for path in tmp_path.glob("*.ptx"))


@pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("name", ["experiment", "intruders", "failure"])
def test_cuda_agrees_with_the_cpu(name):
    """Oracle: the CPU, over 50 steps of one policy, to a millimetre; rounding differs, so they part later."""
    places = []
    for device in ("cpu", "cuda"):
        simulation = lissajous_env.Simulation(lissajous_env.scenario(name), num_worlds=8, device=device)
        policy = baselines.make("kuramoto" if name == "failure" else "kuramoto-mpcc", name, 8, device)
        for _ in range(50):
            simulation.step(policy.act(simulation.observation))
        places.append(simulation.robots.position.numpy())
    np.testing.assert_allclose(*places, atol=1e-3)
