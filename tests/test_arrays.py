"""Small algebra that many rooms share."""

from __future__ import annotations

import numpy as np

from rbd.arrays import largest_first


def test_equal_numbers_keep_their_order_whatever_their_rounding():
    """A plateau with noise of 1e-12 is in the order of its indices; what is larger comes before, what is less behind."""
    rng = np.random.default_rng(0)
    plateau = 3.0 + 1e-12 * rng.normal(size=50)
    values = np.concatenate([[1.0], plateau, [7.0, 3.0 + 1e-4, 3.0 - 1e-4]])
    assert largest_first(values).tolist() == [51, 52, *range(1, 51), 53, 0]


def test_the_largest_of_what_is_not_finite():
    """Infinite sizes come first, in their order, and NaN last."""
    assert largest_first([1.0, np.inf, np.nan, 2.0, np.inf]).tolist() == [1, 4, 3, 0, 2]
    assert largest_first([np.inf, np.nan, np.inf]).tolist() == [0, 2, 1]
    assert largest_first([]).tolist() == [] and largest_first([0.0, 0.0]).tolist() == [0, 1]
