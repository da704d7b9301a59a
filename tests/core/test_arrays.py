"""Arrays in the one layout that kernels take."""

from __future__ import annotations

import numpy as np
import pytest

from wavegym.core.arrays import for_kernel

WHOLE = np.arange(12.0).reshape(3, 4)


@pytest.mark.parametrize("given", [WHOLE.T, WHOLE[:, ::2], np.broadcast_to(WHOLE[0], (3, 4)), [[1, 2]]])
def test_another_layout_is_copied(given):
    made = for_kernel(given)
    assert made.flags.c_contiguous
    assert made.flags.writeable
    assert not np.shares_memory(made, WHOLE)
    np.testing.assert_array_equal(made, given)


def test_a_plain_array_stays_itself():
    assert for_kernel(WHOLE) is WHOLE
    assert for_kernel(WHOLE, np.int64).dtype == np.int64
