"""Atomic operations for kernels whose entities CPU threads share: Warp's own are atomic on a GPU alone.

Sums of whole numbers and smallest values do not depend on the order of the threads.
"""

import warp as wp


def _atomic(on_gpu: str, on_cpu: str) -> str:
    return f"#if defined(__CUDA_ARCH__)\n    {on_gpu};\n#else\n    {on_cpu};\n#endif\n"


_ADD = _atomic(
    "return wp::atomic_add(values, w, more)",
    "return __atomic_fetch_add(&wp::index(values, w), more, __ATOMIC_RELAXED)",
)
_ADD_FOR = _atomic(
    "wp::atomic_add(values, w, i, more)", "__atomic_fetch_add(&wp::index(values, w, i), more, __ATOMIC_RELAXED)"
)
_EXCHANGE = _atomic(
    "return wp::atomic_exch(values, w, i, value)",
    "return __atomic_exchange_n(&wp::index(values, w, i), value, __ATOMIC_RELAXED)",
)
# Floats that are not negative are in the order of their bits.
_LOWER = _atomic(
    "wp::atomic_min(values, w, value)",
    "__atomic_fetch_min((int*)&wp::index(values, w), __builtin_bit_cast(int, value), __ATOMIC_RELAXED)",
)


@wp.func_native(_ADD)
def add(values: wp.array(dtype=wp.int32), w: int, more: int) -> int:
    """Add to the value of a world; return what it was."""
    ...


@wp.func_native(_ADD)
def add_long(values: wp.array(dtype=wp.int64), w: int, more: wp.int64) -> wp.int64:
    """Add to the value of a world; return what it was."""
    ...


@wp.func_native(_ADD_FOR)
def add_for(values: wp.array2d(dtype=wp.int32), w: int, i: int, more: int):
    """Add to the value of an entity."""


@wp.func_native(_EXCHANGE)
def exchange(values: wp.array2d(dtype=wp.int32), w: int, i: int, value: int) -> int:
    """Set the value of an entity; return what it was."""
    ...


@wp.func_native(_LOWER)
def lower(values: wp.array(dtype=wp.float32), w: int, value: float):
    """Lower the value of a world, at least 0, to this one."""
