"""Detection of an array that differs from the gauge file although a placement fits.

An array that continues beyond the lines of the gauge is a different one, and so is one that ends before them, unless
the rest is hidden or another image of the set shows it.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.assignment.lattice import BARE, Lattice, rows_and_columns
from calibration.gauge.geometry import Gauge

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
# The array spans the gauge, ends before it, or its end is not visible.
Extent = Literal["whole", "short", "open"]
Side = Literal["open", "bare", "hidden"]

# Share of the places along a side that must be in view for the side to be judged.
IN_VIEW = 0.8
# Share of a line beside the array that must hold dots: glare and dirt fill single places, not half a line.
LINE = 0.5
FEWEST_IN_LINE = 3
# Largest difference of brightness of the sheet on both sides of the array, as a share of the dots' contrast: vignetting
# and oblique light change it by some percent per pitch; a white cloth rarely matches the sheet so closely.
UNLIKE = 0.12


def place_on_sheet(sites: Integers, gauge: Gauge) -> Integers:
    """Column and row of lattice sites (n, 2), also beyond the array."""
    return np.stack([sites[:, 0] + row_offset(sites[:, 1], gauge), sites[:, 1]], axis=1)


def row_offset(row: Integers, gauge: Gauge) -> Integers:
    """Difference between column number and first lattice coordinate in a row.

    A staggered array has the basis (1, 0), (1/2, 1) in pitches, so that the difference grows by 1 every second row.
    """
    if gauge.dots.layout == "square":
        return np.zeros_like(row)
    return np.asarray((row + (gauge.dots.shifted_rows == "even")) // 2)


def goes_on(seen: Integers, gauge: Gauge) -> bool:
    """Whether whole lines of dots lie beside the gauge's array. seen: (n, 2) column and row of the dots."""
    size = np.array([gauge.dots.columns, gauge.dots.rows])
    inside = ((seen >= 0) & (seen < size)).all(axis=1)
    low, high = seen[inside].min(axis=0), seen[inside].max(axis=0)
    for axis in (0, 1):
        across = seen[:, 1 - axis]
        beside = (across >= low[1 - axis]) & (across <= high[1 - axis])
        least = max(FEWEST_IN_LINE, LINE * (high[1 - axis] - low[1 - axis] + 1))
        if any((seen[beside, axis] == line).sum() >= least for line in (-1, size[axis])):
            return True
    return False


def ends_early(seen: Integers, free: Integers, light: Array, gauge: Gauge) -> tuple[Extent, Extent]:
    """How the array of the image ends along the columns and along the rows of the gauge.

    seen: (n, 2) column and row of the dots. free: (k, 2) of places without a dot, light: (k,) of them, as returned by
    `places_without_dot`. If a smaller plate ends, dots are missing equally on both sides; if a cloth or the rim of the
    image hides the rest, the sides differ, unless the cloth is as white as the sheet.
    """
    size = np.array([gauge.dots.columns, gauge.dots.rows])
    seen = seen[((seen >= 0) & (seen < size)).all(axis=1)]
    low, high = seen.min(axis=0), seen.max(axis=0)
    extents: list[Extent] = []
    for axis in (0, 1):
        if high[axis] - low[axis] + 1 >= size[axis]:
            extents.append("whole")
            continue
        count = high[1 - axis] - low[1 - axis] + 1
        along = (free[:, 1 - axis] >= low[1 - axis]) & (free[:, 1 - axis] <= high[1 - axis])
        beyond = [light[along & (free[:, axis] == line)] for line in (low[axis] - 1, high[axis] + 1)]
        sides = [_side(each, count) for each in beyond]
        alike = sides[0] == sides[1] != "open"
        if alike and sides[0] == "bare":
            alike = abs(float(np.median(beyond[0]) - np.median(beyond[1]))) < UNLIKE
        extents.append("short" if alike else "open")
    return extents[0], extents[1]


def shows_bare_line(seen: Integers, free: Integers, light: Array, gauge: Gauge) -> bool:
    """Whether a line of the gauge next to the dots shows the sheet instead of dots; the placement may then be shifted.

    seen, free, light: as for `ends_early`.
    """
    size = np.array([gauge.dots.columns, gauge.dots.rows])
    seen = seen[((seen >= 0) & (seen < size)).all(axis=1)]
    low, high = seen.min(axis=0), seen.max(axis=0)
    for axis in (0, 1):
        for line in (low[axis] - 1, high[axis] + 1):
            here = np.abs(light[free[:, axis] == line]) < BARE
            if 0 <= line < size[axis] and len(here) >= FEWEST_IN_LINE and here.mean() > 0.5:
                return True
    return False


def _side(light: Array, count: int) -> Side:
    """Whether the places along one side of the array are out of view, bare sheet, or hidden."""
    if len(light) < IN_VIEW * count:
        return "open"
    return "bare" if (np.abs(light) < BARE).mean() > 0.5 else "hidden"


def size_ratio(centers_px: Array, diameter_px: Array, column: Integers, row: Integers, gauge: Gauge) -> float:
    """Ratio of dot diameter to dot distance in the image over that of the gauge: median over (n,) dots.

    The distance is the square root of the cell that a dot spans with its next two; NaN if no dot has both.
    """
    shape = (gauge.dots.rows + 1, gauge.dots.columns + 1)
    seen = np.full((*shape, 2), np.nan)
    seen[row, column] = centers_px
    width = np.full(shape, np.nan)
    width[row, column] = diameter_px / gauge.diameters_mm()[row, column]
    across, down = seen[:-1, 1:] - seen[:-1, :-1], seen[1:, :-1] - seen[:-1, :-1]
    cell_px2 = np.abs(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0])
    ratio = width[:-1, :-1] * np.sqrt(gauge.pitch_mm[0] * gauge.pitch_mm[1] / cell_px2)
    known = ratio[np.isfinite(ratio)]
    return float(np.median(known)) if len(known) else float("nan")


def does_not_fit(lattice: Lattice, gauge: Gauge) -> str:
    """Message for an array that differs from the gauge."""
    layout, index = rows_and_columns(lattice)
    columns, rows = index.max(axis=0) + 1
    return (
        f"the image shows a {layout} array of about {columns} × {rows} dots ({len(lattice)} seen), which does not "
        f'fit the gauge "{gauge.name}", {gauge.dots.layout}, {gauge.dots.columns} × {gauge.dots.rows}; '
        "is it the gauge of this image, and does nothing hide whole rows of it?"
    )
