"""Generalised least squares with noise correlated in time, valid also for few independent values.

The noise (its correlation from frame to frame, its white share, whether it is fixed to the image or to the body) is
unknown. The estimate is therefore averaged over noise models, weighted by their restricted likelihood (Harville 1977,
doi:10.1080/01621459.1977.10480998). This widens intervals like Student's t for an unknown scale. The prior is flat in
the logarithm of the correlation time, which has no preferred unit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from evaluator.turning.motion.whitening import whitened_moments

Array = NDArray[np.float64]

# Fisher's z of the correlation between successive frames. The variance of a mean is proportional to exp(2 z): a step of
# 0.15 resolves a standard error to 8 % or better, and averaging over neighbours to much less. z = 3.3 is a correlation
# time of 370 frames: in a run of a few hundred frames, slower noise cannot be distinguished from a change of the
# parameters.
CORRELATIONS = np.tanh(np.arange(-0.3, 3.31, 0.15))
# White shares of the variance, and their prior probabilities: usually there is one process.
WHITE_SHARES = {0.0: 0.8, 0.5: 0.1, 0.85: 0.1}
# Slow noise is visible only if the run lasts for some of its correlation times, more of them under white noise. Slower
# noise is equivalent to other parameters: a systematic error, which is propagated separately like those of the camera.
SEEN_CORRELATION_TIMES = {0.0: 4.0, 0.5: 10.0, 0.85: 10.0}
# Noise fixed to the image rotates relative to the body. Within a quarter of this angle, the longest correlation time
# that is visible, cos(2 / 4) = 0.88: shorter arcs cannot distinguish the two.
TURN_THAT_TELLS_RAD = 2.0
NEGLIGIBLE = 1e-4  # weight below which a noise model cannot move a 95 % bound


@dataclass(frozen=True)
class NoiseModel:
    """One noise model: correlation per frame interval, white share of the variance, rotating with the image or not."""

    correlation: float
    white_share: float
    in_image: bool


def noise_models(turned_rad: float, duration: float) -> tuple[NoiseModel, ...]:
    """Noise models that data of this heading range and duration, in frame intervals, can distinguish."""
    models = [NoiseModel(0.0, 0.0, in_image=False)]
    for in_image in (False, True) if turned_rad > TURN_THAT_TELLS_RAD else (False,):
        for share, times in SEEN_CORRELATION_TIMES.items():
            # A correlation below 0.2 under as much white noise is practically white.
            seen = (np.exp(-times / duration) >= CORRELATIONS) & (abs(CORRELATIONS) > (0.2 if share else 1e-9))
            models += [NoiseModel(float(r), share, in_image) for r in CORRELATIONS[seen]]
    return tuple(models)


@dataclass(frozen=True)
class Averaged:
    """Parameter estimates under every noise model: a mixture of Student distributions.

    weight: (m,) probabilities; estimate: (m, p); covariance: (m, p, p) scale matrices; freedom: degrees of freedom;
    scale: (m,) standard deviation of a unit channel.
    """

    models: tuple[NoiseModel, ...]
    weight: Array
    estimate: Array
    covariance: Array
    scale: Array
    freedom: float

    @property
    def best(self) -> int:
        """Index of the most probable noise model."""
        return int(np.argmax(self.weight))

    def correlation(self) -> float:
        """Correlation of the noise between successive frames, averaged."""
        return float(self.weight @ np.array([m.correlation * (1 - m.white_share) for m in self.models]))

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


@dataclass(frozen=True)
class Block:
    """One interval of data with separate parameters.

    time: (n,) in frame intervals. heading_rad: (n,) unwrapped. residual: (n, c) channels of unit relative variance.
    design: (n, c, p), their derivative by the parameters.
    """

    time: Array
    heading_rad: Array
    residual: Array
    design: Array

    @property
    def freedom(self) -> int:
        """Degrees of freedom: values minus parameters."""
        n, channels, parameters = self.design.shape
        return int(n * channels - parameters)


def averaged_least_squares(block: Block) -> Averaged:
    """Solve residual ≈ design · parameters for noise of unknown scale and correlation."""
    return averaged_over_blocks((block,))[0]


def averaged_over_blocks(blocks: tuple[Block, ...]) -> tuple[Averaged, ...]:
    """Solve blocks with separate parameters and common noise, including its scale.

    Raises ValueError if there are no more data than parameters.
    """
    freedom = sum(block.freedom for block in blocks)
    if freedom < 1:
        raise ValueError("more parameters than data")
    # All blocks together distinguish noise models that a single one cannot.
    turned = sum(float(np.ptp(block.heading_rad)) for block in blocks)
    models = noise_models(turned, sum(float(block.time[-1] - block.time[0]) for block in blocks))
    solved = [_solved(block, models) for block in blocks]
    squares = np.maximum(sum(part.squares for part in solved), 1e-300)
    log = sum(part.log for part in solved) - freedom / 2 * np.log(squares) + _log_prior(models)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    scale = np.sqrt(squares / freedom)
    return tuple(
        Averaged(models, weight, part.estimate, part.unscaled * (scale**2)[:, None, None], scale, float(freedom))
        for part in solved
    )


@dataclass(frozen=True)
class _Solved:
    estimate: Array
    unscaled: Array
    squares: Array
    log: Array


def _solved(block: Block, models: tuple[NoiseModel, ...]) -> _Solved:
    """Least squares under each model, and the part of the restricted likelihood without the scale."""
    n, channels, parameters = block.design.shape
    orthonormal, triangle = np.linalg.qr(block.design.reshape(n * channels, parameters))
    data: Array = np.concatenate([orthonormal.reshape(block.design.shape), block.residual[:, :, None]], axis=2)
    moments, logs = _moments(block.time, block.heading_rad, data, models)
    cross, within = moments[:, :parameters, parameters], moments[:, :parameters, :parameters]
    inverse = np.linalg.inv(within)
    estimate = np.einsum("mij,mj->mi", inverse, cross)
    back = np.linalg.pinv(triangle, rcond=1e-12)
    return _Solved(
        estimate=estimate @ back.T,
        unscaled=back @ inverse @ back.T,
        squares=moments[:, parameters, parameters] - np.einsum("mi,mi->m", estimate, cross),
        log=-logs - 0.5 * np.linalg.slogdet(within)[1],
    )


def _moments(time: Array, heading_rad: Array, data: Array, models: tuple[NoiseModel, ...]) -> tuple[Array, Array]:
    steps, turns = np.diff(time), np.diff(heading_rad)
    still = np.zeros_like(turns)
    data = np.ascontiguousarray(data)
    results = [
        whitened_moments(steps, turns if m.in_image else still, data, m.correlation, m.white_share) for m in models
    ]
    return np.array([moments for moments, _ in results]), np.array([log for _, log in results])


def _log_prior(models: tuple[NoiseModel, ...]) -> Array:
    """Equal prior for noise in the image and on the body, WHITE_SHARES, and flat in Fisher's z within these."""
    keys = [(m.white_share, m.in_image) for m in models]
    return np.array([np.log(WHITE_SHARES[key[0]] / keys.count(key)) for key in keys])


