"""Middle and spread of values among which a few may be outliers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

PER_MEDIAN = 1.4826  # standard deviation of a normal distribution over its median absolute deviation: 1/Φ⁻¹(3/4)


def median_of_rows(values: ArrayLike) -> NDArray[np.float64]:
    """The median over the first axis of finite values, as of np.median, which takes ten times as long for few rows."""
    ordered = np.sort(np.asarray(values, dtype=float), axis=0)
    middle = len(ordered) // 2
    return np.asarray(ordered[middle] if len(ordered) % 2 else (ordered[middle - 1] + ordered[middle]) / 2)


def quantile_of_rows(values: ArrayLike, share: float) -> NDArray[np.float64]:
    """The quantile over the first axis of finite values, between two rows by a line, as of np.quantile but faster."""
    ordered = np.sort(np.asarray(values, dtype=float), axis=0)
    at = share * (len(ordered) - 1)
    low = int(at)
    first, second, part = ordered[low], ordered[min(low + 1, len(ordered) - 1)], at - low
    # from the nearer of the two, as NumPy does, so that the last digit is the same
    if part < 0.5:
        return np.asarray(first + (second - first) * part)
    return np.asarray(second - (second - first) * (1 - part))


def sigma_of_bends(values: ArrayLike) -> NDArray[np.float64]:
    """Noise of each column of values (n, ...) in equal steps, of which the second differences are nearly only noise."""
    return np.asarray(PER_MEDIAN * np.median(np.abs(np.diff(values, n=2, axis=0)), axis=0) / 6**0.5)


def robust_sigma(values: ArrayLike) -> float:
    """Standard deviation of a normal distribution with the same median absolute deviation from its median."""
    of_all = np.asarray(values)
    return float(PER_MEDIAN * np.median(np.abs(of_all - np.median(of_all))))
