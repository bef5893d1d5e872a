"""Robots side by side: loops that the compiler turns into SIMD instructions.

A stage with the parameter `block` iterates over the robots of all worlds in blocks of `width()`. Arrays are contiguous,
world first, then robot, so the kernel loads the values of a block at once (`floats` and the functions after it). It
computes in loops `for k in range(ABREAST)` whose iterations do not depend on each other, and stores the results
(`put_floats` and the functions after it) of the robots that have a bit in a mask, by which robots of inactive worlds
are left out. The result of a robot does not depend on its position in a block, so a world does not depend on the worlds
beside it.

The compiler turns such a loop into SIMD only if it begins with `if k < width()` (on a GPU a thread processes one
robot), contains no early exit and no other loop, and branches only by `wp.where` and short conditions. The functions
that it calls must not have arguments of type `wp.vec2`, and the loop must read separate vectors, not fields of a
struct.
"""

from typing import Any

import warp as wp

ABREAST = wp.constant(16)
_LENGTH = int(ABREAST)

Floats = wp.types.vector(length=_LENGTH, dtype=wp.float32)
Doubles = wp.types.vector(length=_LENGTH, dtype=wp.float64)
Ints = wp.types.vector(length=_LENGTH, dtype=wp.int32)


@wp.func_native(f"""
#if defined(__CUDA_ARCH__)
    return 1;
#else
    return {_LENGTH};
#endif
""")
def width() -> int:
    """Return the number of robots that a thread works on together."""
    ...


def width_on(device: Any) -> int:
    """Return `width()` of a device, for the host."""
    return _LENGTH if device.is_cpu else 1


@wp.struct
class Block:
    """Robots of a thread, of consecutive worlds, as they lie in memory."""

    start: wp.int32
    """First of them, counted through all worlds."""
    count: wp.int32
    """Number of robots: `width()` at most."""
    active_mask: wp.int32
    """Bit of each robot that is in an active world."""


@wp.func
def where_world(block: Block, n: int, values: wp.array(dtype=wp.int32), least: int) -> int:
    """Return a bit for each robot of a block whose world, of `n` robots, has at least this value."""
    bits = int(0)
    w = int(block.start / n)
    before = int(0)
    beyond = n - (block.start - w * n)
    while before < block.count:
        if values[w] >= least:
            bits |= ((1 << wp.min(beyond, block.count)) - 1) & ~((1 << before) - 1)
        before = beyond
        beyond += n
        w += 1
    return bits


@wp.func
def block_of(thread: int, begin: int, end: int, n: int, active: wp.array(dtype=wp.int32)) -> Block:
    """Return the block of a thread, of the robots `begin` to `end` - 1 of all worlds with `n` each."""
    block = Block()
    block.start = begin + thread * width()
    block.count = wp.min(width(), end - block.start)
    block.active_mask = where_world(block, n, active, 1)
    return block


@wp.func
def is_in(k: int, mask: int) -> bool:
    """Return whether robot k of a block has a bit in the mask."""
    return ((mask >> k) & 1) == 1


def _load(type: str, stride: str = "1", offset: str = "0") -> str:
    """Return C++ that loads one of `stride` numbers per robot, at an offset from those of the block's first robot."""
    return f"""
    wp::vec_t<{_LENGTH}, wp::{type}> loaded;
    const wp::{type}* const from = (wp::{type}*)values.data + {stride} * (long long)block.start + {offset};
    if (block.count == {_LENGTH})  // of constant length, so that it becomes SIMD
        for (int k = 0; k < {_LENGTH}; ++k)
            loaded[k] = from[{stride} * k];
    else
        for (int k = 0; k < block.count; ++k)
            loaded[k] = from[{stride} * k];
    return loaded;
"""


@wp.func_native(_load("float32"))
def floats(block: Block, values: wp.array2d(dtype=wp.float32)) -> Floats:
    """Return the values (W, N) of a block's robots."""
    ...


@wp.func_native(_load("float64"))
def doubles(block: Block, values: wp.array2d(dtype=wp.float64)) -> Doubles:
    """Return the values (W, N) of a block's robots."""
    ...


