"""Bounds of each parameter in a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.point import Column

Floats = NDArray[np.float64]

# Bounds in tolerances: a nominal value beyond them is not recalibration but another robot. For the start common to all
# runs, known to a frame, 6 sigmas are 0.1 s: a larger error is a mistake in the experiment file.
MOST_TOLERANCES = 6.0
MOST_DEVIATION = 0.5
AT_BOUND = 1e-3  # distance from a bound, in visible steps, within which a fit counts as being at the bound


def bounds(columns: Sequence[Column], tolerance: Mapping[str, float]) -> tuple[Floats, Floats]:
    """Lower and upper bounds of parameters (p,), measured from their absent values."""
    low, high = np.array([_bounds_of(column, tolerance) for column in columns]).reshape(-1, 2).T
    return low, high


def _bounds_of(column: Column, tolerance: Mapping[str, float]) -> tuple[float, float]:
    """Bounds of one parameter; those of a nominal value are a few tolerances, and never include 0 of the value."""
    if column.term is None:
        most = min(MOST_TOLERANCES * tolerance[column.key], MOST_DEVIATION)
        return -most, most
    coordinate = column.term.coordinates[column.coordinate]
    return coordinate.low - column.absent, coordinate.high - column.absent


def is_at_bound(column: Column, value: float) -> bool:
    """Whether an effect's coordinate, measured from its absent value, is at a bound that is not a physical limit."""
    if column.term is None or column.term.coordinates[column.coordinate].closed:
        return False
    low, high = _bounds_of(column, {})
    near = AT_BOUND * column.term.coordinates[column.coordinate].step
    return (low < 0 and value - low < near) or (high > 0 and high - value < near)
