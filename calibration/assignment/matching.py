"""Matching of a lattice to the gauge, over all placements of the gauge's lattice on the observed one.

The score of a placement counts observed dots inside the gauge for it and visible empty positions against it. Fiducials
decide between equal scores, then the smallest rotation of the gauge in the image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2

from calibration.assignment.fiducials import features_promised, features_seen, of_equal_size
from calibration.assignment.lattice import BARE, Lattice, places_without_dot
from calibration.assignment.wrong_gauge import (
    Extent,
    does_not_fit,
    ends_early,
    goes_on,
    place_on_sheet,
    row_offset,
    shows_bare_line,
)
from calibration.detection.dots import Dots
from calibration.errors import CalibrationError
from calibration.gauge.geometry import Gauge

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# The map from gauge to image stretches directions unequally by 1/cos(tilt), twice that at the near edge of a close
# view.
LARGEST_STRETCH = 2.5
# Share of a lattice that may lie outside the gauge: glare and dirt add a few dots, a wrong gauge file whole rows.
FOREIGN = 0.1
THREE_SIGMAS_SQUARED = 9.0  # difference of likeness within which fiducials do not decide between placements


@dataclass(frozen=True)
class Match:
    """Dots of one image and the places of the gauge they are.

    dot: (m,) indices into the Dots. column, row: (m,) of the gauge. certain: the placement is unique, so that origin
    and direction are those of the gauge. unseen: number of places of the gauge in view without a dot. foreign: number
    of dots of the lattice outside the gauge. extent: how the array ends along columns and rows; if it is "short", it
    may belong to another plate (wrong_gauge.py).
    """

    dot: Integers
    column: Integers
    row: Integers
    certain: bool
    unseen: int = 0
    foreign: int = 0
    extent: tuple[Extent, Extent] = ("open", "open")

    def __len__(self) -> int:
        """Count of dots."""
        return len(self.dot)


def match_gauge(dots: Dots, lattice: Lattice, gauge: Gauge) -> Match:
    """Match the gauge to the lattice. Raises CalibrationError if it does not fit."""
    lattice = of_equal_size(dots, lattice, gauge)
    sites, there = _gauge_lattice(gauge), gauge.present()
    places, light = places_without_dot(dots, lattice)
    bare = np.abs(light) < BARE
    affine = np.column_stack([lattice.index, np.ones(len(lattice))])
    basis = np.asarray(np.linalg.lstsq(affine, dots.centers_px[lattice.dot], rcond=None)[0][:2].T, dtype=float)
    features = features_seen(dots, lattice, gauge)
    promised = features_promised(gauge, len(features))
    placements = []
    for turn in _turns(gauge, basis):
        placements += _placements(turn, lattice, places[bare], sites[there], features, promised[:, there])
    if not placements:
        raise CalibrationError(does_not_fit(lattice, gauge))
    best = _choose(placements, bool(gauge.fiducial))
    match = _matched(best, placements, lattice, gauge)
    if not _is_front(best):
        raise CalibrationError(_mirrored(gauge))
    if np.any(promised[:, match.row, match.column]) and best.likeness <= 0:
        raise CalibrationError(_no_fiducials(dots, gauge))
    seen = place_on_sheet(lattice.index @ best.turn.T + best.shift, gauge)
    free = place_on_sheet(places @ best.turn.T + best.shift, gauge)
    if goes_on(seen, gauge):
        raise CalibrationError(does_not_fit(lattice, gauge))
    # fiducials in the right places prove that it is this gauge, even if lines are hidden
    proven = bool(np.any(promised[:, match.row, match.column]))
    if proven:
        return match
    sure = match.certain and not shows_bare_line(seen, free, light, gauge)
    return replace(match, certain=sure, extent=ends_early(seen, free, light, gauge))


def _mirrored(gauge: Gauge) -> str:
    """Message for an array that only the mirror image of the gauge fits."""
    if gauge.fiducial:
        return (
            "the image is mirrored: the fiducials of the gauge fit only the mirrored array; "
            "turn the plate over, or undo the mirroring of the image; if it is not mirrored, count its rows and "
            "columns and set them in gauge.toml"
        )
    other = "even" if gauge.dots.shifted_rows == "odd" else "odd"
    return (
        f'the rows of the array are shifted the other way than the gauge "{gauge.name}" says: counted from 0 at the '
        f"top of the sheet, its {gauge.dots.shifted_rows} rows lie half a pitch to the right; set "
        f'shifted_rows = "{other}" in gauge.toml, or undo the mirroring if the image is mirrored'
    )


def _no_fiducials(dots: Dots, gauge: Gauge) -> str:
    """Message for fiducials that should be in view and are not found."""
    if dots.color.shape[1] == 1 and any(fiducial.color for fiducial in gauge.fiducial):
        return (
            f'the fiducial dots of the gauge "{gauge.name}" differ by their color, which a grey image does not show; '
            "take a color image, or use fiducials of another diameter_mm"
        )
    return (
        f'the fiducial dots of the gauge "{gauge.name}" are not visible at their positions; '
        "is it the gauge of this image?"
    )


@dataclass(frozen=True)
class _Placement:
    """place = turn @ index + shift; inside and empty_inside: counts; likeness: gain of the fiducials, sigmas²."""

    turn: Integers
    shift: Integers
    inside: int
    empty_inside: int
    likeness: float
    angle_rad: float

    @property
    def score(self) -> int:
        return self.inside - self.empty_inside


def _gauge_lattice(gauge: Gauge) -> Integers:
    """Lattice coordinates (rows, columns, 2) of the gauge's places in a primitive basis."""
    column, row = np.meshgrid(np.arange(gauge.dots.columns), np.arange(gauge.dots.rows))
    return np.stack([column - row_offset(row, gauge), row], axis=-1).astype(np.int64)


