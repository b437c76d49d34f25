"""Delay between the command log of a run and its motion, estimated from the changes of command.

The robot has one steady velocity before a change of command and another one after it; they meet at the time of the
change in the recording. Near every change, the pose is fitted with a constant velocity (forward, sideways, yaw) on
either side; the delay common to all changes is the one with the smallest misfit. It includes the lag of the motors,
which a recording cannot distinguish from an offset of the clocks.
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
UNSEEN = 1e30  # misfit if no change has enough frames on either side


@dataclass(frozen=True)
class CommandDelay:
    """Delay of the motion after the command, s, with its 95 % interval; NaN if no change is visible."""

    value_s: float = NAN
    low_s: float = NAN
    high_s: float = NAN

    @property
    def is_known(self) -> bool:
        """Whether the delay was determined precisely enough to be used."""
        return bool(np.isfinite(self.value_s) and self.high_s - self.low_s < FINE_S)


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

    def misfit(late: float) -> float:
        return _misfit(time_s, pose, windows, late)[0]

    found = minimize_scalar(
        misfit, bounds=(coarse - 2 * step, coarse + 2 * step), method="bounded", options={"xatol": 1e-6}
    )
    best = float(found.x)
    least, freedom, correlation = _misfit(time_s, pose, windows, best)
    if freedom <= 0:
        return CommandDelay()
    # Noise that is alike from frame to frame leaves fewer independent frames.
    limit = least * (1 + CHI2_95 * (1 + correlation) / (1 - correlation) / freedom)
    return CommandDelay(best, best - _reach(misfit, best, -1, limit, step), best + _reach(misfit, best, 1, limit, step))


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
    time_s: Array, pose: Array, windows: list[tuple[float, NDArray[np.bool_]]], late: float
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
        headings, places = _left_over(since, pose[frames])
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


def _left_over(since: Array, pose: Array) -> tuple[Array, Array]:
    """Residuals of headings (m,), rad, and positions (m, 2), mm, from constant velocities before and after a change."""
    before, after = np.minimum(since, 0), np.maximum(since, 0)
    design = np.column_stack([np.ones_like(since), before, after])
    heading, rates = _fitted(design, pose[:, 2])
    # Paths of unit speed forward and to the left along the fitted heading, before the change and after it: arcs.
    columns = []
    for part, rate in ((before, rates[1]), (after, rates[2])):
        half = rate * part / 2
        chord = part * np.sinc(half / np.pi)
        angle = rates[0] + half
        columns += [chord * np.exp(1j * angle), 1j * chord * np.exp(1j * angle)]
    moves = np.stack(columns, axis=1)
    still = np.ones((len(since), 1))
    nothing = np.zeros((len(since), 1))
    stacked = np.block([[still, nothing, moves.real], [nothing, still, moves.imag]])
    places = _fitted(stacked, np.concatenate([pose[:, 0], pose[:, 1]]))[0]
    return pose[:, 2] - heading, pose[:, :2] - places.reshape(2, -1).T


def _fitted(design: Array, values: Array) -> tuple[Array, Array]:
    """Fit and coefficients of a linear least-squares fit."""
    found: Array = np.linalg.lstsq(design, values, rcond=None)[0].astype(float)
    fit: Array = design @ found
    return fit, found
