"""Marks that a tracker lost and wrote at their last place: no measurements, though the file does not say so."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evaluator.marks import columns_of
from evaluator.robust import robust_sigma

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

FEWEST_ROWS = 4  # of equal places in a row: rounding to hundredths of a millimetre makes two or three of a slow mark
SIGMAS = 6.0  # robust standard deviations of the distance of two marks, which is that of a rigid body
LEAST_SHARE = 0.02  # of this distance: a keystone of the camera changes it by about as much over a plate


def without_held(table: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """A marks table (evaluator.marks) in mm with repeated places of a lost mark set to NaN.

    A mark that stays exactly where it was for FEWEST_ROWS or more is lost if its distance from another mark changes
    meanwhile, which no rigid robot does. names: marks of the table. attrs["held"] of the result is a note that counts
    the missing places, "" if there are none.
    """
    places = {name: table[columns_of([name])].to_numpy(float) for name in names}
    still = {name: _stretches(place) for name, place in places.items()}
    lost = {name: np.zeros(len(table), dtype=np.bool_) for name in names}
    for first, second in combinations(names, 2):
        apart = np.hypot(*(places[first] - places[second]).T)
        moving = np.isfinite(apart)
        for begin, end in (*still[first], *still[second]):
            moving[begin:end] = False
        if not moving.any():
            continue
        usual = float(np.median(apart[moving]))
        most = max(SIGMAS * robust_sigma(apart[moving]), LEAST_SHARE * usual)
        for name in (first, second):
            for begin, end in still[name]:
                if np.any(np.abs(apart[begin:end] - usual) > most):  # NaN, if the other mark is not seen, is not
                    lost[name][begin + 1 : end] = True
    counts = {name: int(rows.sum()) for name, rows in lost.items() if rows.any()}
    said = ", ".join(f"{name} in {count} of {len(table)} rows" for name, count in counts.items())
    note = f"marks repeat their last place while the robot moves, and do not count there: {said}" if counts else ""
    changed = table.copy()
    changed.attrs["held"] = note
    for name in counts:
        changed.loc[lost[name], columns_of([name])] = np.nan
    return changed


def _stretches(place: Floats) -> list[tuple[int, int]]:
    """First row and row after the last of all stretches of FEWEST_ROWS or more equal places (n, 2)."""
    new = np.r_[True, (place[1:] != place[:-1]).any(axis=1), True]
    edges = np.flatnonzero(new)
    return [(int(b), int(e)) for b, e in pairwise(edges) if e - b >= FEWEST_ROWS]
