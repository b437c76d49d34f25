"""Bounds of each parameter in a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.problem import Column

Floats = NDArray[np.float64]

# Of a nominal value: farther is not recalibration but another robot; and never to nothing. Of the start common to all
# runs, known to a frame, 6 sigmas are 0.1 s: a larger error is a mistake of the experiment file.
MOST_TOLERANCES = 6.0
MOST_DEVIATION = 0.5
AT_BOUND = 1e-3  # visible steps from a bound within which a fit has ended there


def bounds(columns: Sequence[Column], tolerance: Mapping[str, float]) -> tuple[Floats, Floats]:
    """How far parameters (p,) may go from where they change nothing."""
    low, high = np.array([_bounds_of(column, tolerance) for column in columns]).reshape(-1, 2).T
    return low, high


def _bounds_of(column: Column, tolerance: Mapping[str, float]) -> tuple[float, float]:
    """Bounds of one parameter: a nominal value may go by few tolerances, and never to nothing."""
    if column.term is None:
        most = min(MOST_TOLERANCES * tolerance[column.key], MOST_DEVIATION)
        return -most, most
    coordinate = column.term.coordinates[column.coordinate]
    return coordinate.low - column.absent, coordinate.high - column.absent


def is_at_bound(column: Column, value: float) -> bool:
    """Whether an effect's coordinate, measured from where it is absent, is at a bound beyond which it might lie."""
    if column.term is None or column.term.coordinates[column.coordinate].closed:
        return False
    low, high = _bounds_of(column, {})
    near = AT_BOUND * column.term.coordinates[column.coordinate].step
    return (low < 0 and value - low < near) or (high > 0 and high - value < near)
