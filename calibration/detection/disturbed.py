"""Dots disturbed by the edge of the sheet, dirt, glare or a finger.

Such dots have larger residuals than the others of the image. If the disturbance lies outside the dot, a fit to fewer
pixels about the edge avoids it; if it lies on the dot, the centre is shifted by more than noise, and its uncertainty is
increased accordingly.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from calibration.detection.ellipse_fit import fit_dots

Array = NDArray[np.float64]
Plane = NDArray[np.float32]

# A dot is suspect if its residual exceeds the median by this share and by this many standard deviations of the scatter.
# Residuals of equal dots scatter by some percent, those of small or compressed dots by more.
SUSPECT, SUSPECT_SIGMA = 0.1, 4.0
FEWEST = 8  # dots that determine the usual residual
# In units of the blur: contains 98.8 % of the edge on either side. Pixels farther away determine only level and slope.
CLOSE = 2.5
# Centre error over blur times excess residual per contrast: dirt and sheet edges give 1 to 7, patches of glare 10 to
# 20 (rendered; the sheet edges that remain after the second fit 1).
LEVER = 12.0
# Uncertainty over the median of the image above which a dot is not used. Vignetting gives up to five; dots with
# uncertainties increased for their residuals start at about ten and add no information.
USELESS = 8.0


def fit_again(plane: Plane, reach: Array, found: tuple[Array, Array, Array]) -> None:
    """Fit the dots of unusual residual again, to pixels close to their edge, and keep improved results, in place.

    reach: (n,) px, the argument of `fit_dots`. found: its results.
    """
    fitted, covariance, noise = found
    limit = _usual(noise, spoilt=0.7)[1]
    suspect = np.flatnonzero(noise > limit)
    if len(suspect) == 0:
        return
    close = np.minimum(reach[suspect], np.maximum(CLOSE * fitted[suspect, 5], 1.5))
    again, spread, rest = fit_dots(plane, np.ascontiguousarray(fitted[suspect]), close)
    cleaned = rest < limit
    fitted[suspect[cleaned]], covariance[suspect[cleaned]] = again[cleaned], spread[cleaned]
    noise[suspect[cleaned]] = rest[cleaned]


def doubted(fitted: Array, covariance: Array, noise: Array) -> Array:
    """Covariances (n, 2, 2) px² of the centres, increased for unusual residuals."""
    usual, limit = _usual(noise)
    excess = np.where(noise > limit, np.sqrt(np.maximum(noise**2 - usual**2, 0.0)), 0.0)
    moved = LEVER * excess / np.maximum(-fitted[:, 7], 1e-12) * fitted[:, 5]
    return np.asarray(covariance + moved[:, None, None] ** 2 * np.eye(2))


def useful(covariance_px2: Array) -> NDArray[np.bool_]:
    """Which dots are accurate enough to be useful, by their covariances (n, 2, 2) px²."""
    size = np.sqrt(np.trace(covariance_px2, axis1=1, axis2=2))
    return np.asarray(size < USELESS * np.median(size))


def _usual(noise: Array, spoilt: float = 0.5) -> tuple[float, float]:
    """Median residual of undisturbed dots, and the residual above which a dot is suspect; infinite for too few dots.

    spoilt: largest share of the dots that may be disturbed; only the rest is evaluated.
    """
    known = np.sort(np.log(np.maximum(noise[np.isfinite(noise)], 1e-300)))
    if len(known) < FEWEST:
        return 0.0, np.inf
    # median and scatter from the lower part of a normal distribution
    low, high = np.quantile(known, [0.2 * (1 - spoilt), 1 - spoilt])
    rank_low, rank_high = NormalDist().inv_cdf(0.2 * (1 - spoilt)), NormalDist().inv_cdf(1 - spoilt)
    scatter = (high - low) / (rank_high - rank_low)
    usual = high - rank_high * scatter
    return float(np.exp(usual)), float(np.exp(usual + max(SUSPECT, SUSPECT_SIGMA * scatter)))
