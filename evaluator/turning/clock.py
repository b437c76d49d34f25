"""Delay between the command log of a run and its motion, estimated from the changes of command.

A robot has one steady velocity (forward, sideways, yaw) before a change of command and another one after it. Near every
change this motion is fitted to the poses: the velocity changes either suddenly, or steadily within a rise time (a heavy
robot that slides, a drive that limits acceleration) if that fits significantly better. The estimated delay is the time
from the command to the beginning of the change; delay and rise time are common to all changes.

The delay includes the dead time of the motors, which a recording cannot distinguish from an offset of the clocks, and
half of a rise time that is too short to be detected.
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

COARSE_S = 3.0  # motion on either side of a change with which the delay is searched
FINE_S = 1.0  # motion on either side of a change with which it is estimated: short enough for a steady velocity
MOST_LATE_S = 2.0  # larger offsets of the clocks are to be corrected by start_s
FEWEST_FRAMES = 6  # on either side of a change
CHI2_95 = 3.841  # one parameter
# Least gain in -2 log likelihood of a rise time: chance reaches it once in a thousand. Without a rise time, the delay
# is as precise as sudden changes allow.
WORTH = 10.8
# Rise times that are tried, s. Shorter ones are not visible at usual frame rates; after longer ones no velocity is
# steady within FINE_S.
RISES_S = np.geomspace(0.02, 1.0, 8)
ROUGH = 1e-3  # tolerance of intermediate delays (s) and logarithms of rise times
STEPS = 8  # integration steps per frame along a path with changing velocity
Windows = list[tuple[float, NDArray[np.bool_]]]  # times of changes in the log, and the frames (n,) around each


@dataclass(frozen=True)
class CommandDelay:
    """Delay of the motion after the command, s, with its 95 % interval; NaN if no change can be used.

    rise_s: time within which the velocity then changes; 0 if it changes suddenly.
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
        """Longest time after a command at which the velocity still changes."""
        return self.high_s + self.rise_s


def command_delay(time_s: Array, pose: Array, changes_s: Sequence[float]) -> CommandDelay:
    """Estimate the delay of the motion after the command log.

    time_s: (n,). pose: (n, 3) x, y in mm and heading in rad, unwrapped, without NaN. changes_s: times of the log at
    which the command changes, in order. A change too close to another one, or to an end of the recording, is not used.
    """
    step = float(np.median(np.diff(time_s))) / 2
    windows, room = _windows(time_s, changes_s, 2 * step * FEWEST_FRAMES)
    if not (room > 0).any():
        return CommandDelay()
    # Misfits are comparable only if they are of the same frames: the search extends as far as half of the changes
    # allow, and uses these.
    most = _most(room)
    reach = int(most / step)
    grid = step * np.arange(-reach, reach + 1)
    roomy = [window for window, most_late in zip(windows, room, strict=True) if most_late >= most]
    best = int(np.argmin([_misfit(time_s, pose, roomy, float(late))[0] for late in grid]))
    if best in (0, len(grid) - 1):  # the delay is larger
        return CommandDelay()
    coarse = float(grid[best])
    near = [(change, frames & (np.abs(time_s - change - coarse) <= FINE_S)) for change, frames in windows]
    fine = [(change, frames) for change, frames in near if _fewest(time_s[frames] - change - coarse) >= FEWEST_FRAMES]
    return _refined(time_s, pose, fine, coarse, step) if fine else CommandDelay()


def most_late_s(time_s: Array, changes_s: Sequence[float]) -> float:
    """Largest delay that command_delay finds; 0 if the changes follow one another too fast for any."""
    return _most(_windows(time_s, changes_s, float(np.median(np.diff(time_s))) * FEWEST_FRAMES)[1])


def _most(room: Array) -> float:
    return min(MOST_LATE_S, float(np.median(room[room > 0]))) if (room > 0).any() else 0.0


def _windows(time_s: Array, changes_s: Sequence[float], margin_s: float) -> tuple[Windows, Array]:
    """Frames around every change, and the largest delay that they can show if a margin is left on either side, s.

    The frames between two changes are divided in the middle. Changes with too few frames on one side, also by a gap in
    the recording, are left out.
    """
    seen = [change for change in changes_s if time_s[0] < change < time_s[-1]]
    edges = [float(time_s[0]), *seen, float(time_s[-1])]
    halves = [(after - before) / 2 for before, after in pairwise(edges)]
    windows, room = [], []
    for change, before, after in zip(seen, halves[:-1], halves[1:], strict=True):
        frames = _between(time_s, change - min(before, COARSE_S), change + min(after, COARSE_S))
        if _fewest(time_s[frames] - change) >= FEWEST_FRAMES:
            windows.append((change, frames))
            room.append(min(before, after) - margin_s)
    return windows, np.array(room)


