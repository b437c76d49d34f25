"""Dots disturbed by the edge of the sheet, dirt, glare or a finger.

Such dots leave more residual than the others of the image. Where the disturbance lies outside the dot, a fit of fewer
pixels about the edge is free of it; where it lies on the dot, the centre is moved by more than noise would move it, and
its uncertainty must say so.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from calibration.detection.ellipse_fit import fit_dots

Array = NDArray[np.float64]
Plane = NDArray[np.float32]

# Residuals of equal dots scatter by some percent, of small or compressed ones by more: that far above the median, and
# so many standard deviations of their own scatter, is no chance.
SUSPECT, SUSPECT_SIGMA = 0.1, 4.0
FEWEST = 8  # dots that tell what residual is usual
# Of the blur: holds 98.8 % of the edge on either side. Pixels farther out only tell the level and slope of the light.
CLOSE = 2.5
# Centre error over blur times excess residual per contrast: dirt and sheet edges give 1 to 7, patches of glare 10 to
# 20 (rendered; the sheet edges that remain after the second fit 1).
LEVER = 12.0
# Times the median uncertainty of an image. Vignetting reaches five; a dot widened for its residual starts at about ten
# and is of no use where others are, but would make the residuals of the solve look bad.
USELESS = 8.0


def fit_again(plane: Plane, reach: Array, found: tuple[Array, Array, Array]) -> None:
    """Fit the dots of unusual residual to pixels close to their edge, in place, and keep what that cleans.

    reach: (n,) px as handed to `fit_dots`. found: what it gave.
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
    """Covariances (n, 2, 2) px² of the centres, widened where the residual is more than usual."""
    usual, limit = _usual(noise)
    excess = np.where(noise > limit, np.sqrt(np.maximum(noise**2 - usual**2, 0.0)), 0.0)
    moved = LEVER * excess / np.maximum(-fitted[:, 7], 1e-12) * fitted[:, 5]
    return np.asarray(covariance + moved[:, None, None] ** 2 * np.eye(2))


def useful(covariance_px2: Array) -> NDArray[np.bool_]:
    """Which dots, by their covariances (n, 2, 2) px², add information to that of the others."""
    size = np.sqrt(np.trace(covariance_px2, axis1=1, axis2=2))
    return np.asarray(size < USELESS * np.median(size))


def _usual(noise: Array, spoilt: float = 0.5) -> tuple[float, float]:
    """Median residual of the sound dots, and the residual beyond which a dot is suspect; infinite where too few tell.

    spoilt: largest share of the dots that may be disturbed; only the rest is looked at.
    """
    known = np.sort(np.log(np.maximum(noise[np.isfinite(noise)], 1e-300)))
    if len(known) < FEWEST:
        return 0.0, np.inf
    # the lower part of a normal distribution tells its median and scatter
    low, high = np.quantile(known, [0.2 * (1 - spoilt), 1 - spoilt])
    rank_low, rank_high = NormalDist().inv_cdf(0.2 * (1 - spoilt)), NormalDist().inv_cdf(1 - spoilt)
    scatter = (high - low) / (rank_high - rank_low)
    usual = high - rank_high * scatter
    return float(np.exp(usual)), float(np.exp(usual + max(SUSPECT, SUSPECT_SIGMA * scatter)))
