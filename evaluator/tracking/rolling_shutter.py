"""Rolling shutter: the rows of a frame are exposed one after another, and a mark is where it was at its row's time.

Every mark is placed where it was when the middle row was exposed, by the parabola through three of its sightings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEAR = 3.0  # usual frame intervals: sightings that lie farther apart are not of one parabola


@dataclass(frozen=True)
class RollingShutter:
    """readout_s: from the exposure of the first row to that of the last. height_px: rows of the full frame."""

    readout_s: float
    height_px: int

    def lag_s(self, y_px: Array) -> Array:
        """Time from the exposure of the middle row to that of rows."""
        return np.asarray((y_px / max(self.height_px - 1, 1) - 0.5) * self.readout_s, float)


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
