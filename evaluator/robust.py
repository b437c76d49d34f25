"""The spread of values among which a few may be outliers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

PER_MEDIAN = 1.4826  # standard deviation of a normal distribution over its median absolute deviation: 1/Φ⁻¹(3/4)


def robust_sigma(values: ArrayLike) -> float:
    """Standard deviation of a normal distribution with the same median absolute deviation from its median."""
    of_all = np.asarray(values)
    return float(PER_MEDIAN * np.median(np.abs(of_all - np.median(of_all))))
