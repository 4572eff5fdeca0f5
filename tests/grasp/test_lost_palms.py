"""An even sample keeps few enough rows, spread over all of the stream, however it came."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpis_grasp_planner.grasp.lost_palms import EvenSample


def rows_of(numbers):
    return np.column_stack([numbers, np.zeros((len(numbers), 2))])


@given(sizes=st.lists(st.integers(0, 200), max_size=20), most=st.integers(1, 70))
def test_the_sample_is_every_nth_row_of_the_stream(sizes, most):
    sample, n = EvenSample(most), 0
    for size in sizes:
        sample.add(rows_of(np.arange(n, n + size)))
        n += size
    kept = sample.rows[:, 0].astype(int)
    assert len(kept) <= most
    assert n == 0 or len(kept) >= min(n, (most + 1) // 2)
    if len(kept) > 1:
        stride = kept[1] - kept[0]
        assert stride & (stride - 1) == 0  # a power of two
        np.testing.assert_array_equal(kept, np.arange(0, n, stride))


def test_nothing_is_no_rows():
    assert EvenSample().rows.shape == (0, 3)
