"""Dots of one image at known places, with nothing detected."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.assignment.lattice import Lattice
from calibration.detection.dots import Dots
from tests.calibration.drawing import gauge_of

SHEET, CONTRAST = 200.0, 100.0


def dots_at(points: NDArray[np.float64], size_px: tuple[int, int] = (400, 300), **more: Any) -> Dots:
    """Dots of 8 px on a bare sheet, equally certain and sharp; what is given stands instead of what they share."""
    n = len(points)
    usual = {
        "diameter_px": np.full(n, 8.0), "contrast": np.full(n, CONTRAST), "background": np.full(n, SHEET),
        "blur_px": np.ones(n), "noise": np.ones(n), "covariance_px2": np.tile(1e-4 * np.eye(2), (n, 1, 1)),
        "shape": np.ones((n, 3)), "color": np.full((n, 1), SHEET - CONTRAST),
        "plane": np.full(size_px[::-1], SHEET, np.float32),
    }  # fmt: skip
    return Dots(size_px, np.asarray(points, float), **{**usual, **more})


def places(columns: int, rows: int) -> NDArray[np.int64]:
    """Column and row of every place, row by row."""
    return np.array([(column, row) for row in range(rows) for column in range(columns)], dtype=np.int64)


def of(index: NDArray[np.int64]) -> Lattice:
    """All dots in their order at these places."""
    return Lattice(np.arange(len(index)), index)


MARKED = gauge_of(
    columns=9,
    rows=7,
    fiducial=[{"column": 1, "row": 2, "diameter_mm": 0.7}, {"column": 4, "row": 2, "diameter_mm": 1.8}],
)
PLAIN = gauge_of(columns=9, rows=7)


def view(gauge: Any, turn_deg: float = 0.0, *, mirrored: bool = False, keep: Any = slice(None), extra: Any = ()) -> Any:
    """Dots of a sheet, 20 px to a pitch, turned clockwise in the image, and their columns and rows."""
    index = places(gauge.dots.columns, gauge.dots.rows)[keep]
    angle, size = np.radians(turn_deg), gauge.diameters_mm()[index[:, 1], index[:, 0]]
    off = (np.concatenate([index, np.reshape(extra, (-1, 2))]) - [4, 3]) * ([-1, 1] if mirrored else [1, 1])
    points = 20.0 * off @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) + [200.0, 150.0]
    diameter = np.r_[size * 20 / 3, np.full(len(off) - len(index), 8.0)]
    return dots_at(points, diameter_px=diameter), Lattice(np.arange(len(off)), np.rint(off).astype(np.int64)), index
