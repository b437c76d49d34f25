"""Position of a mark at mid-exposure, from its average position in the frame.

Speed that changes by a·t during an exposure T leaves the average off the middle by a·T²/24. Where it jumps by Δv at a
moment t from the middle, the average is off by Δv·(T/2 - |t|)²/2T: a jump at any moment is as likely as at any other,
and the mean square is (Δv·T)²/320.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEADY, JUMP = 24.0, 320.0  # the denominators of both cases
# Sigmas of the centres' errors beyond which a jump is real; sum of the squares of the centres' weights in a jump.
CERTAIN, WEIGHTS = 3.0, 17.5


def exposed(time_s: Array, centers_px: Array, variances: Array, shutter: tuple[float, float]) -> tuple[Array, Array]:
    """Shift of the average off the middle of the exposure, px, and its variance per axis, px²; both (n, 2).

    centers_px, variances: (n, 2), px and px², NaN where absent. shutter: exposure as a share of the interval, and its
    standard uncertainty. Beside an absent frame, and in the first and the last one, the change of speed is that of
    the adjacent frames.
    """
    n = len(time_s)
    if n < 3:
        return np.zeros((n, 2)), np.zeros((n, 2))
    share, unsure = shutter
    interval = np.where(np.diff(time_s) > 0, np.diff(time_s), np.nan)
    # Mean velocities of two intervals differ by the change of speed between their middles; a lost frame lengthens one.
    apart = np.full((n, 1), np.nan)
    apart[1:-1, 0] = (interval[:-1] + interval[1:]) / 2
    change = np.full((n, 2), np.nan)
    change[1:-1] = np.diff(np.diff(centers_px, axis=0) / interval[:, None], axis=0) / apart[1:-1]
    lapse = np.nan_to_num(np.fmin(np.append(interval, np.nan), np.append(np.nan, interval)))[:, None]
    # A steady change continues in the frames around; a jump appears in one frame only, or in parts in two of three.
    around = np.pad(change, ((1, 1), (0, 0)), constant_values=np.nan)
    before, after = around[:-2], around[2:]
    lower, upper = np.minimum(before, after), np.maximum(before, after)
    steady = np.maximum(lower, np.minimum(upper, change))  # their median, NaN if one of them is NaN
    for _ in range(2):  # at a gap: of three changes in a row, the first known one is the second after an absent frame
        around = np.pad(steady, ((1, 1), (0, 0)), constant_values=np.nan)
        steady = np.where(np.isnan(steady), np.where(np.isnan(around[:-2]), around[2:], around[:-2]), steady)
    steady = np.nan_to_num(steady)
    jump = np.nan_to_num((change - steady) * apart) * lapse
    jump[jump**2 < CERTAIN**2 * WEIGHTS * np.nan_to_num(variances)] = 0.0
    shift = steady * (lapse * share) ** 2 / STEADY
    of_share = steady * lapse**2 * 2 * share * unsure / STEADY
    return shift, of_share**2 + (jump * share) ** 2 / JUMP
