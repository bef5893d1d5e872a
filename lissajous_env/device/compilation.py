"""Compiler options of kernels; a module with kernels calls `wp.set_module_options`, usually with OPTIONS.

They also apply to all functions that its kernels call, so a module of functions alone needs none.
"""

from typing import Any

import warp as wp

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
