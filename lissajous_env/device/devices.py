"""Devices: names, memory, copies to them, and silence while Warp starts and compiles."""

import contextlib
import os
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device import compilation
from lissajous_env.device.locks import COMPILING
from lissajous_env.wording import require, shown


def as_device(device: Any) -> Any:
    """Return the Warp device of a name such as `cpu`, `cuda` or `cuda:1`.

    Raises:
        ValueError: there is no such device.
    """
    _start()
    there = ", ".join(map(str, wp.get_devices()))
    rule = f"device must be one of those present ({there}), got {shown(device)}"
    # For None, Warp would select a device itself, and print errors of its own if there is no driver.
    if device is None or (str(device).startswith("cuda") and not wp.is_cuda_available()):
        raise ValueError(rule if device is None else f"{rule}; Warp has found no CUDA driver and GPU that it can use")
    try:
        return wp.get_device(device)
    except Exception as error:
        raise ValueError(rule) from error


_CONTAINER = Path("/sys/fs/cgroup")
_QUOTAS = ("cpu.max",), ("cpu/cpu.cfs_quota_us", "cpu/cpu.cfs_period_us")
"""Files, of both versions of cgroups, with the processor time of a container in a period, and the period."""


def cores() -> int:
    """Return the number of cores that this process may use, by its affinity and its container's quota."""
    bound = len(os.sched_getaffinity(0))
    for files in _QUOTAS:
        with contextlib.suppress(OSError, ValueError):  # no container, or one without a limit
            quota, period = " ".join((_CONTAINER / file).read_text() for file in files).split()
            if int(quota) > 0:
                return max(1, min(bound, -(-int(quota) // int(period))))
    return bound


def memory() -> int:
    """Return the size of the machine's memory [bytes]."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def check_room(sizes: Sequence[int], num_worlds: int, device: Any) -> None:
    """Refuse arrays of these sizes per world [bytes] that exceed the memory.

    Raises:
        ValueError: the arrays of `num_worlds` worlds do not fit on the device, or one world not into an array.
    """
    room = memory() if device.is_cpu else device.total_memory
    need = f"{sum(sizes) / 2**20:.3g} MiB a world"
    if max(sizes) >= 2**31:  # Warp counts the bytes of a world in an array by 32 bits
        raise ValueError(f"scenario must need less than 2048 MiB in an array of a world (grid, robots), got {need}")
    rule = f"must fit into the memory of {device}, {room / 2**20:.0f} MiB, at {need}"
    require(sum(sizes) * num_worlds <= room, "num_worlds", rule, num_worlds)


def copy_in(name: str, value: Any, target: Any) -> None:
    """Copy a NumPy array, torch tensor or Warp array of numbers into a Warp array of float32.

    Raises:
        ValueError: the value has another shape than the target, or does not contain real numbers.
    """
    if is_torch(value):
        if value.is_complex() or str(value.dtype) == "torch.bool":
            raise ValueError(f"{name} must contain real numbers, got {value.dtype}")
        value = wp.from_torch(value.detach().float().contiguous())
    elif isinstance(value, wp.array):
        if value.dtype is not wp.float32:
            raise ValueError(f"{name} must contain float32 if it is a Warp array, got {value.dtype.__name__}")
    else:
        value = as_floats(name, value)
    if tuple(value.shape) != tuple(target.shape):
        raise ValueError(f"{name} must have shape {tuple(target.shape)}, got {tuple(value.shape)}")
    if isinstance(value, wp.array):
        wp.copy(target, value)
    elif target.device.is_cpu:
        target.numpy()[...] = value
    else:
        target.assign(value)


def as_floats(name: str, value: Any) -> np.ndarray:
    """Return an array or nested lists of numbers as float32; numbers beyond its range become infinite.

    Raises:
        ValueError: the value does not contain real numbers.
    """
    try:
        array = np.asarray(value)
    except ValueError as error:  # rows of different lengths
        raise ValueError(f"{name} must contain real numbers, got rows of different lengths") from error
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name} must contain real numbers, got {array.dtype} {shown(value)}")
    with np.errstate(over="ignore"):
        return np.asarray(array, dtype=np.float32, order="C")


def is_torch(value: Any) -> bool:
    """Return whether a value is a torch tensor; torch need not be installed."""
    return type(value).__module__.partition(".")[0] == "torch"


@contextlib.contextmanager
def compile_quietly() -> Iterator[None]:
    """Let Warp compile or load kernels without its banner and a line for each module, while other threads load none.

    Kernels are compiled without the 256 KiB of stack that Warp reserves for tiles, which no stage uses.
    """
    with COMPILING:
        level, tiles = wp.config.log_level, wp.config.enable_tiles_in_stack_memory
        wp.config.log_level = max(level, wp.LOG_ERROR)
        wp.config.enable_tiles_in_stack_memory = None  # none, on processors that work without
        try:
            yield
        finally:
            wp.config.log_level, wp.config.enable_tiles_in_stack_memory = level, tiles


@cache
def _start() -> None:
    """Start Warp silently, with a temporary cache where it cannot write to its own."""
    with compile_quietly():
        try:
            with silent_stderr():
                wp.init()
        except OSError as error:
            compilation.use_temporary_cache(str(error.strerror))
            with silent_stderr():
                wp.init()


@contextlib.contextmanager
def silent_stderr() -> Iterator[None]:
    """Silence standard error of native code: Warp warns there on every machine without a CUDA driver."""
    try:
        descriptor = os.dup(2)
    except OSError:  # standard error is closed: nothing to keep silent
        yield
        return
    try:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(descriptor, 2)
        os.close(descriptor)
