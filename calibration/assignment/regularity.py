"""Regularity of a lattice: three neighbouring dots of a row lie on a line from every viewpoint.

Dots of an array leave the line by less than a hundredth of a pitch. Specks that happen to continue a lattice are taken
wherever they lie within the reach of its growth, a quarter of a pitch, and leave it by as much.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.detection.disturbed import useful

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

ROWS = np.array([(1, 0), (0, 1), (1, 1), (1, -1)])
# Of a pitch: what chance takes within 0.28 of its place leaves its rows by 0.2, the luckiest of many dozen specks by
# 0.08; the dots of photographs, fisheyes included, leave them by 0.0001 to 0.007.
CHANCE, SOUND = 0.1, 0.01
# A member that leaves all of its rows by more, and by so many times what is usual, is none; one that is less sharp than
# the others already where it leaves them by more than dots do.
OFF, OFF_BLURRED, UNUSUAL = 0.05, 0.005, 6.0
FEWEST = 6  # members that stand in rows, and rows: fewer tell nothing


def _rows_of_three(points: Array, index: Integers) -> tuple[Integers, Array]:
    """Members that stand side by side in a row (k, 3), and how far the middle one leaves it, in pitches, (k,)."""
    at = index - index.min(axis=0) + 1
    grid = np.full(at.max(axis=0) + 2, -1)
    grid[at[:, 0], at[:, 1]] = np.arange(len(at))
    found = []
    for step in ROWS:
        ahead, behind = (grid[tuple((at + sign * step).T)] for sign in (1, -1))
        middle = np.flatnonzero((ahead >= 0) & (behind >= 0))
        found.append(np.stack([behind[middle], middle, ahead[middle]], axis=1))
    rows = np.concatenate(found)
    first, middle, last = (points[rows[:, k]] for k in range(3))
    arm, to_middle = last - first, middle - first
    square = np.maximum((arm**2).sum(axis=1), 1e-12)
    return rows, 2.0 * np.abs(arm[:, 0] * to_middle[:, 1] - arm[:, 1] * to_middle[:, 0]) / square


def off_rows(points: Array, index: Integers) -> Array:
    """How far each member leaves the straightest of its rows of three, in pitches, (m,); infinite without a row.

    points: (m, 2) px. index: (m, 2) places.
    """
    least = np.full(len(points), np.inf)
    rows, off = _rows_of_three(points, index)
    for k in range(3):
        np.minimum.at(least, rows[:, k], off)
    return least


def regular(points: Array, covariance_px2: Array, index: Integers) -> NDArray[np.bool_]:
    """Which members of a lattice belong to it, (m,): in a row with two others, straight as the rows of the others are.

    points: (m, 2) px. covariance_px2: (m, 2, 2) of these. index: (m, 2).
    """
    keep = np.ones(len(points), dtype=bool)
    while True:
        rows = np.flatnonzero(keep)
        off = off_rows(points[rows], index[rows])
        in_row = np.isfinite(off)
        if in_row.sum() < FEWEST:
            return keep
        # Where dots are missing one may stand alone, but not beyond all rows of the others.
        first, last = index[rows[in_row]].min(axis=0), index[rows[in_row]].max(axis=0)
        sharp = useful(covariance_px2[rows])
        off[~in_row & sharp & ((index[rows] >= first) & (index[rows] <= last)).all(axis=1)] = 0.0
        least = np.where(sharp, OFF, OFF_BLURRED)
        sound = off < np.maximum(least, UNUSUAL * float(np.median(off[in_row])))
        if sound.all() or sound.sum() < FEWEST:
            return keep
        keep[rows[~sound]] = False


def evidence(points: Array, index: Integers) -> float:
    """Logarithm of how much straighter the rows of a lattice are than chance makes them; 0 for what may be chance."""
    rows, off = _rows_of_three(points, index) if len(points) else (np.empty(0), np.empty(0))
    if len(rows) < FEWEST:
        return 0.0
    usual = float(np.sqrt(np.mean(np.minimum(off, 1.0) ** 2)))
    return float(np.log(CHANCE / max(usual, SOUND))) if usual < OFF else 0.0
