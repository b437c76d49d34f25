"""Dot centres → lattice indices, without a given count: holes, partial views and distractors are expected.

Indices refer to a right-handed reduced basis as seen in the image (x right, y down); matching.py assigns them to the
dots of the gauge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.assignment.completion import completed, without_strays
from calibration.assignment.growth import NEIGHBOURS, OPPOSITE, SLANTED, bucket, grow, seed_bases
from calibration.assignment.neighbours import nearest
from calibration.assignment.regularity import regular
from calibration.assignment.relative_size import relative_size
from calibration.detection.dots import Dots

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
SEEDS = 12  # attempts: distractors may form small lattices, and a torn sheet several
ODD = 0.26  # of ln(diameter) relative to the dots around: fiducials differ by more, equal dots by 0.05
SPECK = 0.4  # of the diameter of the dots around: no gauge has fiducials that small
# Of the median contrast. Vignetting and uneven light leave at least 0.25 (0.4 on a real fisheye); reflections of the
# array in the dark surround of a lens have less, and lie pixels beside the places that they seem to continue.
FAINT = 0.15
# A place without a dot shows the sheet if its brightness equals that of the sheet next to it within this share of the
# dots' contrast.
BARE = 0.35
# For a part that is separated by a cloth or a rod: number of dots of the main lattice beside it that predict its
# places, and largest distance of its dots from them, in pitches. Distortion shifts a prediction over three pitches by a
# few percent.
BESIDE, OFF_PLACE = 24, 0.2
SMALLEST_LATTICE = 6  # dots
SECOND = 10  # dots: a smaller second array may be chance
FEW = 100  # dots: smaller arrays are also searched with looser seeds


# Ratio of the distances of dots along and across the rows of a staggered array, beyond which it is read the other way.
# It is √3 for a hexagonal array read so, and 1 for a square one that is turned by 45 degrees; this is the geometric
# mean.
NEARER = 3**0.25


@dataclass(frozen=True, eq=False)  # arrays cannot be compared by ==: lattices are equal if identical
class Lattice:
    """Dots that form one lattice.

    dot: (m,) indices into the Dots. index: (m, 2) integer lattice coordinates (a, b), a unique pair per dot. others:
    count of dots in further lattices of at least half this one's size: a second plate in view.
    """

    dot: Integers
    index: Integers
    others: int = 0

    def __len__(self) -> int:
        """Count of dots assigned."""
        return len(self.dot)


NO_LATTICE = Lattice(np.empty(0, dtype=np.int64), np.empty((0, 2), dtype=np.int64))


def assign_grid(dots: Dots) -> Lattice:
    """Find the largest lattice among the dots; an empty one if there is none."""
    points = np.ascontiguousarray(dots.centers_px)
    if len(points) < SMALLEST_LATTICE:
        return NO_LATTICE
    best = _largest(dots, points, OPPOSITE)
    if len(points) <= FEW or len(best) <= FEW:
        slanted = _largest(dots, points, SLANTED)
        equal = _same(slanted, best)  # in most images; completion is slow and is then done once
        best = _completed(dots, best)
        slanted = best if equal else _completed(dots, slanted)
        best = slanted if len(slanted) > len(best) else best
    if not len(best) or np.linalg.matrix_rank(best.index - best.index[0]) < 2:  # a single row is no array
        return NO_LATTICE
    best = _without_specks(dots, replace(best, index=_reduced(points[best.dot], best.index)))
    keep = regular(points[best.dot], dots.covariance_px2[best.dot], best.index)
    return Lattice(best.dot[keep], best.index[keep], best.others)


def _completed(dots: Dots, lattice: Lattice) -> Lattice:
    """A small lattice with further dots that continue it, and without members that do not fit."""
    if not SMALLEST_LATTICE <= len(lattice) <= FEW:
        return lattice
    all_dots = dots.centers_px, dots.diameter_px, dots.contrast
    dot, index = completed(*all_dots, lattice.dot, lattice.index)
    keep = without_strays(dots.centers_px, dot, index)
    if not keep.all():  # without the strays, further dots may be found
        dot, index = completed(*all_dots, dot[keep], index[keep])
    return Lattice(dot, index, lattice.others)


def _same(one: Lattice, other: Lattice) -> bool:
    """Whether two lattices hold the same dots at the same places."""
    return np.array_equal(one.dot, other.dot) and np.array_equal(one.index, other.index)


def _largest(dots: Dots, points: Array, opposite_share: float) -> Lattice:
    """The largest lattice that grows from a seed, joined with parts that an occlusion separates from it."""
    distance, neighbours = nearest(points, NEIGHBOURS)
    bases, mismatch = seed_bases(points, neighbours, opposite_share)
    size = float(np.median(distance[:, 0]))
    cells, following, origin = bucket(points, size)
    odd = np.abs(relative_size(points, dots.diameter_px, neighbours)) > ODD
    mismatch[odd] = np.inf
    taken = np.zeros(len(points), dtype=bool)
    found: list[Lattice] = []
    for seed in np.argsort(mismatch, kind="stable"):
        if len(found) == SEEDS or not np.isfinite(mismatch[seed]):
            break
        if taken[seed]:
            continue
        index, member = grow(points, seed, bases[seed], odd, taken, cells, following, size, origin)
        dot = np.flatnonzero(member >= 0)
        taken[dot] = True
        if len(dot) >= SMALLEST_LATTICE:
            found.append(Lattice(dot, index[dot]))
        if (~taken).sum() <= max((len(lattice) for lattice in found), default=0) // 4:
            break
    if not found:
        return NO_LATTICE
    best = max(found, key=len)
    rest = sorted((lattice for lattice in found if lattice is not best), key=len, reverse=True)
    for lattice in list(rest):
        joined = _joined(points, best, lattice)
        if joined is not None:
            best = joined
            rest.remove(lattice)
    second = max(SECOND, len(best) / 2)
    # The weave of a cloth beside the gauge also forms an array, with low contrast.
    plain = FAINT * np.median(dots.contrast[best.dot])
    rivals = (one for one in rest if len(one) >= second and np.median(dots.contrast[one.dot]) > plain)
    return replace(best, others=sum(map(len, rivals)))


def _joined(points: Array, main: Lattice, part: Lattice) -> Lattice | None:
    """Join two parts of a lattice that an occlusion separates; None if the part does not continue the main one.

    The homography of the main's dots next to the part predicts the indices of the part's dots: these must be integers
    and agree with the part's indices up to a shift.
    """
    middle = points[part.dot].mean(axis=0)
    near = np.argsort(np.hypot(*(points[main.dot] - middle).T))[:BESIDE]
    if len(near) < BESIDE or len(part) < SMALLEST_LATTICE:
        return None
    to_index = cv2.findHomography(points[main.dot[near]], main.index[near].astype(float), 0)[0]
    if to_index is None:
        return None
    guess = cv2.perspectiveTransform(points[part.dot][None], to_index)[0]
    index = np.rint(guess).astype(np.int64)
    own = np.column_stack([part.index, np.ones(len(part))])
    runs = np.rint(np.linalg.lstsq(own, guess, rcond=None)[0]).astype(np.int64)
    taken = set(map(tuple, main.index.tolist()))
    if (
        np.abs(guess - index).max() > OFF_PLACE
        or abs(int(runs[0, 0] * runs[1, 1] - runs[0, 1] * runs[1, 0])) != 1
        or not np.array_equal(part.index @ runs[:2] + runs[2], index)
        or any(tuple(place) in taken for place in index.tolist())
    ):
        return None
    return Lattice(np.concatenate([main.dot, part.dot]), np.concatenate([main.index, index]))


def _without_specks(dots: Dots, lattice: Lattice) -> Lattice:
    """Remove members that are far smaller than those around them, or faint: dirt and reflections near a place."""
    _, neighbours = nearest(dots.centers_px[lattice.dot], 8)
    size, contrast = dots.diameter_px[lattice.dot], dots.contrast[lattice.dot]
    keep = (size > SPECK * np.median(size[neighbours], axis=1)) & (contrast > FAINT * np.median(contrast))
    return Lattice(lattice.dot[keep], lattice.index[keep], lattice.others)


def _reduced(points: Array, index: Integers) -> Integers:
    """Express indices in the shortest basis (Lagrange, Gauss); growth from a seed beside a hole may give a skew one."""
    affine = np.linalg.lstsq(np.column_stack([index, np.ones(len(index))]), points, rcond=None)[0]
    u, v = affine[0], affine[1]
    change = np.eye(2, dtype=np.int64)  # rows: new basis in terms of the old
    for _ in range(20):
        if u @ u > v @ v:
            u, v, change = v, -u, np.stack([change[1], -change[0]])
        shear = round(float(u @ v) / float(u @ u))
        if shear == 0:
            break
        v, change = v - shear * u, np.stack([change[0], change[1] - shear * change[0]])
    inverse = np.rint(np.linalg.inv(change)).astype(np.int64)
    return np.asarray(index @ inverse)


def rows_and_columns(lattice: Lattice) -> tuple[str, Integers]:
    """The layout that fills its bounding box best, and (m, 2) column and row in it, counted from 0.

    "square": column and row along the basis. "staggered": along its diagonals, odd rows shifted by half a pitch.
    """
    layout, across, down = _reading(lattice)
    return layout, np.stack([across // (2 if layout == "staggered" else 1), down], 1)


def _reading(lattice: Lattice) -> tuple[str, Integers, Integers]:
    """Layout, and steps across and down of every dot, (m,), from 0; dots in a row of a staggered array are 2 apart."""
    a, b = lattice.index.T
    options = [("square", a, b)]
    pairs = ((a - b, a + b), (a + b, b - a), (2 * a + b, b), (2 * b + a, a), (2 * a - b, b), (2 * b - a, a))
    options += [("staggered", *pair) for pair in pairs]
    best, most = options[0], 0.0
    for layout, across, down in options:
        columns, rows = np.ptp(across) + 1, np.ptp(down) + 1
        if layout == "staggered":
            columns = (columns + 1) // 2
        # a view cut by the image's rim fills no box well: the plain layout then stays unless the other is clearly
        # fuller
        fill = len(lattice) / float(columns * rows) - (0.1 if layout == "staggered" else 0.0)
        if fill > most:
            best, most = (layout, across, down), fill
    layout, across, down = best
    return layout, across - across.min(), down - down.min()


def array_size(lattice: Lattice, points_px: Array) -> tuple[str, int, int]:
    """Layout, and number of dots across and down as the image shows it.

    points_px: (m, 2) positions of the lattice's dots. Both rows and columns of a staggered array are shifted
    alternately, so that 14 × 24 dots are 12 × 28 as well: rows are along the smaller distance between dots.
    """
    layout, across, down = _reading(lattice)
    step, *_ = np.linalg.lstsq(np.c_[across, down, np.ones(len(across))], points_px, rcond=None)
    if layout == "square":
        columns, rows = int(across.max()) + 1, int(down.max()) + 1
        upright = abs(step[0, 1]) > abs(step[0, 0])  # the lattice's columns run down the image
        return (layout, rows, columns) if upright else (layout, columns, rows)
    across_px, down_px = np.hypot(*step[:2].T)
    if across_px > NEARER * down_px:
        across, down = down, across
    return layout, (int(across.max()) + 2) // 2, int(down.max()) + 1


def places_without_dot(dots: Dots, lattice: Lattice) -> tuple[Integers, Array]:
    """Lattice places without a dot, next to dots and well inside the image: (k, 2), and their light (k,).

    The light is relative to the sheet beside the nearest dots, in units of their contrast. A place within BARE of the
    sheet shows the sheet and has no dot; at other places a dot may be hidden.
    """
    corner = lattice.index.min(axis=0) - 2
    extent = lattice.index.max(axis=0) - corner + 3
    grid = np.full((*extent, 2), np.nan)
    at = lattice.index - corner
    grid[at[:, 0], at[:, 1]] = dots.centers_px[lattice.dot]
    level = np.full((*extent, 2), np.nan)  # of the sheet, and of the dots below it
    level[at[:, 0], at[:, 1]] = np.stack([dots.background, dots.contrast], axis=1)[lattice.dot]
    smooth = cv2.blur(dots.plane, (3, 3))
    width, height = dots.size_px
    margin = float(np.median(dots.diameter_px[lattice.dot]))
    light: dict[tuple[int, int], float] = {}
    for da, db in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        behind, sheet = np.roll(grid, (da, db), axis=(0, 1)), np.roll(level, (da, db), axis=(0, 1))
        guess = 2 * behind - np.roll(grid, (2 * da, 2 * db), axis=(0, 1))
        with np.errstate(invalid="ignore"):
            free = np.isnan(grid[..., 0]) & (guess[..., 0] > margin) & (guess[..., 0] < width - 1 - margin)
            free &= (guess[..., 1] > margin) & (guess[..., 1] < height - 1 - margin)
        for a, b in np.argwhere(free).tolist():
            x, y = np.rint(guess[a, b]).astype(int)
            above = (float(smooth[y, x]) - sheet[a, b, 0]) / sheet[a, b, 1]
            light[a, b] = min(light.get((a, b), above), above, key=abs)
    places = np.array(sorted(light), dtype=np.int64).reshape(-1, 2)
    return places + corner, np.array([light[a, b] for a, b in places.tolist()])