def _fewest(since: Array) -> int:
    """Number of frames (n,) before or after time 0, whichever is smaller."""
    return int(min((since < 0).sum(), (since > 0).sum()))


def _between(time_s: Array, low: float, high: float) -> NDArray[np.bool_]:
    return np.asarray((time_s >= low) & (time_s <= high))


def _refined(time_s: Array, pose: Array, windows: Windows, coarse: float, step: float) -> CommandDelay:
    """The delay of smallest misfit near a coarse one, and its 95 % limits, by the growth of the misfit."""

    def misfit(late: float, rise: float = 0.0) -> float:
        return _misfit(time_s, pose, windows, late, rise)[0]

    def ended(of: Callable[[float], float], best: float, least: float, rise: float = 0.0) -> CommandDelay:
        limit = least * (1 + CHI2_95 / _independent(time_s, pose, windows, best, rise))
        low, high = (best + way * _reach(of, best, way, limit, step) for way in (-1, 1))
        return CommandDelay(best, low, high, rise)

    def begun(rise: float) -> tuple[float, float]:  # earlier than a sudden change that fits, by half the rise time
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

    def took(late: float) -> tuple[float, float]:  # best rise time for a delay: the two are correlated
        return _least(lambda size: misfit(late, float(np.exp(size))), float(np.log(rise)), width, ROUGH)

    best, least = _least(lambda late: took(late)[1], late, rise / 4, ROUGH)
    return ended(lambda late: took(late)[1], best, least, float(np.exp(took(best)[0])))


def _least(of: Callable[[float], float], middle: float, width: float, to: float = 1e-6) -> tuple[float, float]:
    """Argument within a width of a middle at which a function is least, to a tolerance, and its value there."""
    found = minimize_scalar(of, bounds=(middle - width, middle + width), method="bounded", options={"xatol": to})
    return float(found.x), float(found.fun)


def _independent(time_s: Array, pose: Array, windows: Windows, late: float, rise: float) -> float:
    """Degrees of freedom, reduced by the correlation of the noise between successive frames."""
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


def _misfit(time_s: Array, pose: Array, windows: Windows, late: float, rise: float = 0.0) -> tuple[float, int, float]:
    """Misfit over all changes, its degrees of freedom, and the correlation of residuals between successive frames.

    The noise of positions and headings is estimated from their residuals: the misfit is the product of their sums of
    squares, each to the power of its share of the degrees of freedom.
    """
    place, turn, counts = 0.0, 0.0, [0, 0]
    products, squares = 0.0, 0.0
    for change, frames in windows:
        since = time_s[frames] - change - late
        headings, places = _left_over(since, pose[frames], rise)
        turn, place = turn + float(headings @ headings), place + float((places**2).sum())
        counts[0], counts[1] = counts[0] + len(since) - 3, counts[1] + 2 * len(since) - 6
        products += float((places[1:] * places[:-1]).sum())
        squares += float((places**2).sum())
    freedom = sum(counts)
    tiny = 1e-300
    total = np.exp((counts[0] * np.log(turn + tiny) + counts[1] * np.log(place + tiny)) / freedom)
    return float(total), freedom, float(np.clip(products / max(squares, tiny), 0.0, 0.95))


def _left_over(since: Array, pose: Array, rise: float = 0.0) -> tuple[Array, Array]:
    """Residuals of headings (m,), rad, and positions (m, 2), mm, after a fit of a motion with one change of velocity.

    since: (m,) time since the beginning of the change, s. rise: duration of the change, s.
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
    """Path lengths (m,) at unit velocity by the velocities before and after a change, measured from its beginning."""
    before, after = np.minimum(since, 0), np.maximum(since, 0)
    if rise == 0:
        return before, after
    rising = np.minimum(after, rise)
    still = rising - rising**2 / (2 * rise)  # share of the former velocity during the change, integrated
    return before + still, after - still


def _arcs(since: Array, rates: Array) -> list[NDArray[np.complex128]]:
    """Arcs driven at unit speed forward and to the left, before a sudden change and after it, x + iy.

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
    """Paths as of `_arcs` if the velocity changes steadily within a rise time, by the trapezoidal rule."""
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
