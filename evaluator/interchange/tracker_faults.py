"""Faults that trackers leave in their files: last places of marks that they lost, and marks that they exchanged."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evaluator.marks import columns_of, points_of
from evaluator.robust import robust_sigma

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]

FEWEST_ROWS = 4  # of equal places; rounding to 0.01 mm gives a slow mark two or three equal places in succession
SIGMAS = 6.0  # robust standard deviations of the distance of two marks, which is that of a rigid body
# Smallest change of the heading between two rows that counts as an exchange of the marks: half a revolution, minus the
# turn of the robot in between, which its usual yaw rate must explain.
LEAST_EXCHANGED_RAD = 2 * np.pi / 3
SOUND_SHARE = 0.2  # of the usual distance of both marks: if it deviates by more, one of the marks is wrong
LEAST_SHARE = 0.02  # of this distance: a keystone of the camera changes it by about as much over a plate


def without_faults(table: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """A marks table (evaluator.marks) in mm with repeated places missing and exchanged marks put back.

    names: marks of the table. attrs["faults"] of the result are notes that count the rows.
    """
    changed, notes = table.copy(), []
    for mend in (_put_back, _without_repeated):
        note = mend(changed, names)
        notes += [note] if note else []
    changed.attrs["faults"] = notes
    return changed


def _put_back(table: pd.DataFrame, names: Sequence[str]) -> str:
    """Exchange two marks where a tracker exchanged them, in place; a note that counts the rows, "" if there are none.

    The larger part of the rows is assumed to be right. Three and more marks are distinguished by their distances.
    """
    if len(names) != 2:
        return ""
    first, second = np.moveaxis(points_of(table, names), 1, 0)
    rows = _exchanged(first, second, table["time_s"].to_numpy(float))
    if not rows.any():
        return ""
    for name in [str(name) for name in table if str(name).startswith(f"{names[0]}_")]:
        other = f"{names[1]}{name.removeprefix(names[0])}"
        if other in table:
            one, two = table[name].to_numpy(copy=True), table[other].to_numpy(copy=True)
            table[name], table[other] = np.where(rows, two, one), np.where(rows, one, two)
    return f"{names[0]} and {names[1]} are exchanged in {rows.sum()} of {len(table)} rows, and are put back there"


def _exchanged(first: Floats, second: Floats, time_s: Floats) -> NDArray[np.bool_]:
    """Rows (n,) in which two marks (n, 2) are exchanged: the robot seems to turn by half a revolution at once."""
    rows = np.zeros(len(time_s), dtype=np.bool_)
    seen = np.flatnonzero(np.isfinite(first + second).all(axis=1))
    if len(seen) < FEWEST_ROWS:
        return rows
    line, steps_s = (first - second)[seen], np.maximum(np.diff(time_s[seen]), 1e-9)
    turned = np.abs(np.angle(np.exp(1j * np.diff(np.arctan2(line[:, 1], line[:, 0])))))
    usual = float(np.median(np.minimum(turned, np.pi - turned) / steps_s)) * steps_s  # blind to an exchange
    apart = np.hypot(line[:, 0], line[:, 1])
    sound = np.abs(apart - np.median(apart)) < SOUND_SHARE * np.median(apart)
    places = (turned > LEAST_EXCHANGED_RAD) & (usual < np.pi - LEAST_EXCHANGED_RAD) & sound[1:] & sound[:-1]
    odd = np.r_[False, np.cumsum(places) % 2 == 1]
    if 2 * odd.sum() > len(odd):
        odd = ~odd
    rows[:] = odd[np.maximum(np.searchsorted(seen, np.arange(len(rows)), side="right") - 1, 0)]
    return rows


def _without_repeated(table: pd.DataFrame, names: Sequence[str]) -> str:
    """Set repeated places of a lost mark to NaN, in place; a note that counts them, "" if there are none.

    A mark that stays exactly where it was for FEWEST_ROWS or more is lost if its distance from another mark changes
    meanwhile, which no rigid robot does.
    """
    places = dict(zip(names, np.moveaxis(points_of(table, names), 1, 0), strict=True)) if names else {}
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
                if np.any(np.abs(apart[begin:end] - usual) > most):  # false for NaN: the other mark is not visible
                    lost[name][begin + 1 : end] = True
    counts = {name: int(rows.sum()) for name, rows in lost.items() if rows.any()}
    for name in counts:
        table.loc[lost[name], columns_of([name])] = np.nan
    said = ", ".join(f"{name} in {count} of {len(table)} rows" for name, count in counts.items())
    return f"marks repeat their last place while the robot moves, and do not count there: {said}" if counts else ""


def _stretches(place: Floats) -> list[tuple[int, int]]:
    """First row and row after the last of all stretches of FEWEST_ROWS or more equal places (n, 2)."""
    new = np.r_[True, (place[1:] != place[:-1]).any(axis=1), True]
    edges = np.flatnonzero(new)
    return [(int(b), int(e)) for b, e in pairwise(edges) if e - b >= FEWEST_ROWS]
