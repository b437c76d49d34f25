"""Search for the dot array of an image without a gauge file, used by all commands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.assignment.completion import DARKER, WIDER
from calibration.assignment.lattice import NO_LATTICE, Lattice, assign_grid, rows_and_columns
from calibration.assignment.regularity import evidence
from calibration.detection.dots import Dots, detect_dots, every_dot

# A slower search does not improve an array of at least CONVINCING dots that holds the share MOST of the dots found.
CONVINCING, MOST = 25, 0.6
WHOLE = 12  # dots: an array of so many that fills whole rows and columns needs no slower search either
# An array with holes and fewer dots than this is searched again in all windows, which takes half a second: its dots are
# large, and uneven light (a shadow on the sheet) or perspective may hide some of them in the best window.
SMALL = 150
# Factor of diameter within which the dots of one array lie, including perspective and fiducials, but not specks.
SIZE_CLASS = 4.0


def find_array(
    image: NDArray[np.generic], color: str | None = None, background: str | None = None
) -> tuple[Dots, Lattice]:
    """Find the dots of an image and the array they form; an empty lattice if they form none.

    image: (h, w) or (h, w, 3) BGR. color, background: of dots and sheet, as in gauge.toml; without them both signs of
    contrast are tried.
    """
    dots = detect_dots(image, color, background)
    best = dots, assign_grid(dots)
    if _convinces(*best):
        return best
    for found in every_dot(image, color, background):
        for some in (*_size_classes(found), *_alike(found, *best)):
            lattice = assign_grid(some)
            if _weight(some, lattice) > _weight(*best) * (1 + 1e-9):
                best = some, lattice
    return best if _weight(*best) > 0.0 else (best[0], NO_LATTICE)


def _convinces(dots: Dots, lattice: Lattice) -> bool:
    """Whether an array is complete enough that a slower search is unnecessary."""
    if len(lattice) >= SMALL and len(lattice) >= MOST * len(dots):
        return True
    if len(lattice) < WHOLE:
        return False
    columns, rows = rows_and_columns(lattice)[1].max(axis=0) + 1
    if len(lattice) < columns * rows:
        return False
    many = len(lattice) >= CONVINCING and len(lattice) >= MOST * len(dots)
    return many or float(dots.diameter_px[lattice.dot].sum()) >= MOST * float(dots.diameter_px.sum())


def _size_classes(dots: Dots) -> list[Dots]:
    """The dots in overlapping classes of diameter, which separates the dots of an array from specks between them."""
    if len(dots) == 0:
        return []
    smallest, largest = float(dots.diameter_px.min()), float(dots.diameter_px.max())
    classes, low = [], smallest
    while True:
        classes.append(dots.take((dots.diameter_px >= low * 0.999) & (dots.diameter_px <= SIZE_CLASS * low)))
        if SIZE_CLASS * low >= largest:
            return classes
        low *= SIZE_CLASS**0.5


def _alike(found: Dots, dots: Dots, lattice: Lattice) -> list[Dots]:
    """The dots that resemble those of an array, so that specks beside it do not stop its growth."""
    if not len(lattice):
        return []
    keep = np.ones(len(found), dtype=bool)
    for look, of_array, slack in (
        (found.diameter_px, dots.diameter_px[lattice.dot], WIDER),
        (found.contrast, dots.contrast[lattice.dot], DARKER),
    ):
        keep &= (look > of_array.min() / slack) & (look < of_array.max() * slack)
    return [found.take(keep)]


def _weight(dots: Dots, lattice: Lattice) -> float:
    """Sum of the diameters of an array's dots, weighted by the straightness of its rows, low for arrays of specks."""
    straight = evidence(dots.centers_px[lattice.dot], lattice.index)
    return float(dots.diameter_px[lattice.dot].sum()) * straight
