"""Devices: which are there, and what Warp says while it starts and compiles."""

import contextlib
import os
from collections.abc import Iterator
from typing import Any

import warp as wp


def as_device(device: Any) -> Any:
    """Return the Warp device of a name such as `cpu`, `cuda` or `cuda:1`.

    Raises:
        ValueError: there is no such device.
    """
    with compile_quietly(), _silent_stderr():
        wp.init()
    try:
        return wp.get_device(device)
    except Exception as error:
        there = ", ".join(str(each) for each in wp.get_devices())
        raise ValueError(f"device must be one of those present ({there}), got {device!r}") from error


@contextlib.contextmanager
def compile_quietly() -> Iterator[None]:
    """Keep Warp from printing its banner and a line for each module that it loads."""
    level = wp.config.log_level
    wp.config.log_level = max(level, wp.LOG_ERROR)
    try:
        yield
    finally:
        wp.config.log_level = level


@contextlib.contextmanager
def _silent_stderr() -> Iterator[None]:
    """Keep native code from writing to standard error: Warp warns there of every machine without a CUDA driver."""
    kept = os.dup(2)
    try:
        with open(os.devnull, "w") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
