"""Middles of values are those of NumPy, to the last digit."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.robust import median_of_rows


@pytest.mark.parametrize("shape", [(1, 3), (2, 3), (5,), (6, 29, 2), (7, 2)])
def test_median_over_rows_is_that_of_numpy(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(len(shape)).normal(size=shape) * 1e3
    np.testing.assert_array_equal(median_of_rows(values), np.median(values, axis=0))
    np.testing.assert_array_equal(median_of_rows(list(np.round(values))), np.median(np.round(values), axis=0))
