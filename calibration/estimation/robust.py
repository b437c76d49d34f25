"""Robust weights of residuals, so that disturbed dots hardly affect a fit: Huber (1964), Ann. Math. Stat. 35, 73."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Standard deviations beyond which the influence of a residual is constant (Huber): 27 of 10 000 normal ones.
HUBER = 3.0
# Standard deviations beyond which dots are left out after the fit: 0.04 of 10 000 undisturbed dots.
OUTLIER = 5.0


def robust_scale(whitened: list[Array]) -> float:
    """Standard deviation of whitened residuals (n, 2) from their median size (a Rayleigh median is 1.177)."""
    size = np.concatenate([np.hypot(r[:, 0], r[:, 1]) for r in whitened])
    size = size[np.isfinite(size)]
    return float(max(np.median(size) / 1.1774, 1e-3)) if len(size) else 1.0


def huber_weights(whitened: Array, scale: float) -> Array:
    """Weights (n,) of dots with whitened residuals (n, 2): 1 within HUBER scales, less beyond."""
    return np.asarray(HUBER / np.maximum(np.hypot(whitened[:, 0], whitened[:, 1]) / scale, HUBER))
