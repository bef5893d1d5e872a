"""Compilation of kernels: the compiler's options, and the compiled kernels on the disk.

A module with kernels calls `wp.set_module_options`, usually with OPTIONS. They also apply to all functions that its
kernels call, so a module of functions alone needs none.

Warp stores a compiled module in a folder of its cache. Where that folder cannot be used there is another one, and a
message says that kernels are compiled.
"""

import atexit
import functools
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import warp as wp

from lissajous_env.device.warp_abi import folder_of

# LLVM's own options, of which the compiler accepts one set at a time: where they differ, modules wait for each other.
# The last one concerns the vectoriser of straight-line code, so it has no effect where that is left out.
_LLVM = "-mllvm=-inline-threshold=9000 -mllvm=-inline-cold-callsite-threshold=3000 -mllvm=-slp-recursion-max-depth=4"

OPTIONS: dict[str, Any] = {
    "enable_backward": False,
    # Loops of constant length stay loops: unrolled, the largest kernel would take ten times as long to compile.
    "max_unroll": 1,
    # Warp's own flags but for the vectoriser of straight-line code, which makes the motion of a car a quarter slower.
    "cpu_compiler_flags": f"-march=native -fno-slp-vectorize {_LLVM}",
}

# For motion, where it is worth a tenth of the whole step: the compiler may reorder sums and multiply by reciprocals. It
# does so when it compiles, for every world alike, so the results on one machine are still the same, bit for bit.
MOTION = OPTIONS | {
    "cpu_compiler_flags": OPTIONS["cpu_compiler_flags"] + " -mreassociate -fno-signed-zeros -freciprocal-math"
}

# For the contouring controller, Warp's own flags and one more: fused multiply-adds shorten its chains of dependent
# operations by a tenth.
CONTRACTED = OPTIONS | {"cpu_compiler_flags": f"-march=native {_LLVM} -ffp-contract=fast"}


def module_apart(name: str, options: dict[str, Any]) -> Any:
    """Return a module of its own for kernels that few scenarios need, so that only these compile it."""
    module = wp.get_module(name)
    module.options.update(options)
    return module


OWN_PACKAGES = ("lissajous_env", "baselines", "training")
"""Packages of this distribution."""

listener: Callable[[str], None] | None = None
"""Function that receives one-line messages for the user, such as that kernels are compiled; the command line prints
them."""


def load_together(kernels: Iterable[Any], device: Any, threads: int) -> None:
    """Compile or load the modules of some kernels side by side, with a message if one is not in the cache.

    The caller does it under `lissajous_env.device.devices.compile_quietly`.
    """
    new = [module for module in {kernel.module: None for kernel in kernels} if (module, str(device)) not in _loaded]
    for module in new:
        if module.name.partition(".")[0] not in OWN_PACKAGES:
            module.mark_modified()  # its user may have loaded it outside of `compile_quietly`, with a stack for tiles
    cache = str(wp.config.kernel_cache_dir)
    folders = [folder_of(module, 1 if device.is_cpu else None) for module in new]
    if any(not Path(cache, folder).is_dir() for folder in folders):
        try:
            tempfile.TemporaryFile(dir=cache).close()
        except OSError as error:
            use_temporary_cache(str(error.strerror))
        _report("compiling kernels, once: 10 to 30 s")
    if new:
        wp.force_load(device, new, max_workers=threads)
    _loaded.update((module, str(device)) for module in new)


_loaded: set[tuple[Any, str]] = set()
"""Modules that were loaded on a device."""


def use_temporary_cache(reason: str) -> None:
    """Let Warp store compiled kernels in a temporary folder, which is removed when the process ends."""
    where, made_by = wp.config.kernel_cache_dir or "the cache of Warp", os.getpid()
    folder = tempfile.mkdtemp(prefix="lissajous-kernels-")
    wp.config.kernel_cache_dir = folder
    # A process that was forked off has the same list of things to do at its end.
    atexit.register(lambda: shutil.rmtree(folder, ignore_errors=True) if os.getpid() == made_by else None)
    _report(
        f"{where} cannot be written to ({reason}): kernels are compiled for this run alone; "
        "WARP_CACHE_PATH names another folder"
    )


@functools.cache
def _report(words: str) -> None:
    """Pass a message to the listener, once."""
    if listener is not None:
        listener(words)
