"""Uncertainty of the centre of a mark of any shape from its outline.

A codec that saves bits leaves one end of a sticker at its old position, or smears it, for many frames: the course of
the mark remains smooth, and the error is not visible between frames. But the length changes, which is constant for a
rigid mark. If the errors of both ends are independent, half the length scatters as much as the centre along it; in
rendered clips with H.264 and MPEG-4 at a few quantisers the ratio is 0.8 to 1.3 along the longer axis, 1.5 to 2.5
across. An occlusion of one end in some frames gives a different length in these.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.robust import PER_MEDIAN

Array = NDArray[np.float64]

FEWEST = 30  # frames needed to separate the scatter of a length from slant and position
SECOND_ORDER = 60  # frames needed for perspective of second order
ALONG, ACROSS = 0.5, 0.25  # error of the centre over that of the length, along the longer axis and across
HIDDEN = 0.5  # error of the centre over the hidden part of a length, in either direction
CLIPPED = 4.0  # robust sigmas above which a length is an outlier (something touches the mark)


def widen_by_outline(times_s: Array, values: Array, outline: Sequence[tuple[float, float, float, float]]) -> None:
    """Increase the variances of a mark to those given by the scatter of its outline; in place.

    times_s: (n,). values: (n, 5) of x, y, their variances and covariance, px and px². outline: time, longer and shorter
    side (px), direction of the longer one (rad), of frames in which it was seen.
    """
    if len(outline) < FEWEST:
        return
    shapes = np.array(outline)
    shapes = shapes[np.unique(shapes[:, 0], return_index=True)[1]]
    rows = np.searchsorted(times_s, shapes[:, 0])
    there = (rows < len(times_s)) & np.isfinite(values[np.minimum(rows, len(values) - 1), 0])
    rows, shapes = rows[there], shapes[there]
    if len(rows) < FEWEST:
        return
    usual = _smooth(values[rows, :2], shapes[:, 3])
    cos, sin = np.cos(shapes[:, 3]), np.sin(shapes[:, 3])
    for side, share, (ahead, left) in ((1, ALONG, (cos, sin)), (2, ACROSS, (-sin, cos))):
        scatter, odd_px = _scatter(shapes[:, side], usual)
        x, y, both = values[rows, 2:5].T
        known = float(np.median(ahead**2 * x + left**2 * y + 2 * ahead * left * both))
        lacking = max((share * scatter) ** 2 - known, 0.0) + (HIDDEN * odd_px) ** 2
        values[rows, 2:5] += lacking[:, None] * np.stack([ahead**2, left**2, ahead * left], axis=1)


def _smooth(places_px: Array, angle: Array) -> Array:
    """Regressors for a length by slant, perspective and lens: terms of position and direction, (n, k)."""
    x, y = ((places_px - places_px.mean(axis=0)) / (np.ptp(places_px) + 1e-9)).T
    terms = [np.ones_like(x), x, y, *(part(k * angle) for k in (2, 4) for part in (np.cos, np.sin))]
    if len(x) >= SECOND_ORDER:
        terms += [x * x, x * y, y * y]
    return np.stack(terms, axis=1)


def _scatter(length: Array, usual: Array) -> tuple[float, Array]:
    """Standard deviation of a length about its expectation, without outliers, and the deviation of these, else 0."""
    left = length - np.median(length)
    kept = np.abs(left) <= CLIPPED * PER_MEDIAN * float(np.median(np.abs(left))) + 1e-9
    for _ in range(3):
        left = length - usual @ np.linalg.lstsq(usual[kept], length[kept], rcond=1e-9)[0]
        sigma = PER_MEDIAN * float(np.median(np.abs(left[kept])))
        kept = np.abs(left) <= CLIPPED * sigma + 1e-9
    freedom = max(int(kept.sum()) - usual.shape[1], 1)
    return float(np.sqrt((left[kept] ** 2).sum() / freedom)), np.where(kept, 0.0, left)
