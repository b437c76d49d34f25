"""Fiducial features of a dot: its size and colour relative to the dots around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.assignment.lattice import Lattice
from calibration.assignment.neighbours import nearest
from calibration.assignment.relative_size import relative_size
from calibration.detection.dots import Dots
from calibration.detection.image import color_bgr
from calibration.gauge.geometry import Gauge

Array = NDArray[np.float64]

# Standard deviation of ln(diameter) among equal dots under uneven light and blur (measured: 0.01 to 0.05).
SIZE_SIGMA = 0.06


def of_equal_size(dots: Dots, lattice: Lattice, gauge: Gauge) -> Lattice:
    """Remove lattice members whose size is not on the gauge: specks and reflections that happen to lie on a place."""
    size = _relative_size(dots, lattice)
    smallest = float(np.log(gauge.diameters_mm().min() / gauge.dots.diameter_mm))
    largest = float(np.log(gauge.diameters_mm().max() / gauge.dots.diameter_mm))
    keep = (size > smallest - 0.35) & (size < largest + 0.35)  # a factor of 1.4; less may be dirt on a dot
    return Lattice(lattice.dot[keep], lattice.index[keep], lattice.others)


def _relative_size(dots: Dots, lattice: Lattice) -> Array:
    """Logarithm of the diameter over that expected from the neighbours, (m,)."""
    points = dots.centers_px[lattice.dot]
    return relative_size(points, dots.diameter_px[lattice.dot], nearest(points, 12)[1])


def features_seen(dots: Dots, lattice: Lattice, gauge: Gauge) -> Array:
    """Features of dots, (4, m), in sigmas: relative size, then difference of colour from the neighbours."""
    features = np.zeros((4, len(lattice)))
    features[0] = _relative_size(dots, lattice) / SIZE_SIGMA
    if any(fiducial.color for fiducial in gauge.fiducial):
        points = dots.centers_px[lattice.dot]
        _, neighbours = nearest(points, 12)
        color = dots.color[lattice.dot]
        color = np.broadcast_to(color, (len(color), 3)) if color.shape[1] == 1 else color[:, :3]
        difference = color - np.median(color[neighbours], axis=1)
        # in units of a tenth of the step between dot and background
        features[1:] = (difference / (0.1 * np.median(dots.contrast))).T
    return features


def features_promised(gauge: Gauge, count: int) -> Array:
    """Features of every dot as the gauge file states them, (count, rows, columns), in the order of features_seen."""
    expected = np.zeros((count, gauge.dots.rows, gauge.dots.columns))
    expected[0] = np.log(gauge.diameters_mm() / gauge.dots.diameter_mm) / SIZE_SIGMA
    plain, background = color_bgr(gauge.dots.color), color_bgr(gauge.dots.background)
    step = float(np.abs(background - plain).sum()) or 1.0
    step = float(((background - plain) ** 2).sum()) / step or 1.0  # along the axis of `dark_dots`
    for fiducial in gauge.fiducial:
        if fiducial.color:
            expected[1:4, fiducial.row, fiducial.column] = (color_bgr(fiducial.color) - plain) / (0.1 * step)
    return expected
