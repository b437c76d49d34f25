"""Errors of the corners of a tag, from changes of its rigid shape between frames.

A codec distorts the borders of a tag equally for many frames: the course of the tag remains smooth, and points of one
border share their error, so that their scatter about a straight line is too small. But the outline changes its shape,
which slant and perspective change only as smooth functions of position and heading.

Four corners, taken as complex numbers, are the sum of four modes: place, similarity (size and heading), affine shear,
and trapezoid. The last two, in the frame of the tag, are its shape.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.robust import PER_MEDIAN

Array = NDArray[np.float64]

FEWEST = 40  # frames needed to separate the scatter of a shape from the 11 terms of slant and position
CLIPPED = 4.0  # robust sigmas above which a shape is an outlier (a wire across a border)
# Share of the corners' squared errors that changes the shape. Errors of lines through the middle 70 % of the sides are
# errors of their slopes (6.1 parts of 7.1 at a corner), three of whose four combinations change the shape, and of their
# offsets, of which one of four combinations does.
SHARE = (6.1 * 3 / 4 + 1 / 4) / 7.1


def widen_by_shape(numbers: dict[str, Array], corners: Sequence[str], center: str) -> None:
    """Increase the variances of a tag's corners and centre to those given by the scatter of its shape; in place.

    numbers: per mark (n, 5) of x, y, their variances and covariance, px and px², NaN if absent.
    """
    values = np.stack([numbers[name] for name in corners])  # (4, n, 5)
    seen = np.isfinite(values).all(axis=(0, 2))
    if seen.sum() < FEWEST:
        return
    values = values[:, seen]
    points = values[..., 0] + 1j * values[..., 1]
    place, similarity, trapezoid, shear = np.fft.fft(points, axis=0) / 4
    shapes = np.stack([mode / similarity for mode in (trapezoid, shear)], axis=1)
    parts = np.concatenate([shapes.real, shapes.imag], axis=1) * np.abs(similarity)[:, None]
    # By Parseval the modes hold a quarter of the squares of the corners' errors.
    expected = SHARE * float(np.median(values[..., 2:4].sum(axis=(0, 2)))) / 4
    ratio = _mean_square(parts, _smooth(place, np.angle(similarity))) / expected
    if ratio > 1.0:
        for name in (*corners, center):
            numbers[name][:, 2:5] *= ratio


def _smooth(place: NDArray[np.complex128], heading: Array) -> Array:
    """Regressors for a shape by slant, perspective and lens: terms of position and heading, (n, 11)."""
    apart = place - place.mean()
    size = float(np.abs(apart).max()) + 1e-9
    harmonics = [part(k * heading) for k in (1, 2, 3, 4) for part in (np.cos, np.sin)]
    return np.stack([np.ones_like(heading), apart.real / size, apart.imag / size, *harmonics], axis=1)


def _mean_square(parts: Array, usual: Array) -> float:
    """Mean square of the shapes (n, 4), all parts together, about their expectation, without outliers."""
    kept = np.ones(len(parts), bool)
    left = parts
    for _ in range(3):
        left = parts - usual @ np.linalg.lstsq(usual[kept], parts[kept], rcond=1e-9)[0]
        sigma = PER_MEDIAN * np.median(np.abs(left[kept]), axis=0)
        kept = np.asarray((np.abs(left) <= CLIPPED * sigma + 1e-9).all(axis=1))
    square = float(np.sum(left[kept] ** 2))
    return square / max(int(np.count_nonzero(kept)) - int(usual.shape[1]), 1)
