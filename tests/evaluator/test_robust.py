"""Middles of values are those of NumPy, to the last digit."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.robust import median_of_rows, quantile_of_rows


@pytest.mark.parametrize("shape", [(1, 3), (2, 3), (5,), (6, 29, 2), (7, 2)])
def test_median_over_rows_is_that_of_numpy(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(len(shape)).normal(size=shape) * 1e3
    np.testing.assert_array_equal(median_of_rows(values), np.median(values, axis=0))
    np.testing.assert_array_equal(median_of_rows(list(np.round(values))), np.median(np.round(values), axis=0))


@pytest.mark.parametrize("rows", [1, 2, 3, 11, 12, 21, 28, 100, 599])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.95, 1.0])
def test_quantile_over_rows_is_that_of_numpy(rows: int, share: float) -> None:
    values = np.random.default_rng(rows).normal(size=(rows, 2)) ** 3
    np.testing.assert_array_equal(quantile_of_rows(values, share), np.quantile(values, share, axis=0))
