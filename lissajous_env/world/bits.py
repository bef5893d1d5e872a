"""Bits of 32 columns of a row of a grid in one word."""

import warp as wp

from lissajous_env.device.compilation import OPTIONS

wp.set_module_options(OPTIONS)


@wp.func
def run_of_bits(word: int, low: int, high: int) -> wp.uint32:
    """Bits of columns low ... high that fall into the word with columns 32 word ... 32 word + 31."""
    start = wp.max(low - 32 * word, 0)
    stop = wp.min(high - 32 * word, 31)
    if start > stop:
        return wp.uint32(0)
    return (~wp.uint32(0) >> wp.uint32(31 - (stop - start))) << wp.uint32(start)


@wp.func
def lowest(bits: wp.uint32) -> int:
    """Place of the lowest bit that is set."""
    return int(wp.bit_count((bits & (~bits + wp.uint32(1))) - wp.uint32(1)))
