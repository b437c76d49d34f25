"""Generalised least squares with noise that is correlated in time, honest where few independent values are left.

The deviations of a fit are taken as a stationary process whose correlation falls by a factor per frame interval (an
autoregressive process in continuous time, so that gaps need no filling). That factor is not known: the estimate is
averaged over it, weighted by its restricted likelihood (Harville 1977, doi:10.1080/01621459.1977.10480998) and a flat
prior, which widens intervals the way Student's t does for an unknown scale.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]

# Correlation between successive frames. Steps are a third of the width 1/sqrt(2n) of the likelihood at n = 600.
CORRELATIONS = np.concatenate([np.arange(-0.4, 0.9, 0.05), [0.9, 0.925, 0.95, 0.965, 0.98, 0.99, 0.995]])


@dataclass(frozen=True)
class Averaged:
    """Parameter estimates for each correlation: a mixture of Student distributions.

    weight: (m,) probabilities; estimate: (m, p); covariance: (m, p, p) scale matrices; freedom: degrees of freedom.
    """

    correlation: Array
    weight: Array
    estimate: Array
    covariance: Array
    scale: Array
    freedom: float

    def mean(self) -> Array:
        """Mean of the mixture, (p,)."""
        return np.asarray(self.weight @ self.estimate)

    def spread(self) -> Array:
        """Covariance of the mixture, (p, p)."""
        away = self.estimate - self.mean()
        student = self.freedom / max(self.freedom - 2, 0.5)
        return np.asarray(
            np.einsum("m,mij->ij", self.weight, student * self.covariance + away[:, :, None] * away[:, None, :])
        )

    def quantiles(self, direction: Array, levels: tuple[float, ...]) -> Array:
        """Quantiles of a linear function of the parameters, (p,) its coefficients."""
        center = self.estimate @ direction
        width = np.sqrt(np.einsum("i,mij,j->m", direction, self.covariance, direction))
        return np.array([_mixture_quantile(level, self.weight, center, width, self.freedom) for level in levels])


def averaged_least_squares(time: Array, residual: Array, design: Array) -> Averaged:
    """Solve residual ≈ design · parameters for noise of unknown scale and correlation.

    time: (n,) in frame intervals. residual: (n, c) channels of unit relative variance. design: (n, c, p).
    """
    n, channels = len(residual), residual.shape[1]
    parameters = design.shape[2]
    freedom = n * channels - parameters
    if freedom < 1:
        raise ValueError("more parameters than data")
    data: Array = np.concatenate([design, residual[:, :, None]], axis=2).reshape(n, -1)
    steps = np.diff(time)
    estimates, covariances, scales, logs = [], [], [], []
    for correlation in CORRELATIONS:
        fade = _faded(correlation, steps)
        spread = np.sqrt(1 - fade**2)
        white = np.concatenate([data[:1], (data[1:] - fade[:, None] * data[:-1]) / spread[:, None]])
        white = white.reshape(n * channels, parameters + 1)
        triangle: Array = np.asarray(np.linalg.qr(white, mode="r"))
        corner = triangle[:parameters, :parameters]
        inverse = np.linalg.pinv(corner, rcond=1e-12)
        squares = triangle[parameters, parameters] ** 2
        estimates.append(inverse @ triangle[:parameters, parameters])
        covariances.append(inverse @ inverse.T * squares / freedom)
        scales.append(np.sqrt(squares / freedom))
        with np.errstate(divide="ignore"):
            logs.append(
                -channels * float(np.log(spread).sum())
                - float(np.log(np.abs(np.diag(corner))).sum())
                - freedom / 2 * np.log(max(float(squares), 1e-300))
            )
    log = np.array(logs, dtype=float)
    widths = np.gradient(CORRELATIONS)
    weight = np.exp(log - log.max()) * widths
    return Averaged(
        correlation=CORRELATIONS,
        weight=weight / weight.sum(),
        estimate=np.array(estimates),
        covariance=np.array(covariances),
        scale=np.array(scales),
        freedom=float(freedom),
    )


def _faded(correlation: float, steps: Array) -> Array:
    """Correlation over steps, in frame intervals; a negative one alternates from frame to frame."""
    sign = np.where((np.round(steps) % 2 == 1) & (correlation < 0), -1.0, 1.0)
    return np.asarray(sign * np.abs(correlation) ** steps)


def _mixture_quantile(level: float, weight: Array, center: Array, width: Array, freedom: float) -> float:
    """Quantile of a mixture of Student distributions by bisection."""
    keep = weight > 1e-9
    weight, center, width = weight[keep] / weight[keep].sum(), center[keep], np.maximum(width[keep], 1e-300)
    ends = center + width * float(stats.t.ppf(level, freedom))
    low, high = float(ends.min()), float(ends.max())
    for _ in range(60):
        middle = (low + high) / 2
        if not low < middle < high:
            break
        below = float(weight @ stats.t.cdf((middle - center) / width, freedom))
        low, high = (middle, high) if below < level else (low, middle)
    return (low + high) / 2
