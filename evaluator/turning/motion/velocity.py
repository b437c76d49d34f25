"""Velocity of a body at one time of its measured path."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEAR_S, FEWEST = 0.25, 5  # frames that tell it, on either side; of a slow sensor the nearest ones


def velocity_at(time_s: Array, path: Array, at_s: float) -> tuple[float, float, float] | None:
    """Velocity along and across the heading, mm/s, and yaw rate, rad/s, near a time.

    path: (n, 3) x and y, mm, and unwrapped heading, rad, at time_s (n,). Slopes of the parabolas through the frames
    within NEAR_S, at least FEWEST. None for fewer, and if none is within NEAR_S.
    """
    near = np.abs(time_s - at_s)
    chosen = np.sort(np.argsort(near, kind="stable")[: max(FEWEST, int(np.count_nonzero(near <= NEAR_S)))])
    if len(chosen) < FEWEST or near.min() > NEAR_S:
        return None
    values = path[chosen]
    _, slopes, places = np.polyfit(time_s[chosen] - at_s, values - values[0], 2)
    along = (slopes[0] + 1j * slopes[1]) * np.exp(-1j * (values[0, 2] + places[2]))
    return float(along.real), float(along.imag), float(slopes[2])