def responses(averaged: Averaged, block: Block, columns: Array) -> Array:
    """Parameter changes (p, k) of the most probable estimator for given deviations (n, c, k) of the data."""
    parameters = block.design.shape[2]
    model = averaged.models[averaged.best]
    data: Array = np.concatenate([block.design, columns], axis=2)
    moments = _moments(block.time, block.heading_rad, data, (model,))[0][0]
    within, cross = moments[:parameters, :parameters], moments[:parameters, parameters:]
    scale = np.sqrt(np.maximum(np.diag(within), 1e-300))[:, None]
    return np.asarray(np.linalg.pinv(within / (scale @ scale.T), rcond=1e-12) @ (cross / scale) / scale)


def _mixture_quantile(level: float, weight: Array, center: Array, width: Array, freedom: float) -> float:
    """Quantile of a mixture of Student distributions, searched between the extreme quantiles of its members."""
    keep = weight > NEGLIGIBLE * weight.max()
    weight, center, width = weight[keep] / weight[keep].sum(), center[keep], np.maximum(width[keep], 1e-300)
    ends = center + width * float(special.stdtrit(freedom, level))
    low, high = float(ends.min()), float(ends.max())

    def excess(value: float) -> float:
        return float(weight @ special.stdtr(freedom, (value - center) / width)) - level

    if excess(low) >= 0:  # the members agree within rounding
        return low
    if excess(high) <= 0:
        return high
    return float(optimize.brentq(excess, low, high, xtol=1e-12 * (high - low)))
