"""Motion of the image while the robot stands: before its motors start, its marks show what moves the camera.

A plain plate has no texture by which `plate_shift` could see that. Marks that move together by more than they state,
before anything drives them, are moved by the camera, by image stabilisation, or by a hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A start counted by frames is known better than this (mistakes/start/late_start.LATE_S): before it, the robot stands.
SURELY_S = 0.1
PARTS, LEAST = 4, 3  # of the rest, each with so many frames that one wrong one does not move their median
OVER_STATED = (
    3.0  # times the stated uncertainty of a mark in one frame, since a codec keeps an error for all of the rest
)
# Of the common way: a camera moves marks alike, within 3 % in two renderings. A coarse first image that becomes finer
# moves each by an error of its own, 55 % at 150 kbit/s.
ALIKE = 0.25


@dataclass(frozen=True)
class MotionAtRest:
    """How far marks move together before the start, mm, and that over their stated standard uncertainty."""

    way_mm: float
    over_stated: float

    @property
    def note(self) -> str:
        """One sentence for people."""
        return (
            f"the marks move together by {1e3 * self.way_mm:.0f} µm before the motors start, {self.over_stated:.0f} "
            "times their stated uncertainty: image stabilisation, or a camera that is not fixed, by which positions "
            "and radius may be off by more than their intervals? Switch stabilisation off, fix the camera and record "
            "again, unless something moved the robot then, or start_s is late"
        )


def motion_at_rest(marks: pd.DataFrame, names: Sequence[str], start_s: float) -> MotionAtRest | None:
    """Motion of the image before the start, if it is seen; marks: of `place_on_plate`, two or more of them."""
    rest = marks[marks["time_s"] < start_s - SURELY_S]
    if len(names) < 2 or len(rest) < PARTS * LEAST:
        return None
    places = np.stack([rest[[f"{name}_x_mm", f"{name}_y_mm"]].to_numpy(float) for name in names], axis=1)
    stated = rest[[f"{name}_{axis}_sigma_mm" for name in names for axis in "xy"]].to_numpy(float)
    parts = np.array_split(places, PARTS)
    if not np.isfinite(stated).any() or min(np.isfinite(part).all(axis=(1, 2)).sum() for part in parts) < LEAST:
        return None
    each = np.array([np.nanmedian(part, axis=0) for part in parts])  # (PARTS, marks, 2)
    each -= each[0]
    together = each.mean(axis=1)
    way = np.hypot(*together.T)
    k = int(np.argmax(way))
    apart = float(np.hypot(*(each[k] - together[k]).T).max())
    over = float(way[k] / np.nanmedian(stated))
    return MotionAtRest(float(way[k]), over) if over > OVER_STATED and apart < ALIKE * way[k] else None
