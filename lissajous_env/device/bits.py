"""Bits of 64 columns of a row of a grid in one word, and the halves of such words."""

import warp as wp


@wp.func
def run_of_bits(word: int, low: int, high: int) -> wp.uint64:
    """Return the bits of columns low ... high in the word of columns 64 word ... 64 word + 63."""
    start = wp.max(low - 64 * word, 0)
    stop = wp.min(high - 64 * word, 63)
    if start > stop:
        return wp.uint64(0)
    return (~wp.uint64(0) >> wp.uint64(63 - (stop - start))) << wp.uint64(start)


@wp.func
def half_of(bits: wp.uint64, half: int) -> wp.uint32:
    """Return the lower 32 columns of a word if `half` is even, the upper ones if it is odd."""
    return wp.uint32(bits >> wp.uint64(32 * (half & 1)))


@wp.func
def lowest(bits: wp.uint32) -> int:
    """Place of the lowest bit that is set."""
    return int(wp.bit_count((bits & (~bits + wp.uint32(1))) - wp.uint32(1)))
