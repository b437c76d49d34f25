"""Rolling shutter: the rows of a frame are exposed one after another, and a mark is where it was at its row's time.

Every mark is placed where it was when the middle row was exposed, by the parabola through three of its sightings.

A read-out that is not stated is not measured either. Two marks show it only where they move along their line: their
distance L then changes by L·e_y·v/(rows per second), e_y being the part of their line along the columns and v their
speed along it. On a steady turn v is constant, and a colour of one mark that is shifted in the image by a constant
0.04 px, as lenses and codecs do it, changes the distance in the very same way as 20 ms at 2 mm/s. What common
read-outs would do is known, however, and told.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEAR = 3.0  # usual frame intervals: sightings that lie farther apart are not of one parabola
COMMON_MS = 10.0, 30.0  # read-outs of phones and webcams
AROUND = 3  # frames on either side from which a speed is taken: noise then adds a hundredth of it
BEYOND = 2.0  # standard uncertainties of a mark: its 95 % interval


@dataclass(frozen=True)
class RollingShutter:
    """readout_s: from the exposure of the first row to that of the last. height_px: rows of the full frame."""

    readout_s: float
    height_px: int

    def lag_s(self, y_px: Array) -> Array:
        """Time from the exposure of the middle row to that of rows."""
        return np.asarray((y_px / max(self.height_px - 1, 1) - 0.5) * self.readout_s, float)


@dataclass(frozen=True)
class UnstatedReadout:
    """What common rolling shutters would do to the marks of a recording.

    shift: RMS of the shifts of the marks by a read-out of 1 ms, in unit. over_stated: the shift by the shortest common
    read-out over the stated standard uncertainty of the marks.
    """

    shift: float
    unit: str
    over_stated: float

    @property
    def note(self) -> str:
        """One sentence for people."""
        low, high = (f"{ms * self.shift:.2g}" for ms in COMMON_MS)
        return (
            "whether the camera has a rolling shutter is not stated: one that reads a frame in "
            f"{COMMON_MS[0]:g} to {COMMON_MS[1]:g} ms, as those of phones and most webcams do, shifts the marks along "
            f"their paths by {low} to {high} {self.unit} (RMS), at least {self.over_stated:.0f} times their stated "
            "uncertainty, and turns the heading; state readout_ms in tracking.toml, 0 for a global shutter"
        )


def of_common_readouts(table: pd.DataFrame, names: Iterable[str], height_px: int) -> UnstatedReadout | None:
    """What a rolling shutter would do, if it matters; table: of `track` or `place_on_plate`, names: of its marks."""
    names = tuple(names)
    placed = any(f"{name}_x_mm" in table for name in names)
    unit, of_unit, shown = ("mm", 1e3, "µm") if placed else ("px", 1.0, "px")
    time_s, apart = table["time_s"].to_numpy(float), 2 * AROUND
    one_ms = RollingShutter(1e-3, height_px)
    shifts, sigmas = [], []
    for name in names:
        places = table[[f"{name}_x_{unit}", f"{name}_y_{unit}"]].to_numpy(float)
        rows = table[f"{name}_y_px"].to_numpy(float)[AROUND : len(table) - AROUND]
        with np.errstate(over="ignore", invalid="ignore"):  # places corrected by hand may be any number
            speed = np.hypot(*(places[apart:] - places[:-apart]).T) / (time_s[apart:] - time_s[:-apart])
            shifts.append(speed * one_ms.lag_s(rows))
        sigmas.append(table[[f"{name}_x_sigma_{unit}", f"{name}_y_sigma_{unit}"]].to_numpy(float).ravel())
    shift, sigma = np.concatenate(shifts), np.concatenate(sigmas)
    shift = shift[np.isfinite(shift)]
    if not (len(shift) and np.isfinite(sigma).any()):
        return None
    usual = float(np.hypot.reduce(shift)) / len(shift) ** 0.5  # squares may overflow
    over = COMMON_MS[0] * usual / float(np.nanmedian(sigma))
    return UnstatedReadout(usual * of_unit, shown, over) if over > BEYOND else None


def place_at_frame_time(time_s: Array, numbers: dict[str, Array], shutter: RollingShutter | None) -> None:
    """Move the centres of marks to the time of the middle row, in place; without a rolling shutter, do nothing.

    time_s: (n,) of the frames. numbers: per mark (n, 5) of x, y, their variances and covariance, px and px², NaN if
    absent. A centre without sightings nearby keeps its place; its variance grows by the square of its largest possible
    shift.
    """
    if shutter is not None:
        for values in numbers.values():
            _place(time_s, values, shutter)


def _place(time_s: Array, values: Array, shutter: RollingShutter) -> None:
    seen = np.flatnonzero(np.isfinite(values[:, 0]))
    if len(seen) < 2:
        return
    lag, found = shutter.lag_s(values[seen, 1]), values[seen].copy()
    when = time_s[seen] + lag
    gaps = np.diff(when)
    near = NEAR * float(np.median(np.diff(time_s)))
    speeds = np.hypot(*np.diff(found[:, :2], axis=0).T) / np.maximum(gaps, 1e-9)
    fastest = float(np.max(speeds[gaps < near], initial=0.0))
    for k, row in enumerate(seen):
        first = min(max(k - 1, 0), max(len(seen) - 3, 0))
        three = np.arange(first, min(first + 3, len(seen)))
        three = three[np.abs(when[three] - when[k]) < near]
        if len(three) < 2:
            values[row, 2:4] += (fastest * lag[k]) ** 2
            continue
        weights = _weights(when[three], float(time_s[row]))
        values[row, :2] = weights @ found[three, :2]
        values[row, 2:] = weights**2 @ found[three, 2:]


def _weights(when: Array, wanted: float) -> Array:
    """Weights of values at two or three times in the polynomial through them, at a wanted time (Lagrange)."""
    ahead = wanted - when
    apart = when[:, None] - when
    np.fill_diagonal(apart, 1.0)
    others = np.where(np.eye(len(when), dtype=bool), 1.0, ahead[None, :])
    return np.asarray(others.prod(axis=1) / apart.prod(axis=1))
