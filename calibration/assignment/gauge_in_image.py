"""Detection of the gauge in one image: dots, grid indices, and checks that it is the right gauge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.assignment.array_in_image import find_array
from calibration.assignment.lattice import Lattice
from calibration.assignment.matching import Match, match_gauge
from calibration.assignment.neighbours import nearest
from calibration.assignment.wrong_gauge import size_ratio
from calibration.detection.disturbed import useful
from calibration.detection.dots import Dots
from calibration.detection.roundness import NAMES, OUT_OF_ROUND, out_of_round
from calibration.errors import CalibrationError, ImageError
from calibration.estimation.bundle_adjustment import View, whitening
from calibration.estimation.flatness import face_terms
from calibration.gauge.geometry import Gauge

FEWEST_DOTS = 12  # twice the six that determine a pose and a lens roughly
# For a gauge of few dots: share of them that must be visible, and absolute minimum. Eight dots still overdetermine a
# pose and hardly arise by chance.
FEWEST_SHARE, FEWEST_EVER = 2 / 3, 8
# Limits of blur over radius and of the diameter ratio. A dot blurred beyond its own size resembles a Gaussian, which
# the disc model fits with an edge of 0.6 radii and too large a diameter. Below, centres are still accurate; above,
# neighbouring dots overlap.
SMUDGE = (0.5, 1.2)
# Blur over radius up to which the shape of a dot is visible.
SHARP = 0.4
# Dots wider or narrower than gauge.toml by this factor belong to another plate. A smaller deviation may be a wrong
# number in the file, which the verdict reports.
FOREIGN_SIZE = 1.8
# Apparent shift of an edge into its dark side, in units of the blur, at a camera gamma of 2.2: the edge is asymmetric,
# its half height lies half a blur beyond the true edge, and the best fit 0.7 of a blur.
BLOOM = 0.7
IN_FOCUS = 0.15  # blur over radius below which that shift is too small to affect the verdict


@dataclass(frozen=True)
class Sighting:
    """The gauge found in one image.

    size_ratio: ratio of dot diameter to dot distance in the image over that of the gauge file. bloom: relative error
    that defocus may cause in it.
    """

    name: str
    dots: Dots
    lattice: Lattice
    match: Match
    size_ratio: float
    bloom: float = 0.0


def sight(image: NDArray[np.generic], gauge: Gauge, name: str) -> Sighting:
    """Find the gauge in one image. Raises ImageError."""
    dots, lattice = find_array(image, gauge.dots.color, gauge.dots.background)
    fewest = fewest_dots(gauge)
    if len(dots) < fewest:
        said = gauge.dots
        inverse = find_array(image, said.background, said.color)[1]
        if len(inverse) >= fewest:
            raise ImageError(
                name,
                f"{len(dots)} dots of color {said.color} found, but {len(inverse)} of color {said.background} on "
                f'{said.color}; exchange color = "{said.color}" and background = "{said.background}" of the gauge?',
            )
        raise ImageError(
            name,
            f"{len(dots)} dots of color {said.color} found, at least {fewest} are needed; "
            "is it a sharp image of a dot gauge (no checkerboard, no ChArUco board)?",
        )
    if len(lattice) < fewest:
        raise ImageError(
            name, f"{len(dots)} dots found, but only {len(lattice)} of them form a regular array; is it the gauge?"
        )
    if lattice.others:
        raise ImageError(
            name, f"two dot arrays in view, of {len(lattice)} and {lattice.others} dots; show one gauge at a time"
        )
    blur = float(np.median(2 * dots.blur_px / dots.diameter_px))
    swollen = float(np.median(dots.diameter_px[lattice.dot])) / _expected_diameter_px(dots, lattice, gauge)
    if blur > SMUDGE[0] and swollen > SMUDGE[1]:
        raise ImageError(name, f"too blurred, dots are smeared to {swollen:.1f} times their size; focus the lens")
    try:
        match = match_gauge(dots, lattice, gauge)
    except CalibrationError as error:
        raise ImageError(name, str(error)) from None
    order, depth = out_of_round(dots, match.dot)
    if depth > OUT_OF_ROUND and blur < SHARP:
        raise ImageError(
            name,
            f"the marks are not discs but {NAMES[order]}: their rims depart from an ellipse by "
            f"{100 * depth:.0f} % of the radius; is it the gauge of this image, and did the gauge or the camera move "
            "during the exposure?",
        )
    ratio = size_ratio(dots.centers_px[match.dot], dots.diameter_px[match.dot], match.column, match.row, gauge)
    if ratio > FOREIGN_SIZE or ratio < 1 / FOREIGN_SIZE:
        raise ImageError(
            name,
            f'the ratio of dot diameter to pitch is {ratio:.2g} times that of the gauge "{gauge.name}"; is it the '
            "gauge of this image, and are its pitch_mm and diameter_mm right?",
        )
    return Sighting(name, dots, lattice, match, ratio, BLOOM * max(blur - IN_FOCUS, 0.0))


def fewest_dots(gauge: Gauge) -> int:
    """Minimum number of dots that an image must show."""
    count = gauge.dots.columns * gauge.dots.rows
    return min(FEWEST_DOTS, max(FEWEST_EVER, int(np.ceil(FEWEST_SHARE * count))))


def _expected_diameter_px(dots: Dots, lattice: Lattice, gauge: Gauge) -> float:
    """Diameter of the gauge's dots at the scale of their distances in the image, px."""
    along, down = gauge.pitch_mm
    next_mm = min(along, down if gauge.dots.layout == "square" else float(np.hypot(along / 2, down)))
    return gauge.dots.diameter_mm / next_mm * float(np.median(nearest(dots.centers_px[lattice.dot], 1)[0]))


def view_of(sighting: Sighting, gauge: Gauge, *, on_plate: bool) -> View:
    """Dots of one image with their places, at the gauge's height where it lies on the plate.

    Dots disturbed by adjacent structures are left out.
    """
    match, dots = sighting.match, sighting.dots
    points = gauge.positions_mm()[match.row, match.column]
    height = gauge.dots.height_mm if on_plate else 0.0
    view = View(
        centers_px=dots.centers_px[match.dot],
        whitening=whitening(dots.covariance_px2[match.dot]),
        points_mm=np.column_stack([points, np.full(len(points), height)]),
        radius_mm=gauge.diameters_mm()[match.row, match.column] / 2,
        site=match.row * gauge.dots.columns + match.column,
        offset_px=np.zeros((len(points), 2)),
        terms=face_terms(gauge)[match.row, match.column],
        name=sighting.name,
    )
    return view.take(useful(dots.covariance_px2[match.dot]))
