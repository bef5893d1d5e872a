"""Selection of worlds by indices or mask."""

import numpy as np
import pytest

from lissajous_env.world.selection import chosen_worlds, world_mask


@pytest.mark.parametrize(
    ("worlds", "expected"),
    [
        (None, [True, True, True, True]),
        ([], [False, False, False, False]),
        ([2, 0], [True, False, True, False]),
        (3, [False, False, False, True]),
        ([False, True, False, True], [False, True, False, True]),
    ],
)
def test_a_mask_holds_the_worlds_that_are_meant(worlds, expected):
    # Oracle: by hand; the indices of the mask are those that are chosen.
    mask = world_mask(worlds, 4)
    assert mask.dtype == bool
    assert mask.tolist() == expected
    np.testing.assert_array_equal(np.flatnonzero(mask), np.sort(chosen_worlds(worlds, 4)))
