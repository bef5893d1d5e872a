"""Robots side by side: loops that the compiler turns into SIMD instructions.

A kernel that takes `begin` and `end` without `first` goes over the robots of all worlds in a row, in blocks of
`width()`. It gathers what it needs of a block into `Floats`, works on these in loops `for k in range(ABREAST)` whose
passes do not depend on each other, and scatters the results. Each robot is worked on in the same way wherever it stands
in a block, so a world does not depend on those beside it.

For a loop to become SIMD its first question must be `if k < width()`, since a thread of a GPU has one robot alone, and
nothing in it may end early, loop, or choose by anything but `wp.where` and short branches; a function must not take a
`wp.vec2`, and what it goes over must be vectors of their own, not fields of a struct.
"""

from typing import Any

import warp as wp

from lissajous_env.device.compilation import OPTIONS

wp.set_module_options(OPTIONS)

ABREAST = wp.constant(16)

Floats = wp.types.vector(length=16, dtype=wp.float32)
Doubles = wp.types.vector(length=16, dtype=wp.float64)
Ints = wp.types.vector(length=16, dtype=wp.int32)


_ON_CPU = int(ABREAST)


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    return 1;
#else
    return {_ON_CPU};
#endif
""")
def width() -> int:
    """How many robots a thread works on together."""
    ...


def width_on(device: Any) -> int:
    """`width()` on a device, on the host."""
    return _ON_CPU if device.is_cpu else 1


@wp.struct
class Block:
    """The robots of a thread."""

    count: wp.int32
    """How many there are, of worlds that take part: `width()` at most."""
    world: Ints
    """World of each."""
    robot: Ints
    """Number of each in its world."""


@wp.func
def block_of(thread: int, begin: int, end: int, n: int, active: wp.array(dtype=wp.int32)) -> Block:
    """Block of a thread, of the robots `begin` to `end` - 1 of all worlds with `n` each, where these are active."""
    start = begin + thread * width()
    block = Block()
    w = int(start / n)
    i = int(start % n)
    for _ in range(wp.min(width(), end - start)):
        if active[w] == 1:
            block.world[block.count] = w
            block.robot[block.count] = i
            block.count += 1
        i += 1
        if i == n:
            i = 0
            w += 1
    return block
