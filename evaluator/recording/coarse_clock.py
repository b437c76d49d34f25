"""Times of evenly spaced frames that were told by a coarse clock, such as the 1/64 s of a computer, or rounded.

A camera takes its frames evenly; a program that stamps them by a clock that moves in steps tells times that are wrong
by up to a step, and a robot seems to run ahead and fall back by its way in that time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FEWEST_FRAMES = 30  # of random stamps, so many are within a step of even times by no chance
WINDOW = 20  # frames over which the usual interval is told to a twentieth of a step
FINE = 0.005  # of the interval: times that are wrong by less, in which a robot hardly moves, stay as they are
# Of the interval: steps beyond which every second frame or fewer would come a step later, as behind a lost frame. No
# camera takes 64 frames a second, so that the steps of 1/64 s of a computer may be as long as the interval.
COARSE, OF_COMPUTER_S, LIKE_S = 0.62, 1 / 64, 2e-4
MOST_PLACES = 9  # decimal places of a stamp
ROUNDED = 2.5  # roundings by which equal intervals differ at most: each of their two ends is rounded
WITHIN = 1.001  # of a step: times that a clock tells late by up to a step, and rounding errors


def even_times(time_s: Floats) -> tuple[Floats, float] | None:
    """Even times of frames (n,), s, and the step of the clock that told them, s; None if they are uneven or fine.

    time_s: (n,), rising. Missing frames leave gaps of whole intervals. The mean of all times stays: whether the clock
    told them late or rounded them, by half a step on average or not at all, is not known.
    """
    steps = np.diff(time_s)
    if len(time_s) < FEWEST_FRAMES or not (steps > 0).all():
        return None
    rounding = _rounding(time_s)
    for tick in dict.fromkeys([_tick(steps, rounding), rounding]):
        even = _even_within(time_s, tick, 0.0 if tick == rounding else 2 * rounding)
        if even is not None:
            return even, tick
    return None


def _even_within(time_s: Floats, tick: float, more: float) -> Floats | None:
    """Even times of frames (n,), s, if they are those of a clock with this step, told to `more`; otherwise None."""
    steps, since = np.diff(time_s), time_s - time_s[0]
    interval = float(np.median(time_s[WINDOW:] - time_s[:-WINDOW])) / WINDOW
    coarsest = WITHIN if abs(tick - OF_COMPUTER_S) < LIKE_S else COARSE
    if not FINE * interval <= tick <= coarsest * interval:  # finer ones, most, are wrong by less than FINE
        return None
    from scipy.optimize import minimize_scalar  # slow to import, and seldom needed

    after_gap = steps > interval + WITHIN * tick + more
    frame = np.r_[0.0, np.cumsum(np.where(after_gap, np.rint(steps / interval), 1.0))]
    slope, begin = np.polyfit(frame, since, 1)
    most = tick / frame[-1]  # a step from the first to the last frame
    apart = minimize_scalar(
        lambda share: np.ptp(since - (slope + share * most) * frame), bounds=(-1, 1), method="bounded"
    ).fun
    even = begin + slope * frame
    if apart > WITHIN * tick + more or np.abs(even - since).max() < FINE * interval:
        return None
    return np.asarray(time_s[0] + even, dtype=np.float64)


def _rounding(time_s: Floats) -> float:
    """Unit of the last decimal place in which times are told, s."""
    since = time_s - np.rint(time_s[0])
    for places in range(MOST_PLACES):
        if np.abs(since - np.round(since, places)).max() < 10.0 ** -(places + 2):
            return 10.0**-places
    return 10.0**-MOST_PLACES


def _tick(steps: Floats, rounding: float) -> float:
    """Step of the clock: what intervals are whole multiples of, or the rounding if they are of nothing longer."""
    values = np.unique(steps)
    edges = np.flatnonzero(np.diff(values) > ROUNDED * rounding)
    if not len(edges):
        return rounding
    tick = float(np.diff([part.mean() for part in np.split(values, edges + 1)]).min())
    tick = float(np.median(steps / np.maximum(np.rint(steps / tick), 1.0)))
    off = np.abs(steps - np.rint(steps / tick) * tick).max()
    return tick if off <= ROUNDED * rounding else rounding
