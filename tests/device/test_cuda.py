"""Kernels on CUDA: compiled everywhere, and compared with the CPU if there is a device."""

import importlib
import pkgutil
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp

import baselines
import lissajous_env
import training
from baselines.policies.registry import describe
from lissajous_env.device.devices import as_device, compile_quietly

EXTRAS = {"torch", "stable_baselines3", "torchrl", "benchmarl", "tensordict", "ray", "tensorboard", "rclpy"}


def imported(name):
    """A module; None where it is of an extra that is not there."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        without = error.__cause__ if isinstance(error.__cause__, ImportError) else error
        if (without.name or "").partition(".")[0] not in EXTRAS:
            raise
        return None


def modules_with_kernels():
    """Warp modules with their kernels, by their names; a Python module of an extra that is not there has none."""
    modules = {}
    for package in (lissajous_env, baselines, training):
        for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            module = None if info.name.endswith("__main__") else imported(info.name)
            for kernel in [] if module is None else vars(module).values():
                if isinstance(kernel, wp.Kernel) and kernel.module.name == info.name:
                    modules.setdefault(info.name, []).append(kernel)
    return modules


KERNELS = modules_with_kernels()


def test_no_kernel_is_written_where_the_next_test_does_not_look():
    # Oracle: the source. Each file that says @wp.kernel, wp.Kernel( or stage() is one of those that are compiled below.
    written = set()
    for package in (lissajous_env, baselines, training):
        root = Path(package.__path__[0])
        for path in root.rglob("*.py"):
            if re.search(
                r"^ *@(?:wp\.kernel|stage\()|= stage\(|wp\.Kernel\(", path.read_text(encoding="utf-8"), re.MULTILINE
            ):
                written.add(".".join([root.name, *path.relative_to(root).with_suffix("").parts]))
    compiled = {name for name in KERNELS if name in sys.modules}
    assert compiled == {name for name in written if imported(name) is not None}


NATIVE = ("contamination.field", "coverage", "robots.car", "targets.detection")
"""Modules of the world whose functions in C++ differ between CPU and GPU."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name.endswith(NATIVE) else pytest.mark.long) for name in KERNELS]
)
def test_every_kernel_compiles_for_cuda(name, tmp_path):
    """Oracle: NVIDIA's own compiler, which Warp carries; it needs no device."""
    as_device("cpu")
    with compile_quietly():
        wp.compile_aot_module(KERNELS[name][0].module, arch=90, module_dir=tmp_path, use_ptx=True)
    (compiled,) = tmp_path.glob("*.ptx")
    entries = [line for line in compiled.read_text().splitlines() if ".entry" in line]
    missing = [kernel.key for kernel in KERNELS[name] if not any(f" {kernel.key}_" in entry for entry in entries)]
    assert entries
    assert missing == []


needs_cuda = pytest.mark.skipif(not wp.is_cuda_available(), reason="needs a CUDA device")


@needs_cuda
@pytest.mark.parametrize("name", lissajous_env.scenarios())
def test_cuda_agrees_with_the_cpu(name):
    """Oracle: the CPU, over 50 steps of the same actions, to a millimetre; rounding differs, so they part later."""
    cpu, cuda = (lissajous_env.Simulation(name, num_worlds=8, device=device) for device in ("cpu", "cuda"))
    rng, action = np.random.default_rng(0), np.zeros(cpu.action_shape)
    for _ in range(50):
        action = 0.9 * action + rng.normal(0.0, 0.3, cpu.action_shape)
        cpu.step(action)
        cuda.step(action)
    np.testing.assert_allclose(cuda.robots.position.numpy(), cpu.robots.position.numpy(), atol=1e-3)
    # A target at the edge of a range is observed on one of them alone.
    assert np.mean(np.abs(cuda.observation.numpy() - cpu.observation.numpy()) > 5e-3) < 1e-4


@needs_cuda
@pytest.mark.parametrize("name", baselines.names())
def test_policies_act_on_cuda_as_on_the_cpu(name):
    """Oracle: the CPU, which receives the same observations; a solver stops an iteration earlier here and there."""
    scenario = next(
        task for task in (*describe(name)["made_for"], *lissajous_env.scenarios()) if name in baselines.names(task)
    )
    simulation = lissajous_env.Simulation(scenario, num_worlds=8, device="cuda")
    on_cpu, on_cuda = (baselines.make(name, scenario, 8, device) for device in ("cpu", "cuda"))
    differ = []
    for _ in range(20):
        action = on_cuda.act(simulation.observation)
        expected = on_cpu.act(wp.array(simulation.observation.numpy(), dtype=wp.float32, device="cpu"))
        differ.append((np.abs(action.numpy() - expected.numpy()) > 0.01).any(axis=-1))
        simulation.step(action)
    assert np.mean(differ) < 0.01