@wp.func_native(_load("float32", "3", "axis"))
def coordinates(block: Block, values: wp.array2d(dtype=wp.vec3), axis: int) -> Floats:
    """Return one coordinate of the vectors (W, N) of a block's robots."""
    ...


@wp.func_native(_load("float32", "values.shape[2]", "entry"))
def entries(block: Block, values: wp.array3d(dtype=wp.float32), entry: int) -> Floats:
    """Return one entry of the rows (W, N, entries) of a block's robots."""
    ...


@wp.func_native("""
    int bits = 0;
    const wp::int32* const from = values.data + block.start;
    for (int k = 0; k < block.count; ++k)
        bits |= (from[k] == value) << k;
    return bits;
""")
def where_equal(block: Block, values: wp.array2d(dtype=wp.int32), value: int) -> int:
    """Return a bit for each of a block's robots whose value (W, N) equals this one."""
    ...


@wp.func_native("""
    int bits = 0;
    for (int k = 0; k < block.count; ++k)
        bits |= (values[k] > least) << k;
    return bits;
""")
def where_above(block: Block, values: Floats, least: float) -> int:
    """Return a bit for each of a block's robots whose value is above this one."""
    ...


def _store(type: str, parts: tuple[str, ...], stride: str, offset: str = "0") -> str:
    """Return C++ that stores parts of `stride` numbers per robot, at an offset from those of the first robot."""
    store = " ".join(f"to[{stride} * k + {place}] = {part};" for place, part in enumerate(parts))
    return f"""
    wp::{type}* const to = (wp::{type}*)values.data + {stride} * (long long)block.start + {offset};
    if (mask == {(1 << _LENGTH) - 1})  // all of them, so that it becomes SIMD
        for (int k = 0; k < {_LENGTH}; ++k) {{
            {store}
        }}
    else
        for (int k = 0; k < block.count; ++k)
            if (mask >> k & 1) {{
                {store}
            }}
"""


@wp.func_native(_store("float32", ("given[k]",), "1"))
def put_floats(block: Block, mask: int, given: Floats, values: wp.array2d(dtype=wp.float32)):
    """Set the values (W, N) of the block's robots that have a bit."""


@wp.func_native(_store("float64", ("given[k]",), "1"))
def put_doubles(block: Block, mask: int, given: Doubles, values: wp.array2d(dtype=wp.float64)):
    """Set the values (W, N) of the block's robots that have a bit."""


@wp.func_native(_store("int32", ("bits >> k & 1",), "1"))
def put_bits(block: Block, mask: int, bits: int, values: wp.array2d(dtype=wp.int32)):
    """Set the values (W, N) of the block's robots that have a bit in `mask` to their bits in `bits`."""


@wp.func_native(_store("float32", ("given[k]",), "values.shape[2]", "entry"))
def put_entries(block: Block, mask: int, given: Floats, entry: int, values: wp.array3d(dtype=wp.float32)):
    """Set one entry of the rows (W, N, entries) of the block's robots that have a bit."""


@wp.func_native(_store("float32", ("x[k]", "y[k]"), "2"))
def put_pairs(block: Block, mask: int, x: Floats, y: Floats, values: wp.array2d(dtype=wp.vec2)):
    """Set the pairs (W, N) of the block's robots that have a bit."""


@wp.func_native(_store("float32", ("a[k]", "b[k]", "c[k]", "d[k]"), "4"))
def put_fours(block: Block, mask: int, a: Floats, b: Floats, c: Floats, d: Floats, values: wp.array2d(dtype=wp.vec4)):
    """Set the vectors (W, N) of the block's robots that have a bit."""


@wp.func_native(_store("float32", ("x[k]", "y[k]", "z[k]"), "3"))
def put_vectors(block: Block, mask: int, x: Floats, y: Floats, z: Floats, values: wp.array2d(dtype=wp.vec3)):
    """Set the vectors (W, N) of the block's robots that have a bit."""


@wp.func_native(_store("float32", ("x[k]", "y[k]", "0"), "3 * values.shape[2]", "3 * place"))
def put_places(block: Block, mask: int, x: Floats, y: Floats, place: int, values: wp.array3d(dtype=wp.vec3)):
    """Set one of the places (W, N, places) of the block's robots that have a bit, in the plane."""