def _gauge_basis(gauge: Gauge) -> Array:
    """Columns: the primitive basis in mm, x right and y DOWN, as a camera above sees a sheet."""
    across, down = gauge.pitch_mm
    return np.array([[across, across / 2 if gauge.dots.layout == "staggered" else 0.0], [0.0, down]])


def _turns(gauge: Gauge, basis_px: Array) -> list[tuple[Integers, float]]:
    """Unimodular maps from lattice to gauge coordinates that a camera view allows, and the turn of the plate's x axis.

    Right-handed ones show the gauge from the front, the others from behind.
    """
    turns = []
    positions = gauge.positions_mm()
    along = positions[0, 1] - positions[0, 0]  # of the columns, in the plate frame
    x_on_sheet = np.array([1.0, 0.0]) if abs(along[0]) > abs(along[1]) else np.array([0.0, 1.0])
    for entries in product(range(-2, 3), repeat=4):
        turn = np.array(entries).reshape(2, 2)
        if abs(entries[0] * entries[3] - entries[1] * entries[2]) != 1:
            continue
        image_from_gauge = basis_px @ np.linalg.inv(_gauge_basis(gauge) @ turn)
        long, short = np.linalg.svd(image_from_gauge, compute_uv=False)
        if long / short < LARGEST_STRETCH:
            x_axis = image_from_gauge @ x_on_sheet
            turns.append((turn, float(long / short), float(np.arctan2(x_axis[1], x_axis[0]))))
    least = min((stretch for _, stretch, _ in turns), default=1.0)
    # the least stretched map is the view closest to vertical; symmetric ones differ by less than the stretch of the
    # tilt
    return [(turn, angle) for turn, stretch, angle in turns if stretch < 1.6 * least]


