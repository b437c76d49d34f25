"""Faults that trackers leave in their files: last places of lost marks, exchanged marks, rows twice, coarse times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evaluator.marks import columns_of, is_of_film, points_of
from evaluator.recording.coarse_clock import even_times
from evaluator.robust import robust_sigma
from evaluator.wording import counted

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


@dataclass(frozen=True)
class Mended:
    """Marks of a table as they were before a tracker lost or exchanged them.

    time_s: (n,), even if a coarse clock told them; clock_step_s: its step, or 0. places_mm: (n, m, 2) by names, NaN
    where a mark is missing. exchanged: (n,), lost: (n, m), rows of the table that were wrong. repeated: rows of its
    file that it lacks because they were written twice. of_film: see marks.is_of_film.
    """

    names: tuple[str, ...]
    time_s: Floats
    places_mm: Floats
    exchanged: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    repeated: int = 0
    of_film: bool = False
    clock_step_s: float = 0.0

    @property
    def notes(self) -> list[str]:
        """Sentences that count the wrong rows."""
        found, count = [], len(self.time_s)
        if self.repeated:
            found.append(f"{counted(self.repeated, 'row')} written twice, with the same time and places, count once")
        if self.clock_step_s:
            interval = float(np.median(np.diff(self.time_s)))
            found.append(
                f"time_s is told in steps of {1e3 * self.clock_step_s:.3g} ms by a coarse or rounded clock; the "
                f"frames lie evenly, {1e3 * interval:.4g} ms apart, and are taken so"
            )
        if self.exchanged.any():
            first, second = self.names
            rows = f"{self.exchanged.sum()} of {count} rows"
            found.append(f"{first} and {second} are exchanged in {rows}, and are put back there")
        lost = zip(self.names, self.lost.sum(axis=0), strict=True)
        if said := ", ".join(f"{name} in {rows} of {count} rows" for name, rows in lost if rows):
            found.append(f"marks repeat their last place while the robot moves, and do not count there: {said}")
        return found


def mended(table: pd.DataFrame, names: Sequence[str]) -> Mended:
    """Marks of a table (evaluator.marks) in mm with repeated places missing, exchanged marks put back and even times.

    Two marks were exchanged where the robot turns by half a revolution at once; the larger part of the rows is assumed
    to be right. Three and more marks are distinguished by their distances.
    """
    time_s, count = table["time_s"].to_numpy(float, copy=True), len(table)
    time_s, clock_step_s = even_times(time_s) or (time_s, 0.0)
    places = points_of(table, names) if names else np.zeros((count, 0, 2))
    exchanged = np.zeros(count, dtype=np.bool_)
    if len(names) == 2:
        exchanged = _exchanged(places[:, 0], places[:, 1], time_s)
        places[exchanged] = places[exchanged][:, ::-1]
    lost = _lost(places)
    places[lost] = np.nan
    repeated = int(table.attrs.get("repeated", 0))
    return Mended(tuple(names), time_s, places, exchanged, lost, repeated, is_of_film(table), clock_step_s)


def without_faults(table: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """A marks table in mm without the faults that `mended` finds, whose notes are attrs["faults"] of the result."""
    found, changed = mended(table, names), table.copy()
    changed["time_s"] = found.time_s
    if found.exchanged.any():
        for name in [str(name) for name in table if str(name).startswith(f"{names[0]}_")]:
            other = f"{names[1]}{name.removeprefix(names[0])}"
            if other in table:
                one, two = table[name].to_numpy(copy=True), table[other].to_numpy(copy=True)
                changed[name], changed[other] = (
                    np.where(found.exchanged, two, one),
                    np.where(found.exchanged, one, two),
                )
    for name, rows in zip(names, found.lost.T, strict=True):
        if rows.any():
            changed.loc[rows, columns_of([name])] = np.nan
    changed.attrs["faults"] = found.notes
    return changed


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


def _lost(places: Floats) -> NDArray[np.bool_]:
    """Rows (n, m) in which marks (n, m, 2) repeat a place although they were lost.

    A mark that stays exactly where it was for FEWEST_ROWS or more is lost if its distance from another mark changes
    meanwhile, which no rigid robot does.
    """
    lost = np.zeros(places.shape[:2], dtype=np.bool_)
    still = [_stretches(place) for place in np.moveaxis(places, 1, 0)]
    for first, second in combinations(range(len(still)), 2):
        if not still[first] and not still[second]:
            continue
        apart = np.hypot(*(places[:, first] - places[:, second]).T)
        moving = np.isfinite(apart)
        for begin, end in (*still[first], *still[second]):
            moving[begin:end] = False
        if not moving.any():
            continue
        usual = float(np.median(apart[moving]))
        most = max(SIGMAS * robust_sigma(apart[moving]), LEAST_SHARE * usual)
        for mark in (first, second):
            for begin, end in still[mark]:
                if np.any(np.abs(apart[begin:end] - usual) > most):  # false for NaN: the other mark is not visible
                    lost[begin + 1 : end, mark] = True
    return lost


def _stretches(place: Floats) -> list[tuple[int, int]]:
    """First row and row after the last of all stretches of FEWEST_ROWS or more equal places (n, 2)."""
    new = np.r_[True, (place[1:] != place[:-1]).any(axis=1), True]
    edges = np.flatnonzero(new)
    return [(int(b), int(e)) for b, e in pairwise(edges) if e - b >= FEWEST_ROWS]
