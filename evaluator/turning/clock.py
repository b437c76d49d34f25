"""Delay between the command log of a run and its motion, estimated from the changes of command.

Around a change of command the robot has one steady velocity before and another after it; where the first begins to
change is the moment of the change in the time of the recording. Near every change the pose is fitted with a constant
velocity (forward, sideways, yaw) on either side. From one to the other it goes at once, or steadily within a rise time
(a heavy robot that slides, a drive that limits acceleration) where that fits better by more than chance. Delay and rise
time are common to all changes, and those of the least misfit. The delay includes the dead time of the motors, which a
recording cannot distinguish from an offset of the clocks, and half of a rise that is too short to show.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

Array = NDArray[np.float64]
NAN = float("nan")

COARSE_S, FINE_S = 3.0, 1.0  # of motion on either side of a change: enough to find it, short enough to be steady
MOST_LATE_S = 2.0  # larger differences of the clocks are to be corrected by start_s
FEWEST_FRAMES = 6  # on either side of a change
CHI2_95 = 3.841  # one parameter
# A rise time is believed where -2 log likelihood loses this: once in a thousand by chance. Where it is not, the delay
# is as sharp as changes at once make it.
WORTH = 10.8
# Rise times tried, s, before the best is sought between its neighbours: of shorter ones none shows between usual
# frames, after longer ones no velocity is steady within FINE_S.
RISES_S = np.geomspace(0.02, 1.0, 8)
ROUGH = 1e-3  # of delays (s) and logarithms of rise times that only lead on, or end far beyond in an interval
STEPS = 8  # between frames, of the path along a velocity that changes
UNSEEN = 1e30  # misfit where no change has enough frames on either side: more than any that has


@dataclass(frozen=True)
class CommandDelay:
    """Delay of the motion after the command, s, with its 95 % interval; NaN if no change is visible.

    rise_s: time within which the velocity then follows, 0 where it follows at once.
    """

    value_s: float = NAN
    low_s: float = NAN
    high_s: float = NAN
    rise_s: float = 0.0

    @property
    def is_known(self) -> bool:
        """Whether the delay was determined precisely enough to be used."""
        return bool(np.isfinite(self.value_s) and self.high_s - self.low_s < FINE_S)

    @property
    def settled_s(self) -> float:
        """How long after its command, at most, a change has come about."""
        return self.high_s + self.rise_s


def command_delay(time_s: Array, pose: Array, changes_s: Sequence[float]) -> CommandDelay:
    """Estimate the delay of the motion after the command log.

    time_s: (n,). pose: (n, 3) x, y in mm and heading in rad, unwrapped, without NaN. changes_s: times of the log at
    which the command changes, in order.
    """
    seen = [change for change in changes_s if time_s[0] < change < time_s[-1]]
    if not seen:
        return CommandDelay()
    edges = [float(time_s[0]), *seen, float(time_s[-1])]
    most = min(MOST_LATE_S, min(after - before for before, after in pairwise(edges)) / 2)
    windows = [
        (
            change,
            _between(
                time_s, max((before + change) / 2, change - COARSE_S), min((change + after) / 2, change + COARSE_S)
            ),
        )
        for before, change, after in zip(edges, seen, edges[2:], strict=False)
    ]
    grid = np.arange(-most, most, float(np.median(np.diff(time_s))) / 2)
    if not len(grid):
        return CommandDelay()
    coarse = min(grid, key=lambda late: _misfit(time_s, pose, windows, float(late))[0])
    windows = [(change, frames & (np.abs(time_s - change - coarse) <= FINE_S)) for change, frames in windows]
    if _misfit(time_s, pose, windows, float(coarse))[0] == UNSEEN:
        return CommandDelay()  # no change has enough frames on either side
    return _refined(time_s, pose, windows, float(coarse), float(grid[1] - grid[0]))


def _between(time_s: Array, low: float, high: float) -> NDArray[np.bool_]:
    return np.asarray((time_s >= low) & (time_s <= high))


def _refined(
    time_s: Array, pose: Array, windows: list[tuple[float, NDArray[np.bool_]]], coarse: float, step: float
) -> CommandDelay:
    """The delay of smallest misfit near a coarse one, and its 95 % limits, by the growth of the misfit."""

    def misfit(late: float, rise: float = 0.0) -> float:
        return _misfit(time_s, pose, windows, late, rise)[0]

    def ended(of: Callable[[float], float], best: float, least: float, rise: float = 0.0) -> CommandDelay:
        limit = least * (1 + CHI2_95 / _independent(time_s, pose, windows, best, rise))
        low, high = (best + way * _reach(of, best, way, limit, step) for way in (-1, 1))
        return CommandDelay(best, low, high, rise)

    def begun(rise: float) -> tuple[float, float]:  # earlier than one at once, by half the time
        return _least(lambda late: misfit(late, rise), coarse - rise / 2, rise / 2, ROUGH)

    best, least = _least(misfit, coarse, 2 * step)
    if _independent(time_s, pose, windows, best, 0.0) <= 0:
        return CommandDelay()
    tried = {rise: begun(rise) for rise in RISES_S.tolist()}
    rise = min(tried, key=lambda each: tried[each][1])
    late, risen = tried[rise]
    if _independent(time_s, pose, windows, late, rise) * np.log(least / risen) < WORTH:
        return ended(misfit, best, least)
    width = float(np.log(RISES_S[1] / RISES_S[0]))

    def took(late: float) -> tuple[float, float]:  # of one moment or another: both move together
        return _least(lambda size: misfit(late, float(np.exp(size))), float(np.log(rise)), width, ROUGH)

    best, least = _least(lambda late: took(late)[1], late, rise / 4, ROUGH)
    return ended(lambda late: took(late)[1], best, least, float(np.exp(took(best)[0])))


def _least(of: Callable[[float], float], middle: float, width: float, to: float = 1e-6) -> tuple[float, float]:
    """Where a function is least near a place, found to so little, and its value there."""
    found = minimize_scalar(of, bounds=(middle - width, middle + width), method="bounded", options={"xatol": to})
    return float(found.x), float(found.fun)


def _independent(
    time_s: Array, pose: Array, windows: list[tuple[float, NDArray[np.bool_]]], late: float, rise: float
) -> float:
    """Degrees of freedom; noise that is alike from frame to frame leaves fewer."""
    _, freedom, correlation = _misfit(time_s, pose, windows, late, rise)
    return freedom * (1 - correlation) / (1 + correlation)


def _reach(misfit: Callable[[float], float], best: float, way: int, limit: float, step: float) -> float:
    """Distance from the best delay, in one direction, at which the misfit reaches a limit."""
    inner, outer = 0.0, step / 64
    while misfit(best + way * outer) < limit and outer < MOST_LATE_S:
        inner, outer = outer, 2 * outer
    for _ in range(20):
        middle = (inner + outer) / 2
        inner, outer = (middle, outer) if misfit(best + way * middle) < limit else (inner, middle)
    return outer


def _misfit(
    time_s: Array, pose: Array, windows: list[tuple[float, NDArray[np.bool_]]], late: float, rise: float = 0.0
) -> tuple[float, int, float]:
    """Misfit over all changes, its degrees of freedom, and the correlation of residuals between successive frames.

    The noise of positions and headings is estimated from their residuals: the misfit is the product of their sums of
    squares, each to the power of its share of the degrees of freedom.
    """
    place, turn, counts = 0.0, 0.0, [0, 0]
    products, squares = 0.0, 0.0
    for change, frames in windows:
        since = time_s[frames] - change - late
        if min((since < 0).sum(), (since > 0).sum()) < FEWEST_FRAMES:
            continue
        headings, places = _left_over(since, pose[frames], rise)
        turn, place = turn + float(headings @ headings), place + float((places**2).sum())
        counts[0], counts[1] = counts[0] + len(since) - 3, counts[1] + 2 * len(since) - 6
        products += float((places[1:] * places[:-1]).sum())
        squares += float((places**2).sum())
    freedom = sum(counts)
    if freedom <= 0:
        return UNSEEN, 0, 0.0
    tiny = 1e-300
    total = np.exp((counts[0] * np.log(turn + tiny) + counts[1] * np.log(place + tiny)) / freedom)
    return float(total), freedom, float(np.clip(products / max(squares, tiny), 0.0, 0.95))


def _left_over(since: Array, pose: Array, rise: float = 0.0) -> tuple[Array, Array]:
    """What a velocity that goes from one to another leaves of headings (m,), rad, and places (m, 2), mm.

    since: (m,) from the moment at which it begins to change, s. rise: time that the change takes.
    """
    before, after = _ways(since, rise)
    design = np.column_stack([np.ones_like(since), before, after])
    heading, rates = _fitted(design, pose[:, 2])
    columns = _arcs(since, rates) if rise == 0 else _bent(since, rise, rates)
    moves = np.stack(columns, axis=1)
    still = np.ones((len(since), 1))
    nothing = np.zeros((len(since), 1))
    stacked = np.block([[still, nothing, moves.real], [nothing, still, moves.imag]])
    places = _fitted(stacked, np.concatenate([pose[:, 0], pose[:, 1]]))[0]
    return pose[:, 2] - heading, pose[:, :2] - places.reshape(2, -1).T


def _ways(since: Array, rise: float) -> tuple[Array, Array]:
    """Ways (m,) of unit velocity before a change and after it, from its beginning on."""
    before, after = np.minimum(since, 0), np.maximum(since, 0)
    if rise == 0:
        return before, after
    rising = np.minimum(after, rise)
    still = rising - rising**2 / (2 * rise)  # that the velocity before still goes, and the one after does not yet
    return before + still, after - still


def _arcs(since: Array, rates: Array) -> list[NDArray[np.complex128]]:
    """Paths of unit speed forward and to the left, before a sudden change and after it: arcs.

    rates: (3,) heading at the change, yaw rates before and after it.
    """
    columns = []
    for part, rate in zip(_ways(since, 0.0), rates[1:], strict=True):
        half = rate * part / 2
        chord = part * np.sinc(half / np.pi)
        angle = rates[0] + half
        columns += [chord * np.exp(1j * angle), 1j * chord * np.exp(1j * angle)]
    return columns


def _bent(since: Array, rise: float, rates: Array) -> list[NDArray[np.complex128]]:
    """The same paths where the velocity goes steadily from one to the other, by the trapezoidal rule."""
    frames = np.interp(np.arange(STEPS * (len(since) - 1) + 1) / STEPS, np.arange(len(since)), since)
    times = np.unique(np.r_[frames, 0.0])
    before, after = _ways(times, rise)
    way = np.exp(1j * (rates[0] + rates[1] * before + rates[2] * after))
    fading = 1 - np.clip(times / rise, 0, 1)
    columns = []
    for share in (fading, 1 - fading):
        speed = share * way
        path = np.r_[0.0, np.cumsum(np.diff(times) * (speed[1:] + speed[:-1]) / 2)]
        seen = path[np.searchsorted(times, since)]
        columns += [seen, 1j * seen]
    return columns


def _fitted(design: Array, values: Array) -> tuple[Array, Array]:
    """Fit and coefficients of a linear least-squares fit."""
    found: Array = np.linalg.lstsq(design, values, rcond=None)[0].astype(float)
    fit: Array = design @ found
    return fit, found