def _placements(
    turn: tuple[Integers, float], lattice: Lattice, empty: Integers, sites: Integers, features: Array, expected: Array
) -> list[_Placement]:
    """The placements of one turn with nearly as many dots inside the array as the best of them."""
    matrix, angle = turn
    seen, void = lattice.index @ matrix.T, empty @ matrix.T
    corner = np.minimum(seen.min(axis=0), void.min(axis=0, initial=10**9))
    extent = np.maximum(seen.max(axis=0), void.max(axis=0, initial=-(10**9))) - corner + 1
    site_corner = sites.min(axis=0)
    gauge_extent = sites.max(axis=0) - site_corner + 1
    if np.any(np.concatenate([extent, gauge_extent]) > 2000):
        return []
    mask = np.zeros(gauge_extent)
    place = sites - site_corner
    mask[place[..., 0], place[..., 1]] = 1.0
    observed, vacant = np.zeros(extent), np.zeros(extent)
    observed[tuple((seen - corner).T)] = 1.0
    vacant[tuple((void - corner).T)] = 1.0

    lags = tuple((gauge_extent + extent - 1).tolist())
    padded = tuple(next_fast_len(count, real=True) for count in lags)

    def correlated(kernel: Array, image: Array) -> Array:
        product_of_spectra = rfft2(kernel, padded) * rfft2(image[::-1, ::-1], padded)
        return np.asarray(irfft2(product_of_spectra, padded))[: lags[0], : lags[1]]

    inside, hollow = np.rint(correlated(mask, observed)), np.rint(correlated(mask, vacant))
    likeness = np.zeros_like(inside)
    for feature, wanted in zip(features, expected, strict=True):
        if np.any(wanted):
            values, target = np.zeros(extent), np.zeros(gauge_extent)
            values[tuple((seen - corner).T)] = feature
            target[place[..., 0], place[..., 1]] = wanted
            likeness += 2 * correlated(target, values) - correlated(target**2, observed)
    score = inside - hollow
    near = np.argwhere(score >= score.max() - 0.02 * len(lattice) - 1e-6)
    # output index k of the correlation: site = seen-corner + k - (extent-1)
    return [
        _Placement(
            matrix,
            k - (extent - 1) - corner + site_corner,
            int(inside[*k]),
            int(hollow[*k]),
            float(likeness[*k]),
            angle,
        )
        for k in near
    ]


def _choose(placements: list[_Placement], fiducials: bool) -> _Placement:
    most = max(placement.score for placement in placements)
    slack = 0.02 * max(placement.inside for placement in placements)
    near = [placement for placement in placements if placement.score >= most - slack]
    if fiducials:
        likest = max(placement.likeness for placement in near)
        near = [placement for placement in near if placement.likeness > likest - THREE_SIGMAS_SQUARED]
    most = max(placement.score for placement in near)
    near = [placement for placement in near if placement.score == most]
    front = [placement for placement in near if _is_front(placement)] or near
    return min(front, key=lambda placement: _turned(placement.angle_rad))


def _is_front(placement: _Placement) -> bool:
    turn = placement.turn
    return bool(turn[0, 0] * turn[1, 1] - turn[0, 1] * turn[1, 0] > 0)


def _turned(angle: float) -> float:
    """Turn from the image's x axis; of two opposite ones at right angles the counter-clockwise wins."""
    return abs(float(np.angle(np.exp(1j * (angle + 1e-3)))))


def _matched(best: _Placement, placements: list[_Placement], lattice: Lattice, gauge: Gauge) -> Match:
    foreign = len(lattice) - best.inside
    if foreign > max(2.0, FOREIGN * len(lattice)):
        raise CalibrationError(does_not_fit(lattice, gauge))
    table = _places(gauge)
    where = lattice.index @ best.turn.T + best.shift
    rows, columns, chosen = [], [], []
    for k, site in enumerate(map(tuple, where.tolist())):
        if site in table:
            row, column = table[site]
            rows.append(row)
            columns.append(column)
            chosen.append(k)
    # an equally good placement, shifted or turned by other than half a turn, leaves the origin undetermined
    as_good = [
        other
        for other in placements
        if other.score >= best.score and other.likeness >= best.likeness - THREE_SIGMAS_SQUARED
    ]
    # placements turned by half a turn: one is excluded by convention, several differ by a shift as well; fiducials that
    # fit both ways, because the view is cut, leave open which of them is the first
    opposite = [other for other in as_good if np.array_equal(other.turn, -best.turn)]
    rivals = [
        other
        for other in as_good
        if _is_front(other)
        and not np.array_equal(other.turn, -best.turn)
        and not (np.array_equal(other.turn, best.turn) and np.array_equal(other.shift, best.shift))
    ]
    return Match(
        dot=lattice.dot[np.array(chosen, dtype=np.int64)],
        column=np.array(columns, dtype=np.int64),
        row=np.array(rows, dtype=np.int64),
        certain=not rivals and len(opposite) <= (0 if gauge.fiducial else 1),
        unseen=best.empty_inside,
        foreign=foreign,
    )


def _places(gauge: Gauge) -> dict[tuple[int, int], tuple[int, int]]:
    sites = _gauge_lattice(gauge)
    return {
        (int(sites[row, column, 0]), int(sites[row, column, 1])): (row, column)
        for row, column in np.argwhere(gauge.present()).tolist()
    }
