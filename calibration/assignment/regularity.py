"""Regularity of a lattice: three neighbouring dots of a row lie on a line from every viewpoint.

Dots of an array deviate from the line by less than 0.01 pitches. Specks that happen to continue a lattice are accepted
within a quarter of a pitch from their predicted places, and deviate by as much.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.detection.disturbed import useful

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

ROWS = np.array([(1, 0), (0, 1), (1, 1), (1, -1)])
# Deviations in pitches. Specks accepted by chance within 0.28 of a place deviate by 0.2, the best of many dozen by
# 0.08; dots in photographs, including fisheyes, by 0.0001 to 0.007.
CHANCE, SOUND = 0.1, 0.01
# A member is removed if it deviates from all of its rows by more than OFF and by more than UNUSUAL times the usual
# deviation; a member that is less sharp than the others, already beyond OFF_BLURRED.
OFF, OFF_BLURRED, UNUSUAL = 0.05, 0.005, 6.0
FEWEST = 6  # members in rows, and rows: fewer do not allow a test


def _rows_of_three(points: Array, index: Integers) -> tuple[Integers, Array]:
    """Neighbouring members of a row (k, 3), and the deviation of the middle one from its line, in pitches, (k,)."""
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
    """Deviation of each member from the straightest of its rows of three, in pitches, (m,); infinite without a row.

    points: (m, 2) px. index: (m, 2) places.
    """
    least = np.full(len(points), np.inf)
    rows, off = _rows_of_three(points, index)
    for k in range(3):
        np.minimum.at(least, rows[:, k], off)
    return least


def regular(points: Array, covariance_px2: Array, index: Integers) -> NDArray[np.bool_]:
    """Which members of a lattice belong to it, (m,): those in a row with two others that is as straight as other rows.

    points: (m, 2) px. covariance_px2: (m, 2, 2) of these. index: (m, 2).
    """
    keep = np.ones(len(points), dtype=bool)
    while True:
        rows = np.flatnonzero(keep)
        off = off_rows(points[rows], index[rows])
        in_row = np.isfinite(off)
        if in_row.sum() < FEWEST:
            return keep
        # Beside missing dots a member may have no row, but it must not lie outside all rows of the others.
        first, last = index[rows[in_row]].min(axis=0), index[rows[in_row]].max(axis=0)
        sharp = useful(covariance_px2[rows])
        off[~in_row & sharp & ((index[rows] >= first) & (index[rows] <= last)).all(axis=1)] = 0.0
        least = np.where(sharp, OFF, OFF_BLURRED)
        sound = off < np.maximum(least, UNUSUAL * float(np.median(off[in_row])))
        if sound.all() or sound.sum() < FEWEST:
            return keep
        keep[rows[~sound]] = False


def evidence(points: Array, index: Integers) -> float:
    """Logarithm of the straightness of the rows of a lattice relative to chance; 0 if chance explains it.

    points: (m, 2) px. index: (m, 2).
    """
    rows, off = _rows_of_three(points, index) if len(points) else (np.empty(0), np.empty(0))
    if len(rows) < FEWEST:
        return 0.0
    usual = float(np.sqrt(np.mean(np.minimum(off, 1.0) ** 2)))
    return float(np.log(CHANCE / max(usual, SOUND))) if usual < OFF else 0.0
